"""Cases, meshes and walls of a duct: what is refused, what is doubted, and in which words."""

from __future__ import annotations

import math
import re
import warnings

import numpy as np
import pytest
import torch

import torchliner as tl
from torchliner.duct import sweep as lee_sweep
from torchliner.duct.case import DuctCase
from torchliner.duct.flow_profiles import TanhProfile, UniformProfile
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.modes import cut_on_frequency
from torchliner.duct.solver import DuctSolver, solve_duct

HEIGHT, SPEED, FREQUENCY = 50e-3, 343.0, 1500.0
STILL, PLUG = UniformProfile(0.0, HEIGHT, SPEED), UniformProfile(0.3, HEIGHT, SPEED)
B2A = 2.33 - 0.30j


def case_of(**about):
    about = {"profile": STILL, "start": -0.2, "end": 0.35, "liner": (0.0, 0.15), **about}
    return DuctCase(**about)


@pytest.mark.parametrize(
    ("about", "match"),
    [
        ({"end": -0.3}, r"duct length, end - start \(m\) is -0\.1"),
        ({"end": math.nan}, "end is nan; it must be finite"),
        (
            {"liner": (0.0, 0.4)},
            r"from x = 0 to 0\.4 m lies outside the duct, -0\.2 to 0\.35 m; move its edges",
        ),
        ({"liner": (0.1, 0.0)}, r"from x = 0\.1 to 0 m has the length -0\.1 m; it must be above 0"),
        ({"liner": [(0.0, 0.1), (0.05, 0.15)]}, r"overlap: one ends at x = 0\.1 m, .* at 0\.05 m"),
        ({"liner": 0.15}, r"liner is 0\.15; it must be \(start, end\) in m"),
        ({"source": "left"}, "unknown source 'left'"),
        ({"density": 0.0}, "density .* is 0"),
        ({"slip_condition": "myers"}, "unknown slip condition 'myers'"),
        ({"incident": complex(1, math.inf)}, r"incident is \(1\+infj\)"),
        ({"source_reflection": torch.tensor([0.1, math.inf])}, r"source_reflection is tensor\(\["),
    ],
)
def test_cases_refused(about, match):
    with pytest.raises(ValueError, match=match):
        case_of(**about)


@pytest.mark.parametrize("name", ["end_reflection", "source_reflection"])
def test_ends_that_gain_are_doubted(name):
    with pytest.warns(tl.DataWarning, match=f"{name} has a modulus of 1.3, above 1: such an end"):
        case_of(**{name: torch.tensor([0.5, 1.3j])})
    case_of(**{name: np.exp(0.3j)})  # quiet


X, Y = np.array([-0.2, 0.0, 0.15, 0.35]), np.array([0.0, 0.02, 0.05])


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"degree": 0}, "degree is 0; it must be finite and above 0"),
        ({"x": X[::-1]}, "mesh x must be a list of increasing edges"),
        ({"y": Y[:1]}, "mesh y must be a list of increasing edges"),
        ({"x": X[:3]}, r"mesh x runs from -0\.2 to 0\.15 m, the duct from -0\.2 to 0\.35 m"),
        ({"x": X[[0, 2, 3]]}, r"edge at x = 0 m lies inside a column; make it an edge"),
    ],
)
def test_meshes_refused(change, match):
    with pytest.raises(ValueError, match=match):
        DuctMesh(**{"case": case_of(), "x": X, "y": Y, "degree": 2, **change})


def test_meshes_built():
    """Edges of the liner are met, cells grow to the wanted size, equal widths are one width."""
    case = case_of(profile=TanhProfile(0.3, HEIGHT, 0.1, SPEED), liner=[(0.0, 0.031), (0.05, 0.15)])
    mesh = build_mesh(case, FREQUENCY)
    for edge in (-0.2, 0.0, 0.031, 0.05, 0.15, 0.35):
        assert np.abs(mesh.x - edge).min() < 1e-12
    rows = np.diff(mesh.y)
    assert rows[0] == pytest.approx(0.5e-3)
    assert rows.max() <= 0.01 + 1e-12
    assert rows == pytest.approx(rows[::-1], rel=1e-9)
    assert np.diff(mesh.x).max() <= 0.01 + 1e-12
    assert len(np.unique(mesh.widths)) < 0.5 * len(mesh.widths)
    assert mesh.widths == pytest.approx(np.diff(mesh.x), rel=1e-9)
    assert mesh.lined_widths.sum() == pytest.approx(0.131)
    assert mesh.unknowns == 75 * len(mesh.widths) * len(rows)
    assert build_mesh(case, 20e3).unknowns > 2 * build_mesh(case, FREQUENCY).unknowns


@pytest.mark.parametrize("size", [-1e-3, math.nan])
@pytest.mark.parametrize("name", ["frequency", "column", "row", "wall_cell"])
def test_sizes_that_make_no_mesh(name, size):
    """Doubling from 0 or below would never end."""
    with pytest.raises(ValueError, match=rf"mesh {name} \((m|Hz)\) is {size:g}; it must be finite"):
        build_mesh(case_of(), **{"frequency": FREQUENCY, name: size})


def test_coarse_meshes_are_named():
    """The shortest wave is the one against the flow; a fine mesh is quiet."""
    case = case_of(profile=PLUG, slip_condition="continuous-velocity")
    mesh = DuctMesh(case, np.linspace(-0.2, 0.35, 12), Y, 4)
    mesh.warn_if_coarse(FREQUENCY)  # quiet
    with pytest.warns(tl.DataWarning, match=r"2900 Hz: 8\.28 points per wavelength .* below 9 for"):
        mesh.warn_if_coarse(2900.0)
    with pytest.warns(tl.DataWarning, match="800 Hz: 12 points per wavelength .* below 30 for degree 1"):
        DuctSolver(case, 800.0, DuctMesh(case, mesh.x, Y, 1))


def test_cut_on_modes_are_named():
    with pytest.warns(tl.DataWarning, match=r"at 3600 Hz mode 1 runs too: its cut-on is 3272 Hz"):
        solve_duct(case_of(profile=PLUG, liner=()), [1500.0, 3600.0])


def test_a_frequency_at_cut_on_is_solved():
    """Mode 1 has a double wavenumber there; the ends need mode 0 alone."""
    sheared = TanhProfile(0.3, HEIGHT, 0.1, SPEED)
    with pytest.warns(tl.DataWarning, match="mode 1 runs too"):
        field = solve_duct(case_of(profile=sheared, liner=()), cut_on_frequency(sheared))
    assert float(field.transmission.abs()) == pytest.approx(1, abs=1e-4)


def test_near_ends_are_named():
    """Mode 1 decays by sqrt((pi/H)^2 - k^2): 56.5 1/m at 1500 Hz, without flow."""
    share = math.exp(-0.05 * math.sqrt((math.pi / 0.05) ** 2 - (2 * math.pi * 1500 / SPEED) ** 2))
    said = rf"50 mm from the upstream end: at 1500 Hz {100 * share:.2g} % .* at least 111 mm beyond"
    with pytest.warns(tl.DataWarning, match=said):
        DuctSolver(case_of(start=-0.05), FREQUENCY)
    with pytest.warns(tl.DataWarning, match="50 mm from the downstream end"):
        DuctSolver(case_of(end=0.2), FREQUENCY)


def test_ends_are_near_just_below_cut_on():
    """M 0.3, 3200 Hz, cut-on 3274 Hz: 14 1/m in place of the 63 1/m at low frequency, so a fifth of
    mode 1 is left after 120 mm. Cut-on frequencies in the same list change nothing."""
    profile = UniformProfile(0.3, HEIGHT)
    case = DuctCase(profile, -0.12, 0.27, (0.0, 0.15), slip_condition="ingard-myers")
    with pytest.warns(tl.DataWarning, match=r"lies 120 mm .* at 3200 Hz 19 % of mode 1"):
        DuctSolver(case, 3200.0)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        DuctSolver(case, [900.0, 3200.0, 3600.0])
    near, runs = (str(one.message) for one in told)
    assert "at 3200 Hz 19 % of mode 1" in near
    assert "at 3600 Hz mode 1 runs too" in runs
    assert {one.filename for one in told} == {__file__}
    DuctSolver(case, 1500.0)  # quiet
    b2a = tl.load_duct("b2a")
    DuctSolver(b2a.case, b2a.frequency)  # quiet


@pytest.mark.parametrize(
    ("impedance", "match"),
    [
        (math.nan, "impedance is nan; a hard wall is inf"),
        (-1.0, "impedance is -1, a wall that sends waves"),
        (torch.ones(2, 2, 1), r"shape \(2, 2, 1\); its last two axes must fit \(1, 1\)"),
        (
            lambda x, f: torch.ones(len(x) + 1),
            r"shape \(121,\); its last two axes must fit \(1, 120\): frequencies, places",
        ),
    ],
)
def test_walls_refused(impedance, match):
    solver = DuctSolver(case_of(), FREQUENCY)
    with pytest.raises(ValueError, match=match):
        solver.solve(impedance)


def test_slip_needs_a_condition():
    said = r"slips along the lined wall at Mach 0\.3; say which .*'ingard-myers'.*'(.*)'"
    with pytest.raises(ValueError, match=said) as refused:
        DuctSolver(case_of(profile=PLUG), FREQUENCY)
    remedy = re.search(said, str(refused.value)).group(1)
    DuctSolver(case_of(profile=PLUG, slip_condition=remedy), FREQUENCY)
    DuctSolver(case_of(profile=PLUG, liner=()), FREQUENCY)


def test_solver_refusals():
    case = case_of()
    with pytest.raises(ValueError, match="frequency"):
        DuctSolver(case, math.inf)
    with pytest.raises(ValueError, match="built for another DuctCase"):
        DuctSolver(case, FREQUENCY, build_mesh(case_of(), FREQUENCY))
    field = solve_duct(case, FREQUENCY, B2A)
    with pytest.raises(ValueError, match=r"x = 0\.36 m lies outside the duct, -0\.2 to 0\.35 m"):
        field.at([0.0, 0.36], 0.01)
    with pytest.raises(ValueError, match=r"y = 0\.06 m lies outside the duct, 0 to 0\.05 m"):
        field.at(0.0, 0.06)
    with pytest.raises(ValueError, match=r"x = -1 m lies outside"):
        field.wall_pressure(-1.0)
    with pytest.raises(ValueError, match="unknown wall 'upper'"):
        field.wall_pressure(0.0, "upper")


def test_memory_is_what_is_kept(monkeypatch):
    """The guard's bytes are those of the tensors; one frequency is swept at a time."""
    monkeypatch.setattr(lee_sweep, "AT_ONCE", 1)
    case, frequency = case_of(), [800.0, 1000.0, 1200.0]
    mesh = build_mesh(case, 1200.0, degree=2)
    swept = DuctSolver(case, frequency, mesh).swept
    _, _, waves = next(swept.sweeps())
    held = [swept.upper, swept.lower, swept.reading[:, :-2], *waves]
    size = sum(t.numel() * t.element_size() for t in held)
    DuctSolver(case, frequency, mesh, memory=1.01 * size)
    with pytest.raises(
        ValueError, match=r"waves of \d+ unknowns take .* GB for 3 frequencies, above .*; take fewer freq"
    ):
        DuctSolver(case, frequency, mesh, memory=0.97 * size)


def test_resonance_is_singular():
    """Two ends that reflect everything, a whole number of half waves apart."""
    length = 0.55
    frequency = 4 * SPEED / (2 * length)
    closed = case_of(liner=(), end_reflection=1.0, source_reflection=1.0)
    mesh = build_mesh(closed, frequency, degree=8, column=0.02)
    with pytest.raises(RuntimeError, match=r"singular: their solution leaves a residual of .* of"):
        solve_duct(closed, frequency, mesh=mesh)
