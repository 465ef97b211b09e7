"""Mean-flow profile and the jet-height scaling of appendix A.2."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import quad

import torchliner as tl
from studies.jet_scaling import fit_exponent, jet_scaling
from torchliner.duct.flow_profiles import TanhProfile
from torchliner.studies.jets import jet_velocity, penetration_height

HEIGHT = 50e-3


@dataclass(frozen=True)
class PowerProfile:
    """U = a y^n: n = 0 uniform, n = 1 a linear shear layer."""

    factor: float
    power: float
    duct_height: float = HEIGHT

    def velocity(self, y):
        return self.factor * np.asarray(y, float) ** self.power


@pytest.mark.parametrize("shear", [0.03, 0.05, 0.1, 0.5, 3.0, 100.0])
@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
def test_bulk_velocity_is_the_mean_of_the_profile(shear):
    """The exact integral against quadrature, for thin layers and near a parabola."""
    profile = TanhProfile(0.25, HEIGHT, shear, sound_speed=340.0)
    half, _ = quad(profile.velocity, 0, HEIGHT / 2, epsabs=1e-9, epsrel=1e-12, limit=200)
    assert 2 * half / HEIGHT == pytest.approx(0.25 * 340.0, rel=1e-11)
    assert profile.velocity(HEIGHT / 2) == pytest.approx(profile.centreline_mach * 340.0, rel=1e-14)
    assert profile.velocity([0.0, HEIGHT]) == pytest.approx([0.0, 0.0], abs=1e-9)


def test_published_check_values():
    """d = 0.1, bulk Mach 0.3: U0/c = 0.32234, displacement thickness 1.73 mm in 50 mm."""
    profile = TanhProfile(0.3, HEIGHT, 0.1)
    assert profile.centreline_mach == pytest.approx(0.32234, abs=5e-6)
    assert 1e3 * profile.displacement_thickness == pytest.approx(1.73, abs=5e-3)
    y = np.linspace(0, HEIGHT / 2, 4001)
    integral = tl.displacement_thickness(y, profile.velocity(y))
    assert profile.displacement_thickness == pytest.approx(integral, rel=1e-5)


def test_profile_limits():
    """Symmetric, smooth on the centreline, a parabola for thick layers, a plug for thin ones."""
    profile = TanhProfile(0.3, HEIGHT, 0.2)
    y = np.linspace(0, HEIGHT, 101)
    assert profile.velocity(y) == pytest.approx(profile.velocity(y[::-1]), rel=1e-12)
    step = 1e-5
    slope = (profile.velocity(HEIGHT / 2) - profile.velocity(HEIGHT / 2 - step)) / step
    assert abs(slope) < 1e-3 * profile.velocity(HEIGHT / 2) / HEIGHT
    thick = TanhProfile(0.3, HEIGHT, 1e3)
    assert thick.velocity(y) == pytest.approx(1.5 * 0.3 * 343.2 * (1 - (2 * y / HEIGHT - 1) ** 2), rel=1e-5, abs=1e-9)
    with pytest.warns(tl.DataWarning, match=r"shear is 0\.03, below 0\.05"):
        thin = TanhProfile(0.3, HEIGHT, 0.03)
    assert thin.displacement_thickness < TanhProfile(0.3, HEIGHT, 0.05).displacement_thickness


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shear": 0.029}, r"shear is 0\.029, below 0\.03"),
        ({"shear": 0.0}, "shear is 0; it must be finite and above 0"),
        ({"bulk_mach": 1.0}, r"bulk_mach is 1; it must be below 1 \(a Mach number, not m/s\)"),
        ({"bulk_mach": 0.99}, r"centreline Mach number is 1\.06.*it must be below 1"),
        ({"bulk_mach": 0.0}, "bulk_mach is 0"),
        ({"duct_height": -1.0}, "duct_height is -1"),
    ],
)
def test_profile_refuses(change, message):
    with pytest.raises(ValueError, match=message):
        TanhProfile(**{"bulk_mach": 0.3, "duct_height": HEIGHT, **change})


def test_points_outside_the_duct_are_refused():
    with pytest.raises(ValueError, match=r"y = 0\.051 m lies outside the duct, 0 to 0\.05 m"):
        TanhProfile(0.3, HEIGHT).velocity([0.01, 0.051])


def test_the_limit_of_shear_itself_is_quiet():
    """Figure 22 uses 0.05."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        profile = TanhProfile(0.3, HEIGHT, 0.05)
    assert profile.shear == 0.05


def test_uniform_flow_has_the_closed_form():
    """H = (sqrt(pi/4) r)^(2/3) (x/d)^(1/3) d: exponents 2/3 and -2/3."""
    diameter, speed = 1e-3, 60.0
    jets = np.array([1.0, 5.0, 30.0])
    wanted = (math.sqrt(math.pi / 4) * jets / speed) ** (2 / 3) * 10 ** (1 / 3) * diameter
    found = penetration_height(jets, diameter, PowerProfile(speed, 0.0))
    assert found == pytest.approx(wanted, rel=1e-11)
    assert fit_exponent(jets, found)[0] == pytest.approx(2 / 3, abs=1e-11)


@pytest.mark.parametrize("power", [0.0, 1 / 7, 0.5, 1.0])
def test_power_law_profiles_have_the_exponent_2_over_3_plus_2n(power):
    """U = a y^n gives H ~ (U_j/a)^(2/(3 + 2n)): 2/5 in a linear shear layer, the paper's 0.4."""
    jets = np.geomspace(0.5, 5, 5)
    found = penetration_height(jets, 1e-3, PowerProfile(2e3, power))
    assert fit_exponent(jets, found)[0] == pytest.approx(2 / (3 + 2 * power), abs=1e-10)


def test_the_fixed_point_is_met_and_equals_repetition():
    """H = L (x/L)^(1/3) with U at H, and the paper's repetition ends there."""
    profile, jet, d = TanhProfile(0.3, HEIGHT, 0.05), 20.0, 1e-3
    height = float(penetration_height(jet, d, profile))
    guess = 1e-3
    for _ in range(200):
        scale = math.sqrt(math.pi / 4) * jet / float(profile.velocity(guess)) * d
        guess = math.sqrt(guess * scale * (10 * d / scale) ** (1 / 3))
    assert height == pytest.approx(guess, rel=1e-10)


@pytest.mark.parametrize("shear", [0.05, 0.1])
def test_height_rises_with_the_jet_and_falls_with_the_flow(shear):
    """Monotone over the whole of the paper's ranges; only U_j/M_b matters; scales with lengths."""
    jets = np.geomspace(1, 120, 9)
    rows = [penetration_height(jets, 1e-3, TanhProfile(m, HEIGHT, shear)) for m in (0.1, 0.2, 0.4)]
    assert (np.diff(rows, axis=1) > 0).all()
    assert (np.diff(rows, axis=0) < 0).all()
    assert penetration_height(jets / 2, 1e-3, TanhProfile(0.1, HEIGHT, shear)) == pytest.approx(rows[1], rel=1e-10)
    doubled = penetration_height(jets, 2e-3, TanhProfile(0.1, 2 * HEIGHT, shear))
    assert doubled == pytest.approx(2 * rows[0], rel=1e-10)


def test_batch_is_the_loop():
    """Any shape, each value on its own."""
    profile = TanhProfile(0.2, HEIGHT, 0.05)
    jets = np.array([[1.0, 2.0], [3.0, 40.0]])
    found = penetration_height(jets, 1e-3, profile)
    assert found.shape == (2, 2)
    assert found[1, 1] == float(penetration_height(40.0, 1e-3, profile))


def test_jet_velocity():
    """172 m/s, without the 1/sqrt(2) of the print, which has 122; 15 dB are 5.6 in velocity, not 60."""
    assert jet_velocity(145, 0.05, 0.1) == pytest.approx(172.14, abs=0.01)
    assert jet_velocity(145, 0.05, 0.5j) / jet_velocity(130, 0.05, 0.5) == pytest.approx(10**0.75, rel=1e-12)
    doubled = tl.Fluid(density=2 * 1.204)
    assert jet_velocity(120, 0.1, 1 + 1j, doubled) == pytest.approx(jet_velocity(120, 0.2, 1 + 1j), rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((145, 5.0, 1.0), "porosity is 5; it is a fraction"),
        ((145, 0.0, 1.0), "porosity is 0"),
        ((145, 0.05, 0.0), r"\|impedance\| is 0"),
    ],
)
def test_jet_velocity_refuses(arguments, message):
    with pytest.raises(ValueError, match=message):
        jet_velocity(*arguments)


@pytest.mark.parametrize(
    ("jet", "diameter", "message"),
    [
        (1e5, 1e-3, "reaches the middle of the duct, 25 mm"),
        (0.0, 1e-3, "jet velocity is in m/s; it must be finite and above 0"),
        (1e-30, 1e-3, "stays below"),
        (5.0, 0.0, "jet diameter"),
    ],
)
def test_penetration_refuses(jet, diameter, message):
    with pytest.raises(ValueError, match=message):
        penetration_height(jet, diameter, TanhProfile(0.3, HEIGHT, 0.05))


def test_fit_exponent_refuses():
    with pytest.raises(ValueError, match="at least two different x"):
        fit_exponent([1.0, 1.0], [1.0, 2.0])
    with pytest.raises(ValueError, match="must be above 0"):
        fit_exponent([1.0, 2.0], [0.0, 2.0])


def test_exponents_that_come_out():
    """Frozen: U_j 1-120 m/s, M 0.1-0.4, d = 1 mm, 50 mm duct; -0.5 of (A4) does not come out."""
    thin, thick = jet_scaling(0.05), jet_scaling(0.1)
    assert thin.velocity_exponents == pytest.approx([0.4950, 0.4594, 0.4437, 0.4349], abs=1e-4)
    assert thick.velocity_exponents == pytest.approx([0.4445, 0.4257, 0.4186, 0.4147], abs=1e-4)
    assert (thin.mach_exponent, thick.mach_exponent) == pytest.approx((-0.4233, -0.4098), abs=1e-4)
    faster = [jet_scaling(0.05, fixed_velocity=u).mach_exponent for u in (1.0, 20.0, 60.0)]
    assert faster == pytest.approx([-0.4064, -0.4712, -0.5586], abs=2e-3)
