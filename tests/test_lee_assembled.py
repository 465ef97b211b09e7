"""The condensed and swept solution against the same equations as one sparse matrix.

First assembled by scikit-fem, which shares no line with the package; then from the package's own
element matrices, with everything a case can hold.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.sparse.linalg import spsolve

from oracles.lee_assembled import solve_assembled
from torchliner.duct.case import DuctCase
from torchliner.duct.field import fields_at
from torchliner.duct.flow_profiles import ParabolicProfile, TanhProfile, UniformProfile
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.solver import solve_duct
from torchliner.duct.sweep import SweptDuct
from verify_duct import node_places

VELOCITY = "continuous-velocity"
HEIGHT, SPEED, FREQUENCY = 50e-3, 343.0, 1500.0
B2A = 2.33 - 0.30j
K = 2 * math.pi * FREQUENCY / SPEED


X_EDGES = np.array([0.0, 0.03, 0.05, 0.07, 0.1])
Y_EDGES = np.array([0.0, 0.01, 0.03, 0.05])
LINED = (0.03, 0.07)


def wave_in(y):
    """(p + u)/2 and v that enter through the left end: polynomials, so that both have the same."""
    return 1 + 0.4 * y / HEIGHT, 0.3 * (y / HEIGHT) ** 2


def assembled_by_scikit_fem(profile, degree, impedance, points):
    """p, u, v at points: the fluxes of columns.py, facet by facet."""
    skfem = pytest.importorskip("skfem")
    mesh = skfem.MeshQuad.init_tensor(X_EDGES, Y_EDGES)
    element = skfem.ElementDG(skfem.ElementQuadP(degree))
    order = 2 * degree + 4
    cells = skfem.Basis(mesh, element, intorder=order)

    def mach(w):
        return profile.mach(np.clip(w.x[1], 0, HEIGHT))

    def flux(q, n, m, side):
        """(F_p, F_u, F_v) of q = (p, u, v) inside (+1) or outside (-1), n the outward normal."""
        p, u, v = q
        m_n, u_n, u_t = m * n[0], u * n[0] + v * n[1], -u * n[1] + v * n[0]
        wave = (1 + side * m_n) * (p + side * u_n) / 2
        tangential = (np.maximum(m_n, 0) if side > 0 else np.minimum(m_n, 0)) * u_t
        normal = wave
        return side * wave, normal * n[0] - tangential * n[1], normal * n[1] + tangential * n[0]

    def unit(field, value):
        return tuple(value if i == field else 0 * value for i in range(3))

    def block(equation, field):
        @skfem.BilinearForm(dtype=complex)
        def volume(q, t, w):
            m, slope = mach(w), profile.mach_slope(np.clip(w.x[1], 0, HEIGHT))
            p, u, v = unit(field, q)
            along = (m * p + u, p + m * u, m * v)[equation]
            across = (v, 0 * v, p)[equation]
            rest = (0 * p, slope * v, 0 * p)[equation]
            own = 1j * K * q * t if equation == field else 0 * q * t
            return own + rest * t - along * t.grad[0] - across * t.grad[1]

        matrix = volume.assemble(cells)
        sides = [skfem.InteriorFacetBasis(mesh, element, intorder=order, side=s) for s in (0, 1)]
        for test in (0, 1):
            for trial in (0, 1):

                @skfem.BilinearForm(dtype=complex)
                def facet(q, t, w, test=test, trial=trial):
                    n = (-1) ** test * w.n
                    kind = 1 if test == trial else -1
                    return flux(unit(field, q), n, mach(w), kind)[equation] * t

                matrix = matrix + facet.assemble(sides[trial], sides[test])

        @skfem.BilinearForm(dtype=complex)
        def end(q, t, w):
            return flux(unit(field, q), w.n, mach(w), 1)[equation] * t

        @skfem.BilinearForm(dtype=complex)
        def wall(q, t, w):
            p, u, v = unit(field, q)
            lined = (w.x[1] < 1e-9) & (w.x[0] > LINED[0]) & (w.x[0] < LINED[1])
            reflection = np.where(lined, (impedance - 1) / (impedance + 1), 1)
            arriving = p + u * w.n[0] + v * w.n[1]
            velocity, pressure = (1 - reflection) / 2 * arriving, (1 + reflection) / 2 * arriving
            return (velocity, pressure * w.n[0], pressure * w.n[1])[equation] * t

        ends = mesh.facets_satisfying(lambda x: (x[0] < 1e-9) | (x[0] > X_EDGES[-1] - 1e-9))
        walls = mesh.facets_satisfying(lambda x: (x[1] < 1e-9) | (x[1] > HEIGHT - 1e-9))
        for form, facets in ((end, ends), (wall, walls)):
            matrix = matrix + form.assemble(skfem.FacetBasis(mesh, element, facets=facets, intorder=order))
        return matrix

    def source(equation):
        @skfem.LinearForm(dtype=complex)
        def entering(t, w):
            wave, v = wave_in(w.x[1])
            # From outside w- = (p - u_n)/2 with u_n = -u: p = u = wave has no other wave in it.
            return -flux((wave, wave, v), w.n, mach(w), -1)[equation] * t

        left = mesh.facets_satisfying(lambda x: x[0] < 1e-9)
        return entering.assemble(skfem.FacetBasis(mesh, element, facets=left, intorder=order))

    matrix = skfem.bmat([[block(i, j) for j in range(3)] for i in range(3)], "csc")
    found = spsolve(matrix, np.concatenate([source(i) for i in range(3)])).reshape(3, -1)
    return np.stack([cells.probes(points) @ part for part in found])


@pytest.mark.parametrize("degree", [2, 3])
def test_scikit_fem_gives_the_same(degree):
    """Parabolic flow, whose integrals both take exactly: what is left is rounding, 1e-10."""
    profile = ParabolicProfile(0.3, HEIGHT, SPEED)
    case = DuctCase(profile, 0.0, 0.1, LINED)
    mesh = DuctMesh(case, X_EDGES, Y_EDGES, degree)
    frequency = torch.tensor([FREQUENCY], dtype=torch.float64)

    def entering(y):  # p = u: no wave against the flow
        wave, v = (torch.as_tensor(part, dtype=torch.complex128)[None, None] for part in wave_in(y.numpy()))
        return wave, wave, v

    still = torch.zeros(1, 1, dtype=torch.complex128)
    down = SimpleNamespace(wavenumber=still, at=entering)
    up = SimpleNamespace(wavenumber=still, at=lambda y: [0 * part for part in entering(y)])
    swept = SweptDuct(mesh, frequency, (down, up))
    arriving = swept.reading[0, :-2]
    reflection = (B2A - 1) / (B2A + 1)
    one = torch.eye(len(arriving), dtype=torch.complex128)
    eta = torch.linalg.solve(one - reflection * arriving[:, 2:-2], arriving[:, 0])
    waves = torch.cat([torch.tensor([1.0, 0.0]), reflection * eta, torch.zeros(2)])
    generator = np.random.default_rng(0)
    x, y = generator.uniform(0, 0.1, 50), generator.uniform(0, HEIGHT, 50)
    fields = fields_at(swept, waves[None], x, y)[0].unbind(-1)
    wanted = assembled_by_scikit_fem(profile, degree, B2A, np.stack([x, y]))
    for field, expected in zip(fields, wanted, strict=True):
        assert np.abs(field.numpy() - expected).max() < 1e-10
    assert np.abs(wanted).max() > 1


FLOWS = {
    "sheared": TanhProfile(0.3, HEIGHT, 0.1, SPEED),
    "no flow": UniformProfile(0.0, HEIGHT, SPEED),
    "slip": UniformProfile(0.3, HEIGHT, SPEED),
}


@pytest.mark.parametrize("source", ["upstream", "downstream"])
@pytest.mark.parametrize("name", FLOWS)
def test_sparse_lu_gives_the_same(name, source):
    """Two patches, a gap, both ends reflecting, uneven columns: 1e-10 of the largest value."""
    case = DuctCase(
        FLOWS[name],
        -0.12,
        0.2,
        [(0.0, 0.02), (0.02, 0.04), (0.05, 0.08)],
        source,
        end_reflection=0.3 - 0.2j,
        source_reflection=-0.1 + 0.5j,
        slip_condition=VELOCITY,
    )
    mesh = build_mesh(case, FREQUENCY, degree=2, column=0.02, row=0.0125, wall_cell=4e-3)
    walls = [B2A, math.inf, 0.5 + 1j]
    wanted, _ = solve_assembled(case, FREQUENCY, walls, mesh)
    x, y = (places.ravel() for places in node_places(mesh))
    fields = solve_duct(case, FREQUENCY, walls, mesh).at(x, y)
    units = (1, case.density * SPEED, case.density * SPEED)
    for i, (field, unit) in enumerate(zip(fields, units, strict=True)):
        error = np.abs(field[0].numpy() * unit - wanted[:, :, i].ravel()).max()
        assert error < 1e-10 * np.abs(wanted).max()
