"""Wavenumbers of a lined duct in uniform flow: closed forms, an eigen-solver, counted roots."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
import scipy.linalg
import torch
from conftest import relative_error

import torchliner as tl
from torchliner.duct.dispersion import impedance_from_wavenumber, wavenumber_from_impedance
from torchliner.duct.flow_profiles import UniformProfile
from torchliner.duct.modes import cut_on_frequency
from torchliner.names import CONDITIONS, DIRECTIONS

HEIGHT, SPEED, FREQUENCY = 50e-3, 343.0, 1500.0
K = 2 * math.pi * FREQUENCY / SPEED
DUCT = {"height": HEIGHT, "sound_speed": SPEED}
CREMER = 2.1061961 + 1.1253643j  # gamma H of the double root: sin 2x + 2x = 0


def exact(*values: complex) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.complex128)


def passive(count: int, seed: int = 0) -> torch.Tensor:
    """Random impedances of positive resistance."""
    generator = torch.Generator().manual_seed(seed)
    draws = torch.randn(2, count, generator=generator, dtype=torch.float64)
    return torch.complex(0.05 + 1.5 * draws[0].abs(), 1.2 * draws[1])


def entire(alpha, impedance: complex, mach: float, condition: str):
    """The relation written out once more, over numpy, for contours."""
    d = K - alpha * mach
    gamma = np.sqrt(d**2 - alpha**2 + 0j)
    factor = d**2 / K if condition == "ingard-myers" else d
    return impedance * gamma * np.sin(gamma * HEIGHT) - 1j * factor * np.cos(gamma * HEIGHT)


def roots_within(left, right, low, high, *about) -> float:
    """Number of zeros in a rectangle: the winding of F along its edge, divided by 2 pi."""
    corners = [complex(left, low), complex(right, low), complex(right, high), complex(left, high)]
    steps = np.linspace(0, 1, 4001)
    edge = np.concatenate([a + steps * (b - a) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)])
    return np.diff(np.unwrap(np.angle(entire(edge, *about)))).sum() / (2 * np.pi)


def chebyshev_wavenumbers(impedance: complex, mach: float, condition: str, points: int = 40):
    """p'' + (d^2 - alpha^2) p = 0, p'(0) = 0, Z p'(H) = -j (d^2/k or d) p(H), by collocation."""
    nodes = np.cos(np.pi * np.arange(points + 1) / points)
    weight = np.r_[2, np.ones(points - 1), 2] * (-1) ** np.arange(points + 1)
    apart = nodes[:, None] - nodes + np.eye(points + 1)
    slope = np.outer(weight, 1 / weight) / apart
    slope -= np.diag(slope.sum(1))
    slope *= 2 / HEIGHT  # node 0 is y = H, the last one y = 0
    one = np.eye(points + 1)
    parts = [slope @ slope + K**2 * one, -2 * K * mach * one, (mach**2 - 1) * one]
    parts = [part.astype(complex) for part in parts]
    wall = (1, -2 * mach / K, mach**2 / K**2) if condition == "ingard-myers" else (1, -mach / K, 0)
    for part, factor in zip(parts, wall, strict=True):
        part[0] = 1j * K * factor * one[0]
        part[-1] = 0
    parts[0][0] += impedance * slope[0]
    parts[0][-1] = slope[-1]
    big = np.eye(points + 1)
    none = np.zeros_like(big)
    found = scipy.linalg.eigvals(
        np.block([[none, big], [-parts[0], -parts[1]]]), np.block([[big, none], [none, parts[2]]])
    )
    return found[np.isfinite(found)]


@pytest.mark.parametrize("mach", [0.0, 0.3, -0.3, 0.9])
@pytest.mark.parametrize("condition", CONDITIONS)
def test_rigid_wall(mach, condition):
    """k/(1+M) downstream, -k/(1-M) upstream; back to an infinite impedance."""
    both = [
        wavenumber_from_impedance(exact(complex("inf")), FREQUENCY, mach=mach, condition=condition, direction=d, **DUCT)
        for d in DIRECTIONS
    ]
    assert complex(both[0]) == pytest.approx(K / (1 + mach), rel=1e-14)
    assert complex(both[1]) == pytest.approx(-K / (1 - mach), rel=1e-14)
    again = impedance_from_wavenumber(both[0], FREQUENCY, mach=mach, condition=condition, **DUCT)
    assert float(again.abs()) > 1e12


def test_published_number():
    """Ingard-Myers, M 0.3, 1500 Hz, Z = 2.33-0.30j in 50 mm: alpha = 21.45776-2.51104j."""
    found = complex(wavenumber_from_impedance(exact(2.33 - 0.30j), FREQUENCY, mach=0.3, **DUCT))
    assert abs(found - (21.45776 - 2.51104j)) < 1e-5
    back = complex(impedance_from_wavenumber(exact(21.45776 - 2.51104j), FREQUENCY, mach=0.3, **DUCT))
    assert abs(back - (2.33 - 0.30j)) < 1e-5


def test_cremers_optimum_is_a_double_root():
    """Modes 0 and 1 meet at Z = jkH/(x tan x) with sin 2x + 2x = 0; half the digits are left."""
    assert abs(cmath.sin(2 * CREMER) + 2 * CREMER) < 1e-6
    best = 1j * K * HEIGHT / (CREMER * cmath.tan(CREMER))
    wanted = cmath.sqrt(K**2 - (CREMER / HEIGHT) ** 2)
    for mode in (0, 1):
        found = complex(wavenumber_from_impedance(exact(best), FREQUENCY, mode=mode, **DUCT))
        assert abs(found - wanted) < 1e-4 * abs(wanted)  # sqrt of the digits of CREMER


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_round_trip(condition, direction):
    """Z to alpha to Z for 200 walls, three modes, several flows: 1e-12 relative."""
    walls = passive(200)[:, None, None]
    mach = torch.tensor([0.0, 0.1, 0.3, 0.5], dtype=torch.float64)[:, None]
    about = {**DUCT, "mach": mach, "condition": condition}
    alpha = wavenumber_from_impedance(walls, FREQUENCY, direction=direction, mode=torch.arange(3), **about)
    assert alpha.shape == (200, 4, 3)
    assert relative_error(impedance_from_wavenumber(alpha, FREQUENCY, **about), walls) < 1e-12


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("mach", [0.0, 0.3])
@pytest.mark.parametrize("impedance", [2.33 - 0.3j, 0.5 + 1.0j, 0.3 - 0.4j])
def test_eigen_solver_and_argument_principle(condition, mach, impedance):
    """Four modes a side are the collocated eigenvalues, and the rectangle holds no others."""
    found = [
        complex(alpha)
        for d in DIRECTIONS
        for alpha in wavenumber_from_impedance(
            exact(impedance), FREQUENCY, mach=mach, condition=condition, direction=d, mode=torch.arange(4), **DUCT
        )
    ]
    solver = chebyshev_wavenumbers(impedance, mach, condition)
    for alpha in found:
        assert np.abs(solver - alpha).min() < 1e-6 * abs(alpha)
    assert min(abs(a - b) for i, a in enumerate(found) for b in found[:i]) > 1.0
    box = (-130.0, 130.0, -235.0, 235.0)
    inside = [a for a in found if abs(a.real) < 130 and abs(a.imag) < 235]
    count = roots_within(*box, impedance, mach, condition)
    assert count == pytest.approx(round(count), abs=1e-6)
    theirs = (np.abs(solver.real) < 130) & (np.abs(solver.imag) < 235)
    assert round(count) == theirs.sum()
    # Ingard-Myers in flow has up to two hydrodynamic modes that no rigid mode becomes.
    spare = 2 if condition == "ingard-myers" and mach else 0
    assert len(inside) <= round(count) <= len(inside) + spare


@pytest.mark.parametrize("condition", CONDITIONS)
def test_no_jumps_along_the_ray(condition):
    """Each mode is continuous from the rigid wall to Z, and the modes stay apart."""
    rays = torch.polar(torch.ones(3).double(), torch.tensor([0.3, -0.5, 1.2]).double())
    share = torch.linspace(0.01, 3, 1200, dtype=torch.float64)  # of the admittance
    alpha = wavenumber_from_impedance(
        rays[:, None, None] / share[:, None], FREQUENCY, mach=0.3, condition=condition, mode=torch.arange(3), **DUCT
    )
    steps = alpha.diff(dim=1).abs()
    apart = torch.stack([(alpha[..., i] - alpha[..., j]).abs() for i, j in ((0, 1), (1, 2), (0, 2))])
    assert float(steps.max()) < 0.25 * float(apart.min())
    # Halving the steps halves the moves: a jump would not shrink.
    assert float(alpha[:, ::2].diff(dim=1).abs().max()) > 1.8 * float(steps.max())


@pytest.mark.parametrize("condition", CONDITIONS)
def test_derivatives(condition):
    """In Z, k, H and M, first and second, at |Z| above and below 1; everything broadcasts."""
    walls = exact(2.33 - 0.3j, 0.4 + 0.5j).requires_grad_()
    reals = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (1500.0, 0.05, 0.3)]

    def forward(z, f, h, m):
        return wavenumber_from_impedance(z, f / SPEED, height=h, mach=m, sound_speed=1.0, condition=condition)

    def backward(z, f, h, m):
        alpha = exact(9.0 - 1.5j, -35 + 8j) * z
        return impedance_from_wavenumber(alpha, f, height=h, mach=m, condition=condition)

    for function in (forward, backward):
        torch.autograd.gradcheck(function, (walls, *reals), eps=1e-7, atol=1e-4, rtol=1e-5)
    torch.autograd.gradgradcheck(
        lambda z: forward(z, *(r.detach() for r in reals)), (walls,), eps=1e-6, atol=1e-3, rtol=1e-4
    )


@pytest.mark.parametrize(
    ("about", "match"),
    [
        ({"mach": 1.0}, "mach is 1; .*between -1 and 1"),
        ({"frequency": [500.0, float("nan")]}, r"frequency \(Hz\) is nan; .*above 0"),
        ({"height": -0.05}, r"height \(m\) is -0\.05"),
        ({"sound_speed": math.inf}, r"sound_speed \(m/s\) is inf"),
        ({"condition": "ingard"}, "condition 'ingard'.*ingard-myers"),
    ],
)
def test_both_ways_refuse(about, match):
    given = {"height": HEIGHT, **about}
    frequency = given.pop("frequency", FREQUENCY)
    with pytest.raises(ValueError, match=match):
        impedance_from_wavenumber(exact(20 - 1j), frequency, **given)
    with pytest.raises(ValueError, match=match):
        wavenumber_from_impedance(exact(2.0), frequency, **given)


def test_other_refusals():
    for function in (impedance_from_wavenumber, wavenumber_from_impedance):
        with pytest.raises(TypeError, match=r"torch\.float32; a complex tensor"):
            function(torch.tensor([1.0]), FREQUENCY, **DUCT)
    with pytest.raises(ValueError, match=r"mode is -1; .*0, 1, 2"):
        wavenumber_from_impedance(exact(2.0), FREQUENCY, mode=-1, **DUCT)
    at_cut_on = cut_on_frequency(UniformProfile(0.3, HEIGHT, SPEED))
    with pytest.raises(RuntimeError, match=r"two modes meet .* change Z or the frequency"):
        wavenumber_from_impedance(exact(2.0), at_cut_on, mach=0.3, mode=1, **DUCT)
    with pytest.warns(tl.DataWarning, match=r"negative resistance, -0\.2 at least, in 1 of 2"):
        wavenumber_from_impedance(exact(1.0, -0.2 + 1j), FREQUENCY, **DUCT)
