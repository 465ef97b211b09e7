"""Cases, meshes and walls of a duct: what is refused, what is doubted, and in which words."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

import torchliner as tl
from torchliner.duct.case import DuctCase
from torchliner.duct.flow_profiles import UniformProfile
from torchliner.duct.mesh import DuctMesh, build_mesh
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
        ({"liner": (0.0, 0.4)}, r"from x = 0 to 0\.4 m .* 0\.35 m, the duct's end"),
        ({"liner": (0.1, 0.0)}, r"from x = 0\.1 to 0 m must have a length"),
        ({"liner": [(0.0, 0.1), (0.05, 0.15)]}, r"from x = 0\.05 to 0\.15 m .* between 0\.1 m"),
        ({"liner": 0.15}, r"liner is 0\.15; it must be \(start, end\) in m"),
        ({"source": "left"}, "unknown source 'left'"),
        ({"slip_condition": "myers"}, "unknown slip condition 'myers'"),
        ({"incident": complex(1, math.inf)}, r"incident is \(1\+infj\)"),
        ({"source_reflection": torch.tensor([0.1, math.inf])}, r"source_reflection is tensor\(\["),
    ],
)
def test_cases_refused(about, match):
    with pytest.raises(ValueError, match=match):
        case_of(**about)


X, Y = np.array([-0.2, 0.0, 0.15, 0.35]), np.array([0.0, 0.02, 0.05])


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"degree": 0}, "degree is 0; it must be finite and above 0"),
        ({"y": Y[:1]}, "mesh y must be edges that increase"),
        ({"x": X[:3]}, r"mesh x must be .* from -0\.2 to 0\.35 m"),
        ({"x": X[[0, 2, 3]]}, r"edge at x = 0 m lies inside a column; make it an edge"),
    ],
)
def test_meshes_refused(change, match):
    with pytest.raises(ValueError, match=match):
        DuctMesh(**{"case": case_of(), "x": X, "y": Y, "degree": 2, **change})


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
    with pytest.warns(tl.DataWarning, match=r"at 3600 Hz mode 1 runs too: its cut-on is about 3272 Hz"):
        solve_duct(case_of(profile=PLUG, liner=()), [1500.0, 3600.0])


def test_near_ends_are_named():
    """Mode 1 decays by sqrt((pi/H)^2 - k^2): 56.5 1/m at 1500 Hz, without flow."""
    share = math.exp(-0.05 * math.sqrt((math.pi / 0.05) ** 2 - (2 * math.pi * 1500 / SPEED) ** 2))
    said = rf"50 mm from the upstream end: at 1500 Hz {100 * share:.2g} % .* at least 111 mm beyond"
    with pytest.warns(tl.DataWarning, match=said):
        DuctSolver(case_of(start=-0.05), FREQUENCY)
    with pytest.warns(tl.DataWarning, match="50 mm from the downstream end"):
        DuctSolver(case_of(end=0.2), FREQUENCY)


@pytest.mark.parametrize(
    ("impedance", "match"),
    [
        (math.nan, "impedance is nan or -1"),
        (torch.ones(2, 2, 1), r"shape \(2, 2, 1\); its last two axes must fit \(1, 1\)"),
        (
            lambda x, f: torch.ones(len(x) + 1),
            r"shape \(121,\); its last two axes must fit \(1, 120\): frequencies and places",
        ),
    ],
)
def test_walls_refused(impedance, match):
    solver = DuctSolver(case_of(), FREQUENCY)
    with pytest.raises(ValueError, match=match):
        solver.solve(impedance)


def test_resonance_is_singular():
    """Two ends that reflect everything, a whole number of half waves apart."""
    length = 0.55
    frequency = 4 * SPEED / (2 * length)
    closed = case_of(liner=(), end_reflection=1.0, source_reflection=1.0)
    mesh = build_mesh(closed, frequency, degree=8, column=0.02)
    with pytest.raises(RuntimeError, match=r"singular: their solution leaves a residual of .* of"):
        solve_duct(closed, frequency, mesh=mesh)


def test_the_solver_says_what_it_lacks():
    said = r"slips along the lined wall at Mach 0\.3; say which .*'ingard-myers'.*'continuous-velocity'"
    with pytest.raises(ValueError, match=said):
        DuctSolver(case_of(profile=PLUG), FREQUENCY)
    case = case_of()
    with pytest.raises(ValueError, match="built for another DuctCase"):
        DuctSolver(case, FREQUENCY, build_mesh(case_of(), FREQUENCY))
    field = solve_duct(case, FREQUENCY, B2A)
    for call, match in (
        (lambda: field.at([0.0, 0.36], 0.01), r"x = 0\.36 m lies outside the duct, -0\.2 to 0\.35 m"),
        (lambda: field.at(0.0, 0.06), r"y = 0\.06 m lies outside the duct, 0 to 0\.05 m"),
        (lambda: field.wall_pressure(0.0, "upper"), "wall 'upper'"),
    ):
        with pytest.raises(ValueError, match=match):
            call()
    with pytest.warns(tl.DataWarning, match=r"end_reflection has a modulus of 1.3, above 1"):
        case_of(end_reflection=torch.tensor([0.5, 1.3j]))
