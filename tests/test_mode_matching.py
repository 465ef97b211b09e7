"""Mode matching without flow, the oracle of the Euler solver, and ``scripts/verify_duct.py``, which holds it to."""

from __future__ import annotations

import numpy as np
import pytest

import verify_duct as verify
from oracles.mode_matching import match_modes
from torchliner.duct.flow_profiles import UniformProfile
from torchliner.duct.modes import duct_modes

HEIGHT, SPEED, LINER = 50e-3, 343.0, (0.1, 0.25)


def solve(impedance=2.33 - 0.30j, **options):
    return match_modes(HEIGHT, options.pop("liner", LINER), 1500.0, impedance, sound_speed=SPEED, **options)


@pytest.mark.parametrize("impedance", [2.33 - 0.30j, 0.5 + 1.0j, 0.3 - 0.6j])
def test_energy_and_wall_law(impedance):
    """1 - |R|^2 - |T|^2 is what the wall takes, 1/H integral of Re(1/Z) |p|^2; p = Z v_in there.

    The wall's p is singular at the edges: 1e-3 of the power with 40 modes.
    """
    field = solve(impedance)
    places, weights = np.polynomial.legendre.leggauss(400)
    x = LINER[0] + (LINER[1] - LINER[0]) * (1 + places) / 2
    p, _, v = field.fields(x, 0.0)
    taken = (weights * abs(p) ** 2).sum() * (LINER[1] - LINER[0]) / 2 * (1 / impedance).real / HEIGHT
    left = 1 - abs(field.reflection) ** 2 - abs(field.transmission) ** 2
    assert 0.05 < left < 0.95
    assert taken == pytest.approx(left, abs=1e-3)
    assert np.abs(p + impedance * v).max() < 1e-9


def test_a_long_liner_decays_like_its_first_mode():
    """Against the eigen-solver of sheared ducts at M = 0: 1e-9 of alpha, 3.5 m before the end."""
    p = solve(liner=(0.0, 4.0)).fields(np.array([0.5, 0.51]), HEIGHT)[0]
    alpha = 1j * np.log(p[1] / p[0]) / 0.01
    wanted = complex(duct_modes(UniformProfile(0.0, HEIGHT, SPEED), 1500.0, 2.33 - 0.30j, count=1).wavenumber)
    assert abs(alpha / wanted - 1) < 1e-9


def test_checks_hold_and_fail(capsys, monkeypatch):
    """Degree 1 here; test_lee.py holds the others."""
    assert verify.main(["--degrees", "1"]) == 0
    assert "holds: rigid-lined-rigid" in capsys.readouterr().out
    monkeypatch.setattr(verify, "PUBLISHED", 21.5 - 2.5j)
    monkeypatch.setattr(verify, "order_table", lambda *_: [])
    assert verify.main(["--degrees", "1"]) == 1
    assert "FAILS: dispersion relation against its published value (1/m) 4.37e-02" in capsys.readouterr().out
