"""Impedance by fitting the linearised Euler equations, the errors that it states, and its least-squares method."""

import dataclasses
import functools
import math
import warnings

import pytest
import scipy.stats
import torch
from conftest import doubtful

import torchliner as tl
from torchliner.duct.mesh import build_mesh
from torchliner.duct.presets import load_duct
from torchliner.duct.solver import DuctSolver
from torchliner.pressure.fit_field import fit_field
from torchliner.pressure.least_squares import best_of, damped_step, least_squares
from torchliner.pressure.waves import kumaresan_tufts

TRUE = 1.4 - 0.6j


@functools.cache
def small_duct(side, frequency, profile="uniform", **changes):
    """A duct and its solver, on a mesh fine enough for sound: the same equations make pressures and fit them."""
    about = {"start": -0.12, "end": 0.27, "frequency": list(frequency), "profile": profile, **changes}
    setup = load_duct("b2a", source_side=side, **about)
    mesh = build_mesh(setup.case, float(setup.frequency.max()), column=0.03, row=0.0125)
    return setup, DuctSolver(setup.case, setup.frequency, mesh)


@functools.cache
def solved(side="upstream", impedance=TRUE, frequency=(900.0, 1500.0), **changes):
    setup, solver = small_duct(side, frequency, **changes)
    return setup.line_of(solver.solve(torch.tensor([impedance], dtype=torch.complex128))), solver


def test_the_impedance_that_made_the_pressures_comes_back():
    """Both frequencies, to rounding, with the amplitude of the incident wave."""
    line, solver = solved()
    found = fit_field(line, solver)
    assert bool(found.converged.all())
    assert float((found.impedance - TRUE).abs().max()) < 1e-8
    assert float((found.amplitude / solver.case.incident - 1).abs().max()) < 1e-8
    assert float(found.misfit.max()) < 1e-12
    assert float((found.pressure - line.pressure).abs().max()) < 1e-6
    line, solver = solved(profile="tanh")  # where both walls' conditions are one, frequencies share constants
    assert float((fit_field(line, solver, start=1.5).impedance - TRUE).abs().max()) < 1e-7


def test_both_sides_give_one_impedance_where_one_mode_does_not():
    fits, modes = [], []
    for side in ("upstream", "downstream"):
        line, solver = solved(side)
        fits.append(complex(fit_field(line, solver).impedance[1]))
        modes.append(complex(kumaresan_tufts(line).impedance[1]))
    assert abs(fits[0] - fits[1]) < 1e-7
    assert abs(modes[0] - modes[1]) > 0.1


def test_a_duct_that_is_not_the_measured_one_says_so():
    """An end that reflects, unknown to the model: the misfit is far above the errors."""
    _, blind = solved()
    line, _ = solved(end_reflection=(0.2, 0.0))
    with pytest.warns(tl.DataWarning, match=r"at 2 of 2 values, .* the residuals are .* times the .* stated"):
        found = fit_field(line, blind, far_end="stated", start=2.0)
    assert float(found.misfit.min()) > 3


@pytest.mark.parametrize("side", ["upstream", "downstream"])
@pytest.mark.parametrize("reflection", [(0.0, 0.0), (0.3, -0.2)])
def test_a_fitted_far_end_needs_no_knowledge_of_it(side, reflection):
    """Z comes back, and with it what the end reflects; what the source's end reflects is part of the amplitude."""
    _, blind = solved(side)
    line, _ = solved(side, end_reflection=reflection, source_reflection=(0.1, 0.4))
    found = fit_field(line, blind, start=1.0)
    assert float((found.impedance - TRUE).abs().max()) < 1e-7
    assert float((found.end_reflection - complex(*reflection)).abs().max()) < 1e-7
    assert float(found.residual.max()) < 1e-9


@doubtful
@pytest.mark.parametrize("wall", [0.0, 1e-3, 0.05 - 0.2j, 50.0, 0.05 - 8j, 0.3 + 0.9j])
def test_walls_at_the_ends_of_the_range(wall):
    line, solver = solved(impedance=wall, frequency=(1500.0,))
    with warnings.catch_warnings():
        warnings.simplefilter("error", tl.DataWarning)
        warnings.filterwarnings("ignore", ".*a wave of its shear layer grows")  # of the wall found
        found = fit_field(line, solver)
    assert abs(complex(found.impedance[0]) - wall) < 1e-6 * (1 + abs(wall))


@pytest.mark.parametrize(
    ("change", "options", "match"),
    [
        ({}, {"microphones": 2, "far_end": "stated"}, "2 microphones are too few for 2 complex unknowns"),
        ({}, {"microphones": 3}, "3 microphones are too few for 3 complex unknowns"),
        ({"mach": 0.1}, {}, r"mach is 0\.1, of the duct 0\.3"),
        ({"liner_end": 0.14}, {}, r"liner_end \(m\) is 0\.14, of the duct 0\.15"),
        ({"source_side": "unknown"}, {}, "source_side is 'unknown'"),
        ({"frequency": [900.0, 1600.0]}, {}, r"\[900\.0, 1600\.0\] Hz, of the duct"),
        ({}, {"level_error": 0.0}, r"level_error is 0; .*0\.0001"),
        ({}, {"far_end": "open"}, "far_end 'open'.*fitted, stated"),
    ],
)
def test_bad_lines_are_refused(change, options, match):
    line, solver = solved()
    count = options.pop("microphones", line.microphones)
    with pytest.raises(ValueError, match=match):
        fit_field(dataclasses.replace(line, **change).select(range(count)), solver, **options)


def test_the_stated_error_is_the_scatter_of_draws():
    """Laplace against 80 draws: deviations within a quarter (three of their errors), means within three."""
    line, solver = solved(frequency=(1500.0,))
    found = fit_field(line, solver, draws=80)
    assert bool(found.draws.converged.all())
    drawn = found.draws.impedance
    for part in ("real", "imag"):
        wide = getattr(drawn, part).std(0)
        assert torch.allclose(wide, getattr(dataclasses.replace(found, draws=None).deviation, part), rtol=0.25)
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
    assert bool(found.draws.converged.all())
    assert float(found.impedance.abs()) > 1900
    assert dataclasses.replace(found, draws=None).deviation.tolist() == [complex(math.inf, math.inf)]


def test_the_misfit_of_a_right_model_is_chi_squared():
    """Kolmogorov and Smirnov's test on draws around the truth."""
    line, solver = solved(frequency=(1500.0,))
    found = fit_field(line, solver, draws=150)
    freedom = 2 * (18 - 3)
    value = found.draws.misfit[:, 0].numpy() * freedom
    assert scipy.stats.kstest(value, "chi2", args=(freedom,)).pvalue > 0.01
    assert (value > scipy.stats.chi2.ppf(0.99, freedom)).mean() < 0.04


def rosenbrock(steepness):
    """(1 - x)^2 + a (y - x^2)^2, of least cost 0 at (1, 1), for one a each."""

    def system(place, index):
        x, y = place.unbind(-1)
        a = steepness[index].sqrt()
        still = torch.zeros_like(x)
        rows = [torch.stack([still - 1, still], -1), torch.stack([-2 * a * x, a], -1)]
        residual = torch.stack([1 - x, a * (y - x**2)], -1)
        return residual, torch.stack(rows, -2), still[..., None]

    return functools.partial(least_squares, system, longest=0.5)


STEEP = torch.tensor([1.0, 10.0, 100.0, 300.0], dtype=torch.float64)
START = torch.tensor([[-1.2, 1.0], [2.0, -3.0], [-1.2, 1.0], [0.0, 0.0]], dtype=torch.float64)


def test_valleys_are_followed_to_their_ends():
    found = rosenbrock(STEEP)(START)
    assert bool(found.converged.all())
    assert float((found.place - 1).abs().max()) < 1e-9
    assert float(found.cost.max()) < 1e-18
    assert START[0].tolist() == [-1.2, 1.0]  # starts are left as they are


def test_batch_is_the_loop():
    together = rosenbrock(STEEP)(START, steps=12)
    for i in range(4):
        alone = rosenbrock(STEEP[i : i + 1])(START[i : i + 1], steps=12)
        assert torch.equal(alone.place[0], together.place[i])
        assert bool(alone.converged[0]) == bool(together.converged[i])
    assert together.converged.tolist() != [True] * 4  # some had not got there


def test_a_quadratic_takes_one_step():
    """Without damping the step is that of linear least squares, real and complex."""
    generator = torch.Generator().manual_seed(0)
    for dtype in (torch.float64, torch.complex128):
        matrix, right = (torch.randn(5, 7, n, dtype=dtype, generator=generator) for n in (3, 1))
        step = damped_step(-right[..., 0], matrix, torch.zeros(5, dtype=torch.float64))
        wanted = torch.linalg.lstsq(matrix, right).solution[..., 0]
        assert torch.allclose(step, wanted, atol=1e-12)


def test_holomorphic_residuals():
    """z^2 = c over complex numbers, and a second unknown that changes nothing."""
    squares = torch.tensor([2j, -1 + 0j, 0.25 + 0j], dtype=torch.complex128)
    start = torch.tensor([[1.5 + 0.5j, 3j], [0.1 + 2j, 0], [1, 1]], dtype=torch.complex128)

    def system(place, index):
        z = place[..., :1]
        jacobian = torch.cat([2 * z, torch.zeros_like(z)], -1)[..., None, :]
        return z**2 - squares[index][:, None], jacobian, z

    found = least_squares(system, start)
    assert bool(found.converged.all())
    assert torch.allclose(found.place[:, 0], squares.sqrt(), atol=1e-12)
    assert torch.equal(found.place[:, 1:], start[:, 1:])


def test_of_several_minima_the_least_is_kept_each():
    ends = rosenbrock(STEEP)(START), rosenbrock(STEEP)(START, steps=1)
    lost = ends[1]._replace(residual=ends[1].residual * math.nan)
    for several in (ends, ends[::-1], (lost, *ends)):
        assert torch.equal(best_of(several).place, ends[0].place)
    mixed = best_of([ends[1], ends[0]._replace(residual=ends[0].residual + torch.tensor([[0.0], [9e9], [0], [0]]))])
    assert torch.equal(mixed.place[1], ends[1].place[1])


def test_what_has_no_way_is_given_up():
    """Steps that cannot be taken end in damping, not in convergence."""
    found = rosenbrock(STEEP)(START, lambda place, step, index: (place + step, index > 0))
    assert found.converged.tolist() == [False, True, True, True]
    assert torch.equal(found.place[0], START[0])


@pytest.mark.parametrize("longest", [0.05, 0.5])
def test_steps_are_no_longer_than_allowed(longest):
    taken = []
    rosenbrock(STEEP)(START, lambda at, step, _: (at + step, taken.append(step) is None), longest=longest, steps=8)
    largest = max(float(step.norm(dim=-1).max()) for step in taken)
    assert largest == pytest.approx(longest, rel=1e-12)
    assert math.isfinite(largest)
