"""Errors that a fit of the field states: against draws, where nothing is known, and the misfit."""

from __future__ import annotations

import math

import pytest
import scipy.stats
import torch
from test_field_fit import solved

import torchliner as tl
from torchliner.pressure.fit_field import fit_field

pytestmark = [pytest.mark.filterwarnings("ignore::torchliner.DataWarning")]


def test_the_stated_error_is_the_scatter_of_draws():
    """Laplace against 80 draws: standard deviations of R and X within a quarter (three standard
    errors of a deviation from 80 draws), means within three of the mean's."""
    line, solver = solved(frequency=(1500.0,))
    found = fit_field(line, solver, draws=80)
    assert found.draws is not None
    assert bool(found.draws.converged.all())
    drawn = found.draws.impedance
    for part in ("real", "imag"):
        wide = getattr(drawn, part).std(0)
        assert torch.allclose(wide, getattr(found.standard_error, part), rtol=0.25)
        away = (getattr(drawn, part).mean(0) - getattr(found.impedance, part)).abs()
        assert bool((away < 3 * wide / math.sqrt(80)).all())
    assert 0.9 < float(found.draws.misfit.mean()) < 1.1  # chi squared over its degrees


@pytest.mark.parametrize("wall", [math.inf, 2000.0 - 500.0j])
def test_a_rigid_wall_has_no_bound(wall):
    """It is found, its draws settle, and no error is stated for what is not known."""
    line, solver = solved(impedance=wall, frequency=(1500.0,))
    with pytest.warns(tl.DataWarning, match="at 1 of 1 values, .* do not tell the liner from a rigid wall"):
        found = fit_field(line, solver, draws=5)
    assert bool(found.converged.all())
    assert found.draws is not None
    assert bool(found.draws.converged.all())
    assert float(found.impedance.abs()) > 1900
    assert math.isinf(float(found.standard_error.real))
    assert math.isinf(float(found.standard_error.imag))


def test_the_misfit_of_a_right_model_is_chi_squared():
    """Kolmogorov and Smirnov's test on draws around the truth."""
    line, solver = solved(frequency=(1500.0,))
    found = fit_field(line, solver, draws=150)
    assert found.draws is not None
    freedom = 2 * (18 - 3)
    value = found.draws.misfit[:, 0].numpy() * freedom
    assert scipy.stats.kstest(value, "chi2", args=(freedom,)).pvalue > 0.01
    share = (value > scipy.stats.chi2.ppf(0.99, freedom)).mean()
    assert share < 0.04


def test_a_wall_near_a_rigid_one_is_told_of():
    """The error of Z to first order is too small; that of 1/Z is not."""
    line, solver = solved(impedance=120.0, frequency=(1500.0,))
    with pytest.warns(tl.DataWarning, match="a rigid wall is within 6 standard errors: those of 1/Z"):
        found = fit_field(line, solver, draws=80)
    assert found.draws is not None
    scatter = (1 / found.draws.impedance).real.std(0)
    stated = found.standard_error.real / found.impedance.abs() ** 2
    assert torch.allclose(scatter, stated, rtol=0.25)
    assert float(found.standard_deviation.real) > 1.3 * float(found.standard_error.real)
