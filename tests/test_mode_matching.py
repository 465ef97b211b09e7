"""Mode matching without flow: energy, continuity, wall law, the plane-wave limit, bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

import torchliner as tl
from oracles.mode_matching import match_modes
from torchliner.duct.flow_profiles import UniformProfile
from torchliner.duct.modes import duct_modes

HEIGHT, SPEED, LINER = 50e-3, 343.0, (0.1, 0.25)
WALLS = [2.33 - 0.30j, 0.5 + 1.0j, 0.3 - 0.6j]


def solve(frequency=1500.0, impedance=2.33 - 0.30j, **options):
    options = {"sound_speed": SPEED, **options}
    return match_modes(HEIGHT, options.pop("liner", LINER), frequency, impedance, **options)


def gauss(count, start, stop):
    places, weights = np.polynomial.legendre.leggauss(count)
    return start + (stop - start) * (1 + places) / 2, weights * (stop - start) / 2


@pytest.mark.parametrize("source", ["upstream", "downstream"])
@pytest.mark.parametrize("impedance", WALLS)
def test_energy(impedance, source):
    """1 - |R|^2 - |T|^2 is what the wall takes, 1/H integral of Re(1/Z) |p|^2.

    The wall's p is singular at the edges: 1e-3 of the power with 40 modes.
    """
    field = solve(impedance=impedance, source=source)
    x, weights = gauss(400, *LINER)
    p = field.fields(x, 0.0)[0][0].numpy()
    taken = (weights * abs(p) ** 2).sum() * (1 / impedance).real / HEIGHT
    left = 1 - abs(complex(field.reflection)) ** 2 - abs(complex(field.transmission)) ** 2
    assert 0.05 < left < 0.95
    assert taken == pytest.approx(left, abs=1e-3)


def test_wall_law_and_euler_equations():
    """p = Z v_in on the liner, v = 0 on the rigid walls, j k u = -dp/dx, j k p = -div."""
    field, k = solve(), 2 * math.pi * 1500.0 / SPEED
    x = np.linspace(*LINER, 23)[1:-1]
    p, _, v = (part[0].numpy() for part in field.fields(x, 0.0))
    assert np.abs(p - (2.33 - 0.30j) * -v).max() < 1e-9
    for places, y in ((x, HEIGHT), (np.array([0.02, 0.08, 0.27]), 0.0)):
        assert float(field.fields(places, y)[2].abs().max()) < 1e-12
    step, y = 1e-4, 0.013
    weights = np.array([1, -8, 0, 8, -1]) / (12 * step)
    along = [field.fields(x + i * step, y) for i in (-2, -1, 0, 1, 2)]
    across = [field.fields(x, y + i * step) for i in (-2, -1, 0, 1, 2)]
    p_x, u_x = (sum(w * f[i][0].numpy() for w, f in zip(weights, along, strict=True)) for i in (0, 1))
    v_y = sum(w * f[2][0].numpy() for w, f in zip(weights, across, strict=True))
    p, u, _ = (part[0].numpy() for part in along[2])
    inside = slice(1, -1)  # the differences reach over the edges at the ends
    assert np.abs(1j * k * u + p_x)[inside].max() < 1e-4 * k
    assert np.abs(1j * k * p + u_x + v_y)[inside].max() < 1e-4 * k


def test_fields_are_continuous_over_the_edges():
    """p and u on both sides of both edges, away from the corner; the jump falls with the modes."""
    y = np.linspace(0.01, HEIGHT, 9)
    jumps = []
    for modes in (20, 80):
        field = solve(modes=modes)
        for edge in LINER:
            left, right = (field.fields(edge + side * 1e-12, y) for side in (-1, 1))
            jumps.append(max(float((a - b).abs().max()) for a, b in zip(left[:2], right[:2], strict=True)))
    assert max(jumps[2:]) < 0.01
    assert max(jumps[2:]) < 0.5 * max(jumps[:2])


def test_low_frequency_is_a_plane_wave_slab():
    """k H << 1: a slab with alpha^2 = k^2 - j k/(Z H), and the R and T of one; error (k H/|Z|).

    R = (1 - q^2) (1 - E^2)/((1 + q)^2 - (1 - q)^2 E^2), q = alpha/k.
    """
    height, frequency, impedance = 1e-4, 100.0, 3.0 - 2.0j
    k, length = 2 * math.pi * frequency / SPEED, 0.15
    field = match_modes(height, (0, length), frequency, 1e3 * impedance, sound_speed=SPEED)
    q = np.sqrt(1 - 1j / (1e3 * impedance * k * height))
    q = q if q.imag < 0 else -q
    decay = np.exp(-1j * q * k * length)
    bottom = (1 + q) ** 2 - (1 - q) ** 2 * decay**2
    assert abs(complex(field.reflection) - (1 - q**2) * (1 - decay**2) / bottom) < 1e-3
    assert abs(complex(field.transmission) - 4 * q * decay / bottom) < 1e-3


def test_a_long_liner_decays_like_its_first_mode():
    """Against the eigen-solver of sheared ducts at M = 0: 1e-9 of alpha, 3.5 m before the end."""
    field = solve(liner=(0.0, 4.0))
    p = field.fields(np.array([0.5, 0.51]), HEIGHT)[0][0]
    alpha = 1j * np.log(complex(p[1] / p[0])) / 0.01
    still = UniformProfile(0.0, HEIGHT, SPEED)
    wanted = complex(duct_modes(still, 1500.0, 2.33 - 0.30j, count=1).wavenumber)
    assert abs(alpha / wanted - 1) < 1e-9


def test_modes_converge():
    """On the opposite wall the field settles to 2e-5 with 40 modes."""
    x = np.linspace(0, 0.35, 71)
    wanted = solve(modes=160).fields(x, HEIGHT)[0]
    errors = [float((solve(modes=n).fields(x, HEIGHT)[0] - wanted).abs().max()) for n in (10, 40)]
    assert errors[1] < 2e-5
    assert errors[1] < errors[0] / 12  # second order: 16


def test_ends_of_the_range():
    """A rigid liner does nothing; Z = 0 and 1e-6 agree; either side gives the same, mirrored."""
    x = np.linspace(0, 0.35, 11)
    hard = solve(impedance=math.inf)
    wanted = np.exp(-2j * math.pi * 1500.0 / SPEED * (x - LINER[0]))
    assert np.abs(hard.fields(x, 0.01)[0][0].numpy() - wanted).max() < 1e-10
    soft, nearly = solve(impedance=0.0), solve(impedance=1e-6)
    assert float(soft.fields(x[4:7], 0.0)[0].abs().max()) < 1e-9
    assert abs(complex(soft.transmission - nearly.transmission)) < 1e-5
    one, other = solve(), solve(source="downstream")
    assert abs(complex(one.transmission - other.transmission)) < 1e-12
    mirrored = other.fields(sum(LINER) - x, 0.02)[0]
    assert float((one.fields(x, 0.02)[0] - mirrored).abs().max()) < 1e-10


def test_batch_is_the_loop():
    frequency = [800.0, 1500.0]
    whole = solve(frequency, torch.tensor(WALLS, dtype=torch.complex128)[:, None])
    x = np.array([0.05, 0.17, 0.3])
    fields = whole.fields(x, HEIGHT)
    assert whole.reflection.shape == (3, 2)
    for i, wall in enumerate(WALLS):
        one = solve(frequency[1], wall).fields(x, HEIGHT)
        for a, b in zip(fields, one, strict=True):
            assert torch.allclose(a[i, 1], b[0], rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"liner": (0.2, 0.1)}, r"liner length \(m\) is -0\.1"),
        ({"modes": 0}, "modes is 0; at least one"),
        ({"source": "left"}, "unknown source 'left'"),
        ({"frequency": -1.0}, "frequency .*is -1"),
        ({"impedance": math.nan}, "impedance is nan"),
        ({"sound_speed": 0.0}, "sound_speed"),
    ],
)
def test_refusals(options, match):
    with pytest.raises(ValueError, match=match):
        solve(**options)


def test_cut_on_is_singular_and_feeding_walls_warn():
    with pytest.raises(RuntimeError, match="equations are singular"):
        match_modes(0.5, LINER, 1.0, 1.0, sound_speed=1.0)
    with pytest.warns(tl.DataWarning, match=r"negative resistance, -0\.5"):
        solve(impedance=-0.5 + 2j)
