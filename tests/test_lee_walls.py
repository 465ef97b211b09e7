"""What the Euler solver is asked for: walls, ends, sources, batches, gradients, types."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch
from test_lee import B2A, BOTH, FREQUENCY, PLUG, SPEED, STILL, TANH, VELOCITY, case_of, solve

from torchliner.duct import solver as lee_solver
from torchliner.duct import sweep as lee_sweep
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.modes import duct_modes
from torchliner.duct.solver import DuctSolver, solve_duct

# Soft walls under this flow: a wave grows, which does not matter to the claim.
GROWS = pytest.mark.filterwarnings("ignore:at .* times the energy that comes in goes out")
# Fine enough for sound, where the claim is not about the layer of the flow.
COARSE = {"frequency": FREQUENCY, "column": 0.025, "row": 0.0125, "wall_cell": 2e-3}


def test_wall_traces_meet_the_walls_law():
    """p* = Z rho c v* on the liner, v* = 0 on rigid parts, to rounding, with shear and without."""
    for profile in (STILL, TANH):
        field = solve(profile=profile, liner=[(0.0, 0.06), (0.09, 0.15)], impedance=[B2A, 0.5j])
        x = np.array([0.013, 0.031, 0.1, 0.14])
        p, v = field.wall_pressure(x, "lined")[0], 1.204 * SPEED * field.wall_velocity(x)[0]
        wall = torch.tensor([B2A, B2A, 0.5j, 0.5j], dtype=torch.complex128)
        assert float((p - wall * v).abs().max()) < 1e-11
        assert float(field.wall_velocity([-0.1, 0.07, 0.3]).abs().max()) == 0


@GROWS
def test_walls_at_the_ends_of_the_range():
    """Infinite Z, in any spelling, is no liner; 0 has p* = 0; large and small ones tend to them."""
    x = np.linspace(-0.2, 0.35, 23)
    for profile in (STILL, TANH):
        bare, mesh = case_of(profile, ()), build_mesh(case_of(profile), **COARSE)
        none = solve_duct(bare, FREQUENCY, mesh=DuctMesh(bare, mesh.x, mesh.y)).wall_pressure(x)
        # Its wave has amplitude 1 at the duct's end, that of the others at the liner's edge, x = 0.
        none = none * torch.exp(-1j * duct_modes(profile, FREQUENCY, count=1).wavenumber[0, 0] * bare.start)
        for hard in (math.inf, complex(0, -math.inf), complex(math.inf, math.nan), 1e13):
            found = solve(hard, profile=profile, mesh_options=COARSE).wall_pressure(x)
            assert float((found - none).abs().max()) < 1e-9
        soft = solve(0.0, profile=profile, mesh_options=COARSE)
        assert float(soft.wall_pressure([0.01, 0.07], "lined").abs().max()) < 1e-11
        nearly = solve(1e-10, profile=profile, mesh_options=COARSE)
        assert float((soft.wall_pressure(x) - nearly.wall_pressure(x)).abs().max()) < 1e-6


def test_walls_that_vary_along_the_liner():
    """A constant function is the constant; patches tend to Z(x) with the square of their size."""
    case, about = case_of(TANH), {"column": 0.15 / 16, "row": 0.0125, "wall_cell": 2e-3}
    mesh = build_mesh(case, FREQUENCY, **about)
    solver = DuctSolver(case, FREQUENCY, mesh)
    x = np.linspace(-0.2, 0.35, 23)

    def wall(places, frequency):
        return (1 + 10 * places + 1j * torch.cos(20 * places)).expand(len(frequency), -1)

    constant = solver.solve(lambda places, f: torch.full((1, len(places)), B2A, dtype=torch.complex128))
    assert float((constant.wall_pressure(x) - solver.solve(B2A).wall_pressure(x)).abs().max()) < 1e-12
    wanted = solver.solve(wall).wall_pressure(x)
    errors = []
    for count in (4, 8, 16):
        edges = np.linspace(0, 0.15, count + 1)
        middles = torch.as_tensor((edges[1:] + edges[:-1]) / 2)
        stepped = case_of(TANH, list(itertools.pairwise(edges)))
        fine = build_mesh(stepped, FREQUENCY, **about)
        found = solve_duct(stepped, FREQUENCY, wall(middles, [0]), fine).wall_pressure(x)
        errors.append(float((found - wanted).abs().max()))
    assert errors[1] / errors[2] > 3
    assert errors[2] < 1e-3


@pytest.mark.parametrize("profile", [PLUG, TANH], ids=["plug", "tanh"])
@pytest.mark.parametrize("source", BOTH)
def test_given_end_reflections(source, profile):
    """Rigid duct, M 0.3: two modes with the amplitudes of the geometric series, to 3e-6."""
    far, near = 0.4 - 0.2j, 0.3j
    field = solve(profile=profile, liner=(), source=source, end_reflection=far, source_reflection=near)
    numbers = [
        abs(complex(duct_modes(profile, FREQUENCY, count=1, direction=d).wavenumber))
        for d in ("downstream", "upstream")
    ]
    out, back = numbers if source == "upstream" else numbers[::-1]
    length, start = 0.65, (-0.25 if source == "upstream" else 0.4)
    x = np.linspace(-0.25, 0.4, 9)
    s = np.abs(x - start)
    wave = np.exp(-1j * out * s) + far * np.exp(-1j * out * length - 1j * back * (length - s))
    wave /= 1 - near * far * np.exp(-1j * (out + back) * length)
    assert np.abs(field.wall_pressure(x)[0].numpy() - wave).max() < 3e-6
    assert abs(complex(field.transmission) - np.exp(-1j * out * length)) < 3e-6
    assert abs(complex(field.reflection) - far * np.exp(-1j * (out + back) * length)) < 3e-6


@GROWS
def test_batch_is_the_loop(monkeypatch):
    """Over frequencies, walls and patches, in one part and in many."""
    case = case_of(TANH, [(0.0, 0.05), (0.05, 0.15)])
    mesh = build_mesh(case, 2000.0, degree=2, column=0.02)
    frequency, x = [900.0, 1500.0, 2000.0], np.array([-0.1, 0.02, 0.3])
    generator = torch.Generator().manual_seed(0)
    walls = torch.rand(4, 3, 2, generator=generator, dtype=torch.float64) * (1 + 0.5j) + 0.2
    wanted = DuctSolver(case, frequency, mesh).solve(walls)
    monkeypatch.setattr(lee_solver, "CHUNK", 1)
    monkeypatch.setattr(lee_sweep, "AT_ONCE", 1)
    parts = DuctSolver(case, frequency, mesh).solve(walls)
    assert torch.allclose(parts.waves, wanted.waves, rtol=0, atol=1e-13)
    for i, f in ((0, 0), (3, 2), (2, 1)):
        one = solve_duct(case, frequency[f], walls[i, f], mesh)
        for wall in ("opposite", "lined"):
            p = one.wall_pressure(x, wall)[0]
            for field in (wanted, parts):
                assert torch.allclose(field.wall_pressure(x, wall)[i, f], p, rtol=0, atol=1e-12)
        for field in (wanted, parts):
            for found, expected in zip(field.at(x, 0.01), one.at(x, 0.01), strict=True):
                assert torch.allclose(found[i, f], expected[0], rtol=0, atol=1e-12)


def test_one_solver_serves_both_sources():
    """Also with ends that reflect, which belong to the source and to the far end."""
    about = {"end_reflection": 0.3j, "source_reflection": -0.2}
    cases = [case_of(TANH, source=source, **about) for source in BOTH]
    x = np.linspace(-0.2, 0.35, 7)
    solver = DuctSolver(cases[0], FREQUENCY)
    for case in cases:
        wanted = solve_duct(case, FREQUENCY, B2A)
        found = solver.solve(B2A, source=case.source)
        assert torch.allclose(found.wall_pressure(x), wanted.wall_pressure(x), rtol=0, atol=1e-12)
        assert torch.allclose(found.reflection, wanted.reflection, rtol=0, atol=1e-12)


@pytest.mark.parametrize("condition", ["ingard-myers", VELOCITY])
def test_gradients(condition):
    """Pressures, velocities, levels and R by Z, and by what a function of x is made of."""
    case = case_of(PLUG, [(0.0, 0.05), (0.05, 0.1)], slip_condition=condition)
    mesh = build_mesh(case, 1500.0, degree=2, column=0.05, row=0.025)
    with pytest.warns(UserWarning, match="the mesh is coarse"):
        solver = DuctSolver(case, [1000.0, 1500.0], mesh)
    walls = torch.tensor([[[B2A, 0.4 - 1j]], [[0.1, 1.0]]], dtype=torch.complex128, requires_grad=True)

    def outputs(z):
        field = solver.solve(z)
        x = [-0.1, 0.03, 0.2]
        return *field.at(x, 0.02), field.wall_level(x), field.wall_velocity(x), field.reflection

    assert torch.autograd.gradcheck(outputs, (walls,), eps=1e-6, atol=1e-6)
    slope = torch.tensor([1.0, -0.3], dtype=torch.float64, requires_grad=True)

    def varying(s):
        return solver.solve(lambda x, f: (s[0] + 10 * x + 1j * s[1]).expand(len(f), -1)).reflection

    assert torch.autograd.gradcheck(varying, (slope,), eps=1e-6, atol=1e-6)
