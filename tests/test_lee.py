"""The Euler solver against exact modes, other methods and the laws of a duct."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch

from oracles.mode_matching import match_modes
from torchliner.duct.case import DuctCase
from torchliner.duct.flow_profiles import ParabolicProfile, TanhProfile, UniformProfile
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.modes import duct_modes
from torchliner.duct.solver import solve_duct
from verify_duct import exact_mode_error, order_table

VELOCITY = "continuous-velocity"
HEIGHT, SPEED, FREQUENCY = 50e-3, 343.0, 1500.0
B2A = 2.33 - 0.30j
K = 2 * math.pi * FREQUENCY / SPEED
LINER = (0.0, 0.15)
BOTH = ("upstream", "downstream")
STILL = UniformProfile(0.0, HEIGHT, SPEED)
PLUG = UniformProfile(0.3, HEIGHT, SPEED)
TANH = TanhProfile(0.3, HEIGHT, 0.1, SPEED)


def case_of(profile=STILL, liner=LINER, start=-0.25, end=0.4, **about):
    return DuctCase(profile, start, end, liner, **about)


def solve(impedance=B2A, frequency=FREQUENCY, mesh_options=None, **about):
    case = case_of(**about)
    mesh = build_mesh(case, **{"frequency": float(np.max(frequency)), **(mesh_options or {})})
    return solve_duct(case, frequency, impedance, mesh)


@pytest.mark.parametrize("direction", ["downstream", "upstream"])
@pytest.mark.parametrize("flow", ["no flow", "sheared"])
def test_order_of_accuracy(flow, direction):
    """p + 1 against an exact lined mode; less, by 0.7 at most, where M' is not yet resolved."""
    coarse, fine = ((8, 4), (16, 8)), ((16, 8), (32, 16))
    short = {4: 0.7 if direction == "upstream" else 0.6}  # p = 4 on 16 x 8: 4.32 and 4.55
    for degree, meshes in ((1, fine), (2, fine), (3, coarse), (4, coarse)):
        row = order_table(flow, (degree,), meshes, direction)[1]
        if flow == "no flow":
            assert row["order"] == pytest.approx(degree + 1, abs=0.05)
        assert degree + 1 - short.get(degree, 0.25) < row["order"] < degree + 1.05
        assert row["unknowns"] == 3 * (degree + 1) ** 2 * math.prod(meshes[1])


def test_ninth_digit():
    """No flow, degree 4, 32 x 16 elements over 150 x 50 mm: 1e-9 of p."""
    assert exact_mode_error(STILL, 4, 32, 16)[0] < 1e-9


@pytest.mark.parametrize("impedance", [B2A, 0.3 - 0.6j, 0.05 + 0.8j])
def test_mode_matching_without_flow(impedance):
    """1e-4 on the opposite wall; R and T too. 200 modes, whose own error is below 1e-5."""
    x = np.linspace(-0.24, 0.39, 64)
    wanted = match_modes(HEIGHT, LINER, FREQUENCY, impedance, sound_speed=SPEED, modes=200)
    found = solve(impedance)
    assert np.abs(found.wall_pressure(x)[0].numpy() - wanted.fields(x, HEIGHT)[0]).max() < 1e-4
    away = np.abs(x[:, None] - LINER).min(1) > 0.01
    units = (1, 1.204 * SPEED, 1.204 * SPEED)
    for field, unit, part in zip(found.at(x, 0.02), units, wanted.fields(x, 0.02), strict=True):
        assert np.abs(field[0].numpy() * unit - part)[away].max() < 1e-3
    length = np.exp(-1j * K * 0.25)  # from the duct's ends to the liner's edges
    assert abs(complex(found.transmission) - wanted.transmission * length**2) < 1e-4
    assert abs(complex(found.reflection) - wanted.reflection * length**2) < 1e-4


@pytest.mark.parametrize("source", BOTH)
@pytest.mark.parametrize("name", ["sheared", "ingard-myers", VELOCITY])
def test_field_above_the_liner_is_one_of_six_modes(name, source):
    """Six modes each way by collocation, amplitudes by least squares: wall pressure to 1e-4."""
    profile, condition = (TANH, None) if name == "sheared" else (PLUG, name)
    field = solve(profile=profile, source=source, slip_condition=condition)
    x = np.linspace(*LINER, 152)[1:-1]
    p = field.wall_pressure(x)[0].numpy()

    def left_by(impedance):
        columns = []
        for direction, start in (("downstream", LINER[0]), ("upstream", LINER[1])):
            about = {"direction": direction, "slip_condition": condition}
            alpha = duct_modes(profile, FREQUENCY, impedance, **about).wavenumber[0].numpy()
            columns.append(np.exp(-1j * alpha * (x[:, None] - start)))
        matrix = np.concatenate(columns, 1)
        amplitudes = np.linalg.lstsq(matrix, p, rcond=None)[0]
        return np.abs(matrix @ amplitudes - p).max() / np.abs(p).max()

    assert left_by(B2A) < (1e-4 if name == "sheared" else 1e-5)
    assert left_by(1.5 * B2A) > 5e-4  # twelve exponentials do not fit just anything


def test_energy_without_flow():
    """A lossless wall: |R|^2 + |T|^2 = 1. A lossy one: what is missing went into the wall.

    With columns of 1 mm at the edges the upwind flux itself takes 2e-8 of the power.
    """
    case = case_of()
    rough, steps = build_mesh(case, FREQUENCY, wall_cell=1e-3), np.array([0, 1e-3, 3e-3, 7e-3])
    x = [
        np.r_[a + steps, np.linspace(a + 0.015, b - 0.015, 13), (b - steps)[::-1]]
        for a, b in itertools.pairwise((case.start, *LINER, case.end))
    ]
    fine = DuctMesh(case, np.unique(np.concatenate(x).round(12)), rough.y)
    for reactance, passes in ((0.3, 0.602), (-0.8, 0.994)):
        field = solve_duct(case, FREQUENCY, 1j * reactance, fine)
        total = float(field.reflection.abs() ** 2 + field.transmission.abs() ** 2)
        assert total == pytest.approx(1, abs=1e-7)
        assert float(field.transmission.abs()) == pytest.approx(passes, abs=1e-3)
    field = solve_duct(case, FREQUENCY, B2A, fine)
    missing = 1 - float(field.reflection.abs() ** 2 + field.transmission.abs() ** 2)
    places, weights = np.polynomial.legendre.leggauss(12)
    edges = field.mesh.x[(field.mesh.x > -1e-9) & (field.mesh.x < 0.15 + 1e-9)]
    x = (edges[:-1, None] + np.diff(edges)[:, None] * (1 + places) / 2).ravel()
    weights = (np.diff(edges)[:, None] * weights / 2).ravel()
    p, v = field.wall_pressure(x, "lined")[0], 1.204 * SPEED * field.wall_velocity(x)[0]
    taken = float((p * v.conj()).real @ torch.as_tensor(weights)) / HEIGHT
    assert taken == pytest.approx(missing, abs=1e-7)
    assert 0.2 < missing < 0.8


def test_reciprocity_without_flow():
    """Uneven patches: the same transmission both ways, another reflection; with flow not even T."""
    patches, walls = [(0.0, 0.05), (0.05, 0.08), (0.1, 0.15)], [B2A, 0.3 - 0.5j, 1.0]
    one, other = (solve(walls, liner=patches, source=s) for s in BOTH)
    assert abs(complex(one.transmission - other.transmission)) < 1e-10
    assert abs(complex(one.reflection - other.reflection)) > 0.05
    one, other = (solve(walls, liner=patches, source=s, profile=TANH) for s in BOTH)
    assert abs(complex(one.transmission - other.transmission)) > 0.05


@pytest.mark.parametrize("source", BOTH)
@pytest.mark.parametrize(
    "profile", [TANH, ParabolicProfile(0.3, HEIGHT, SPEED), PLUG, STILL], ids=["tanh", "parabola", "plug", "still"]
)
def test_rigid_duct_passes_the_mode_on(profile, source):
    """Some 1e-8 comes back; p is the mode's along the duct, 2e-6, and q across it, 4e-5."""
    field = solve(profile=profile, liner=(), source=source)
    assert float(field.reflection.abs()) < 4e-8
    direction, start = ("downstream", -0.25) if source == "upstream" else ("upstream", 0.4)
    mode = duct_modes(profile, FREQUENCY, count=1, direction=direction)
    x, y = np.linspace(-0.25, 0.4, 40), np.linspace(0, HEIGHT, 9)
    along = np.exp(-1j * complex(mode.wavenumber) * (x - start))
    assert np.abs(field.wall_pressure(x)[0].numpy() - along).max() < 2e-6
    units = (1, 1.204 * SPEED, 1.204 * SPEED)
    for part, unit, wanted in zip(field.at(x[20], y), units, mode.at(y), strict=True):
        assert np.abs(part[0].numpy() * unit - wanted[0, 0].numpy() * along[20]).max() < 4e-5
