"""Errors that a fit of the field states: against draws, where nothing is known, and the misfit."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import scipy.stats
import torch
from test_field_fit import TRUE, solved, solved_setup

import torchliner as tl
from torchliner.pressure import fit_field as field_fit
from torchliner.pressure import impedance_search as field_search
from torchliner.pressure.fit_field import fit_field
from torchliner.pressure.kumaresan_tufts import kumaresan_tufts
from torchliner.pressure.microphone_errors import draw_pressures, largest_misfit
from torchliner.records.drawn_impedance import deviation

pytestmark = [
    pytest.mark.filterwarnings("ignore::torchliner.DataWarning"),
]


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


def test_one_amplitude_more_widens_the_error():
    """Laplace with the far end fitted against 80 draws, and against the error without it."""
    line, solver = solved(frequency=(1500.0,))
    tight, found = fit_field(line, solver, far_end="stated"), fit_field(line, solver, draws=80)
    for part in ("real", "imag"):
        wide = getattr(found.standard_error, part)
        assert torch.allclose(getattr(found.standard_deviation, part), wide, rtol=0.25)
        assert bool((wide > getattr(tight.standard_error, part)).all())
    assert found.draws is not None
    assert 0.9 < float(found.draws.misfit.mean()) < 1.1


def test_draws_have_the_amplitude_of_the_result():
    """In Pa at the liner's edge, as without draws."""
    line, solver = solved(frequency=(1500.0,))
    found = fit_field(line, solver, draws=20)
    assert found.draws is not None
    assert float((found.draws.amplitude / found.amplitude - 1).abs().max()) < 0.05
    assert float((found.amplitude / solver.case.incident - 1).abs().max()) < 1e-8


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


def test_an_error_is_large_where_microphones_say_little():
    """A liner seen from far away, hard: the error of 1/Z, which is bounded, is that of draws."""
    line, solver = solved(impedance=30.0, frequency=(1500.0,))
    found = fit_field(line, solver, draws=80)
    assert found.draws is not None
    admittance = 1 / found.draws.impedance
    stated = found.standard_error / found.impedance.abs() ** 2
    for part in ("real", "imag"):
        wide = getattr(admittance, part).std(0)
        assert torch.allclose(wide, getattr(stated, part), rtol=0.25)


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


def test_doubts_are_each_case_s_own():
    """A rigid wall in a batch hides no negative resistance, nor does a mean that of an edge."""
    lines = [solved(impedance=z, frequency=(1500.0,)) for z in (math.inf, -0.5 + 1j)]
    pressure = torch.stack([line.pressure for line, _ in lines])
    both = dataclasses.replace(lines[0][0], pressure=pressure)
    notes = fit_field(both, lines[0][1]).notes
    told = {note.code: note.text for note in notes}
    assert "at 1 of 2 values" in told["rigid-wall"]
    assert "the resistance is -0.5, below 0" in told["active-wall"]
    _, solver = lines[0]

    def wall(x, _):
        return (0.6 + 0.5j + 1.8 * (x / 0.15 - 0.5)).expand(1, -1)

    varying = solved_setup(1500.0).line_of(solver.solve(wall))
    found = fit_field(varying, solver, variation="linear", start=0.6 + 0.5j)
    assert float(found.rise.real) == pytest.approx(1.8, abs=1e-5)
    assert "the resistance is -0.3, below 0" in found.notes[-1].text


def test_what_did_not_settle_is_not_called_rigid():
    line, solver = solved(frequency=(1500.0,))
    notes = fit_field(line, solver, start=-1 + 1e-9j).notes
    codes = {note.code for note in notes}
    assert "unsettled" in codes
    assert "rigid-wall" not in codes


def test_many_right_lines_are_not_doubted():
    """The limit is that of the worst of them."""
    line, solver = solved(frequency=(1500.0,))
    drawn = draw_pressures(line.pressure, 150, torch.Generator().manual_seed(0))
    found = fit_field(dataclasses.replace(line, pressure=drawn), solver, start=TRUE)
    assert found.notes == ()
    assert float(found.misfit.max()) > largest_misfit(30)


def test_fewer_than_two_draws_have_no_deviation():
    one = torch.tensor([[1.0 + 1j, 2.0 + 0j], [math.nan, 3.0 + 0j]], dtype=torch.complex128)
    found = deviation(one)
    assert bool(torch.isnan(found[0].real))
    assert float(found[1].real) == pytest.approx(math.sqrt(0.5))


def test_what_comes_in_may_be_of_other_types():
    """Single precision, with a gradient, a start of numpy."""
    line, solver = solved(frequency=(1500.0,))
    single = dataclasses.replace(line, pressure=line.pressure.to(torch.complex64).requires_grad_())
    found = fit_field(single, solver, start=np.complex64(2 + 1j))
    assert complex(found.impedance[0]) == pytest.approx(TRUE, abs=1e-3)


def test_draws_that_do_not_settle_do_not_count(monkeypatch):
    """No impedance, no level: left out of deviation, interval and range."""
    line, solver = solved(frequency=(1500.0,))
    whole = fit_field(line, solver, draws=6)

    def some_lost(*arguments):
        found = field_search.search(*arguments)
        if len(found.cost) == 6:
            found.converged[::3] = False
            found.place[::3] = 0.9
        return found

    monkeypatch.setattr(field_fit, "search", some_lost)
    with pytest.warns(tl.DataWarning, match="2 of 6 draws have no impedance and are left"):
        found = fit_field(line, solver, draws=6)
    assert found.failed.tolist() == [2]
    assert whole.draws is not None
    kept = whole.draws.impedance[[1, 2, 4, 5], 0]
    assert complex(found.mean[0]) == pytest.approx(complex(kept.mean()), abs=1e-6)
    assert float(found.standard_deviation.real[0]) == pytest.approx(float(kept.real.std()), rel=1e-3)
    assert found.draws is not None
    assert bool(torch.isnan(found.draws.level_along()[1][0]).all())


def test_numbers_of_draws_that_are_none():
    line, solver = solved(frequency=(1500.0,))
    for draws, kind, match in (
        (1, ValueError, "draws is 1; 0 for none, or at least 2"),
        (-1, ValueError, "draws is -1; 0 for none, or at least 2"),
        (1.5, TypeError, r"draws is 1\.5; a whole number is needed"),
    ):
        for method in (fit_field, lambda line, _, draws: kumaresan_tufts(line, draws=draws)):
            with pytest.raises(kind, match=match):
                method(line, solver, draws=draws)


def test_a_rise_is_known_as_well_as_it_says():
    """A constant wall has none; its draws scatter by the stated error, within a quarter."""
    line, solver = solved(frequency=(1500.0,))
    found = fit_field(line, solver, variation="linear", draws=80)
    assert float(found.rise.abs().max()) < 1e-6
    assert found.draws is not None
    for part in ("real", "imag"):
        wide = getattr(found.draws.rise, part).std(0)
        assert torch.allclose(wide, getattr(found.rise_error, part), rtol=0.25)
        wide = getattr(found.standard_deviation, part)
        assert torch.allclose(wide, getattr(found.standard_error, part), rtol=0.25)
    assert 0.85 < float(found.draws.misfit.mean()) < 1.15
