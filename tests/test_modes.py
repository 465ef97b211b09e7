"""Modes of a lined duct against the dispersion relation, independent shooting and counted roots."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

import torchliner as tl
from torchliner.duct import modes as modes_module
from torchliner.duct.flow_profiles import ParabolicProfile, TanhProfile, UniformProfile
from torchliner.duct.modes import cut_on_frequency, duct_modes

VELOCITY = "continuous-velocity"
HEIGHT, SPEED = 50e-3, 343.0
B2A = 2.33 - 0.30j
BOTH = ("downstream", "upstream")
WALLS = [B2A, 0.5 + 1.0j, 0.5 - 1.0j, 0.05 - 0.3j, 8.0 + 0.0j]
UNIFORM = UniformProfile(0.3, HEIGHT, SPEED)
TANH = TanhProfile(0.3, HEIGHT, 0.1, SPEED)


def k_of(frequency):
    return 2 * math.pi * frequency / SPEED


def shoot(profile, alpha, k, height=HEIGHT):
    """p, v at y = 0 from p = 1, v = 0 at y = H: the Euler equations as they stand, by DOP853.

    In (p, v) with M', not in the package's (p, v/sigma) without it.
    """

    def right(y, q):
        mach, slope = float(profile.mach(y)), float(profile.mach_slope(y))
        local = k - alpha * mach
        u = (alpha * q[0] + 1j * slope * q[1]) / local
        return [-1j * local * q[1], -1j * (local * q[0] - alpha * u)]

    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    start, state = height, [1.0 + 0j, 0j]
    for stop in (height / 2, 0.0):  # the slope may bend on the centreline
        run = solve_ivp(right, (start, stop), state, **options)
        start, state = stop, run.y[:, -1]
    return state


@pytest.mark.parametrize("direction", BOTH)
@pytest.mark.parametrize("mach", [0.0, 0.3, 0.6])
def test_rigid_uniform_duct(mach, direction):
    """alpha = (-k M +- sqrt(k^2 - (1 - M^2)(n pi/H)^2))/(1 - M^2), p = cos(n pi y/H)."""
    frequency = np.array([300.0, 1500.0, 5000.0])
    modes = duct_modes(UniformProfile(mach, HEIGHT, SPEED), frequency, direction=direction)
    k, n = k_of(frequency)[:, None], np.arange(6)
    root = np.sqrt(k**2 - (1 - mach**2) * (n * np.pi / HEIGHT) ** 2 + 0j)
    root = np.where(root.imag > 0, -root, root)  # decays downstream
    wanted = (-k * mach + (1 if direction == "downstream" else -1) * root) / (1 - mach**2)
    assert np.abs(modes.wavenumber.numpy() - wanted).max() < 1e-9 * 6 * np.pi / HEIGHT
    y = np.linspace(0, HEIGHT, 17)
    p, u, v = modes.at(y)
    local = k - wanted * mach
    shape = np.cos(n[:, None] * np.pi * (1 - y / HEIGHT))
    sine = np.sin(n[:, None] * np.pi * (1 - y / HEIGHT)) * (n * np.pi / HEIGHT)[:, None]
    assert np.abs(p.numpy() - shape).max() < 1e-9
    assert np.abs(u.numpy() - (wanted / local)[..., None] * shape).max() < 1e-8
    assert np.abs(v.numpy() - 1j * sine / local[..., None]).max() < 1e-8 * 6 * np.pi / 0.3


@pytest.mark.parametrize("condition", ["ingard-myers", VELOCITY])
@pytest.mark.parametrize("direction", BOTH)
@pytest.mark.parametrize("height", [HEIGHT, 0.15])
def test_modes_of_uniform_flow_are_those_of_the_dispersion_relation(height, direction, condition):
    """By number too, at walls where two modes come close; there none is missed (test_dispersion.py)."""
    frequency = torch.tensor([500.0, 1500.0, 2000.0]).double()
    walls = torch.tensor([*WALLS, 0.4083 - 0.4108j], dtype=torch.complex128)[:, None]
    about = {"direction": direction, "slip_condition": condition, "count": 4}
    found = duct_modes(UniformProfile(0.3, height, SPEED), frequency, walls, **about).wavenumber
    duct = {"height": height, "mach": 0.3, "sound_speed": SPEED, "condition": condition, "direction": direction}
    wanted = tl.wavenumber_from_impedance(walls[..., None], frequency[:, None], mode=torch.arange(4), **duct)
    assert torch.allclose(found, wanted, rtol=1e-8, atol=0)


SHEARED = {
    "tanh": TANH,
    "thick": TanhProfile(0.3, HEIGHT, 0.5, SPEED),
    "parabola": ParabolicProfile(0.3, HEIGHT, SPEED),
}


@pytest.mark.parametrize("direction", BOTH)
@pytest.mark.parametrize("name", SHEARED)
def test_shooting_returns_the_impedance(name, direction):
    """DOP853 at 1e-12 from the rigid wall, through v and M': Z to 1e-7, p at the wall to 1e-8."""
    profile = SHEARED[name]
    modes = duct_modes(profile, 1500.0, B2A, count=3, direction=direction)
    for n in range(3):
        p, v = shoot(profile, complex(modes.wavenumber[0, n]), k_of(1500.0))
        assert abs(p / -v / B2A - 1) < 1e-7
        assert abs(complex(modes.pressure[0, n, -1]) / p - 1) < 1e-8
        assert abs(complex(modes.normal[0, n, -1]) / v - 1) < 1e-7


@pytest.mark.filterwarnings("ignore:profile shear:torchliner.DataWarning")
@pytest.mark.parametrize("direction", BOTH)
def test_thin_layers_tend_to_ingard_and_myers(direction):
    """At the same centreline flow, the difference falls in proportion to the thickness.

    Continuity of velocity is not the limit.
    """
    errors = {}
    for condition in ("ingard-myers", VELOCITY):
        for shear in (0.04, 0.02, 0.01):
            thin = TanhProfile(0.3, HEIGHT, shear, SPEED, allow_thin=True)
            plug = UniformProfile(thin.centreline_mach, HEIGHT, SPEED)
            about = {"count": 1, "direction": direction, "slip_condition": condition}
            found, limit = (duct_modes(flow, 1500.0, B2A, **about) for flow in (thin, plug))
            errors[condition, shear] = abs(complex(found.wavenumber - limit.wavenumber))
    myers = [errors["ingard-myers", shear] for shear in (0.04, 0.02, 0.01)]
    velocity = [errors[VELOCITY, shear] for shear in (0.04, 0.02, 0.01)]
    assert myers[1] / myers[0] == pytest.approx(0.5, abs=0.03)
    assert myers[2] / myers[1] == pytest.approx(0.5, abs=0.03)
    assert velocity[2] > 0.9 * velocity[0]


def test_extreme_walls():
    """Z = 0 has p = 0 on the wall; Z = inf, 1e9 and nothing are the rigid wall."""
    soft = duct_modes(TANH, 1500.0, 0.0)
    assert float(soft.pressure[..., -1].abs().max()) < 1e-9
    rigid = duct_modes(TANH, 1500.0)
    for hard in (math.inf, complex(0, math.inf), 1e9):
        assert float((duct_modes(TANH, 1500.0, hard).wavenumber - rigid.wavenumber).abs().max()) < 1e-6


def test_batch_is_the_loop(monkeypatch):
    """Over walls and frequencies; also when more modes are wanted than fit one chunk."""
    monkeypatch.setattr(modes_module, "CHUNK", 32)
    frequency, walls = [700.0, 1500.0, 2600.0], torch.tensor(WALLS, dtype=torch.complex128)[:, None]
    whole = duct_modes(TANH, frequency, walls, count=3)  # 45 modes
    for i, f in [(0, 0), (3, 2), (4, 1)]:
        one = duct_modes(TANH, frequency[f], walls[i], count=3)
        assert torch.allclose(whole.wavenumber[i, f], one.wavenumber[0], rtol=1e-11, atol=1e-9)
        assert torch.allclose(whole.axial[i, f], one.axial[0], rtol=1e-8, atol=1e-9)


@pytest.mark.slow
def test_gradients(monkeypatch):
    """Of wavenumbers and shapes by Z, against differences."""
    monkeypatch.setattr(modes_module, "POINTS", 8)
    walls = torch.tensor([[B2A], [0.5 - 1j]], dtype=torch.complex128, requires_grad=True)

    def outputs(z):
        modes = duct_modes(TANH, [1500.0], z, count=2)
        return modes.wavenumber, modes.pressure[..., ::30], modes.axial[..., ::30]

    assert torch.autograd.gradcheck(outputs, (walls,), eps=1e-5, atol=1e-5, rtol=1e-5)


def test_cut_on():
    """n c sqrt(1 - M^2)/(2 H), where mode n has a double wavenumber; shear lowers it by less than 1 %."""
    limit = cut_on_frequency(UNIFORM)
    assert limit == pytest.approx(SPEED * math.sqrt(1 - 0.09) / (2 * HEIGHT), rel=1e-12)
    at = float(duct_modes(UNIFORM, limit, count=2).wavenumber[0, 1].abs())
    assert at == pytest.approx(0.3 * k_of(limit) / (1 - 0.09), rel=1e-6)
    below, above = duct_modes(TANH, [0.99 * limit, limit], count=2).wavenumber[:, 1]
    assert abs(below.imag) > 0.3
    assert abs(above.imag) < 1e-6


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"frequency": 0.0}, "frequency .*is 0"),
        ({"impedance": math.nan}, "impedance is nan or -1"),
        ({"count": 60}, "count is 60; from one mode to 24"),
        ({"direction": "up"}, "direction 'up'.*downstream, upstream"),
        ({"slip_condition": None}, r"Mach 0\.3; .*'continuous-velocity'"),
        ({"slip_condition": "myers"}, "slip condition 'myers'"),
    ],
)
def test_refusals(change, match):
    arguments = {"frequency": 1500.0, "impedance": B2A, "slip_condition": VELOCITY, **change}
    with pytest.raises(ValueError, match=match):
        duct_modes(UNIFORM, arguments.pop("frequency"), arguments.pop("impedance"), **arguments)
