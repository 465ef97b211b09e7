"""Impedance by fitting the linearised Euler equations to wall pressures, and the errors that the fit states."""

from __future__ import annotations

import dataclasses
import functools
import math
import warnings

import pytest
import scipy.stats
import torch

import torchliner as tl
from torchliner.duct.case import DuctCase
from torchliner.duct.flow_profiles import TanhProfile, UniformProfile
from torchliner.duct.mesh import build_mesh
from torchliner.duct.presets import load_duct
from torchliner.duct.solver import DuctSolver
from torchliner.pressure.fit_field import fit_field
from torchliner.pressure.waves import kumaresan_tufts
from torchliner.records import MicrophoneLine

TRUE = 1.4 - 0.6j
pytestmark = [pytest.mark.filterwarnings("ignore::torchliner.DataWarning")]


@functools.cache
def small_duct(side, frequency, profile="uniform", **changes):
    """A duct and its solver, on a mesh fine enough for sound: the same equations make pressures and fit them."""
    about = {"start": -0.12, "end": 0.27, "frequency": list(frequency), "profile": profile, **changes}
    setup = load_duct("b2a", source_side=side, **about)
    mesh = build_mesh(setup.case, float(setup.frequency.max()), column=0.03, row=0.0125)
    return setup, DuctSolver(setup.case, setup.frequency, mesh)


@functools.cache
def solved(side="upstream", impedance=TRUE, frequency=(900.0, 1500.0), **changes):
    """Pressures of one impedance in a small duct, and its solver."""
    setup, solver = small_duct(side, frequency, **changes)
    return setup.line_of(solver.solve(torch.tensor([impedance], dtype=torch.complex128))), solver


@pytest.fixture(scope="module")
def upstream():
    return solved()


def test_the_impedance_that_made_the_pressures_comes_back(upstream):
    """Both frequencies, to rounding, with the amplitude of the incident wave."""
    line, solver = upstream
    found = fit_field(line, solver)
    assert bool(found.converged.all())
    assert float((found.impedance - TRUE).abs().max()) < 1e-8
    assert float((found.amplitude / solver.case.incident - 1).abs().max()) < 1e-8
    assert float(found.misfit.max()) < 1e-12
    assert float((found.pressure - line.pressure).abs().max()) < 1e-6


def test_several_frequencies_of_a_sheared_duct():
    """Where both walls' conditions are one, the equations hold constants that frequencies share."""
    line, solver = solved(profile="tanh")
    assert float((fit_field(line, solver, start=1.5).impedance - TRUE).abs().max()) < 1e-7


def test_both_sides_give_one_impedance_where_one_mode_does_not():
    """No mismatch is left by the fit; the method of one mode has one on the same pressures."""
    fits, modes = [], []
    for side in ("upstream", "downstream"):
        line, solver = solved(side)
        fits.append(complex(fit_field(line, solver).impedance[1]))
        over = dataclasses.replace(line, pressure=line.pressure)
        modes.append(complex(kumaresan_tufts(over).impedance[1]))
    assert abs(fits[0] - fits[1]) < 1e-7
    assert abs(modes[0] - modes[1]) > 0.1


def test_a_duct_that_is_not_the_measured_one_says_so(upstream):
    """An end that reflects, unknown to the model: the misfit is far above the errors."""
    _, blind = upstream
    line, _ = solved(end_reflection=(0.2, 0.0))
    with pytest.warns(tl.DataWarning, match=r"at 2 of 2 values, .* the residuals are .* times the .* stated"):
        found = fit_field(line, blind, far_end="stated", start=2.0)
    assert float(found.misfit.min()) > 3


@pytest.mark.parametrize("side", ["upstream", "downstream"])
@pytest.mark.parametrize("reflection", [(0.0, 0.0), (0.3, -0.2)])
def test_a_fitted_far_end_needs_no_knowledge_of_it(side, reflection):
    """Z comes back, and with it what the end reflects; what the source's end reflects is part of
    the amplitude."""
    _, blind = solved(side)
    line, _ = solved(side, end_reflection=reflection, source_reflection=(0.1, 0.4))
    found = fit_field(line, blind, start=1.0)
    assert float((found.impedance - TRUE).abs().max()) < 1e-7
    assert float((found.end_reflection - complex(*reflection)).abs().max()) < 1e-7
    assert float(found.residual.max()) < 1e-9


@pytest.mark.parametrize("wall", [0.0, 1e-3, 0.05 - 0.2j, 50.0, 0.05 - 8j, 0.3 + 0.9j])
def test_walls_at_the_ends_of_the_range(wall):
    """Soft, hard and reactive walls, with no guess and no doubt of a trial passed on."""
    line, solver = solved(impedance=wall, frequency=(1500.0,))
    with warnings.catch_warnings():
        warnings.simplefilter("error", tl.DataWarning)
        warnings.filterwarnings("ignore", ".*a wave of its shear layer grows")  # of the wall found
        found = fit_field(line, solver)
    assert abs(complex(found.impedance[0]) - wall) < 1e-6 * (1 + abs(wall))


def test_a_fit_that_leans_on_a_growing_wave_says_so():
    """Uniform flow and 0.8+0.4j fitted with a sheared profile, in which that liner amplifies: the
    fit flees to another impedance, and says that its field is fed; in uniform flow it is not."""
    x, frequency = torch.linspace(0.02, 0.78, 12).double(), torch.tensor([500.0]).double()
    cases = [
        DuctCase(profile, 0.0, 0.8, [(0.2, 0.6)], slip_condition=slip)
        for profile, slip in ((UniformProfile(0.3, 0.0635), "ingard-myers"), (TanhProfile(0.3, 0.0635, 0.1), None))
    ]
    flat, sheared = (DuctSolver(case, frequency) for case in cases)
    heard = flat.solve(0.8 + 0.4j).wall_pressure(x.numpy(), "opposite").detach().movedim(-1, -2)
    line = MicrophoneLine(
        x,
        heard,
        frequency,
        duct_height=0.0635,
        source_side="upstream",
        mach=0.3,
        fluid=tl.Fluid(sound_speed=cases[0].profile.sound_speed),
    )
    right, wrong = (fit_field(line, duct, start=2.0) for duct in (flat, sheared))
    assert abs(complex(right.impedance[0]) - (0.8 + 0.4j)) < 1e-6
    assert right.notes == ()
    assert abs(complex(wrong.impedance[0]) - (0.8 + 0.4j)) > 0.5
    assert {"growing-wave", "model-misfit"} <= {note.code for note in wrong.notes}


@pytest.mark.parametrize(
    ("change", "options", "match"),
    [
        ({}, {"microphones": 2, "far_end": "stated"}, "2 microphones are too few for 2 complex unknowns"),
        ({}, {"microphones": 3}, "3 microphones are too few for 3 complex unknowns"),
        ({"mach": 0.1}, {}, r"mach is 0\.1, of the duct 0\.3"),
        ({"liner_end": 0.14}, {}, r"liner_end \(m\) is 0\.14, of the duct 0\.15"),
        ({"source_side": "unknown"}, {}, "source_side is 'unknown'"),
        ({"frequency": [900.0, 1600.0]}, {}, r"\[900\.0, 1600\.0\] Hz, of the duct"),
        ({}, {"level_error": 0.0}, r"level_error \(dB\) is 0; .*0\.0001"),
        ({}, {"far_end": "open"}, "far_end 'open'.*fitted, stated"),
    ],
)
def test_bad_lines_are_refused(upstream, change, options, match):
    line, solver = upstream
    count = options.pop("microphones", line.microphones)
    with pytest.raises(ValueError, match=match):
        fit_field(dataclasses.replace(line, **change).select(range(count)), solver, **options)


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
