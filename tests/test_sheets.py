"""Sheets: each law by hand, against other methods and codes, at its limits, and with bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_banded
from scipy.special import j0, jn_zeros, jv

import torchliner as tl
from torchliner.liners.laws import LAWS as ROWS
from torchliner.liners.model import arguments_of
from torchliner.liners.plates import Sheet, fok_sum, tube_impedance

LAWS = [*ROWS]
FIELDS = {name: [*arguments_of(row)] for name, row in ROWS.items()}
PLATES = [name for name in LAWS if "porosity" in FIELDS[name]]
GRAZED = [name for name in PLATES if "mach" in FIELDS[name]]
AIR = tl.Fluid()
ROUND = tl.Fluid(sound_speed=340.0, density=1.2, dynamic_viscosity=1.8e-5)  # nu 1.5e-5, rho c 408
COMMON = {"thickness": 0.8e-3, "orifice_diameter": 1e-3, "porosity": 0.05}
NEED = {"mesh": {"resistance_rayl": 100.0}}


def make(law: str, **numbers) -> Sheet:
    """The law with the common plate, or with what a mesh needs, and other numbers."""
    return tl.sheet(law, **{**NEED.get(law, COMMON), **numbers})


def in_flow(law: str, mach: float, **numbers) -> Sheet:
    """The law with Mach number, and a displacement thickness of 1.5 mm where it takes one."""
    if "displacement_thickness" in FIELDS[law]:
        numbers = {"displacement_thickness": 1.5e-3, **numbers}
    return make(law, mach=mach, **numbers)


def z(sheet: Sheet, frequency: float, speed: float = 0.0, fluid: tl.Fluid = AIR) -> complex:
    """Z at one frequency and speed."""
    omega, speed = (torch.tensor(x, dtype=torch.float64) for x in (frequency * math.tau, speed))
    return complex(sheet.impedance(omega, speed, fluid))


# By hand, in a gas of c 340, nu 1.5e-5, rho c 408: omega 6800/s, k 20/m, t = d = 1 mm,
# sigma 4 % (root 0.2), C_D 0.8, |v| 1.36 m/s, so M_0 = 1.36/13.6 = 0.1; M 0.2: 305 M^3 = 2.44.
HAND = {"thickness": 1e-3, "orifice_diameter": 1e-3, "porosity": 0.04}
HAND_FREQUENCY, HAND_SPEED = 6800 / math.tau, 1.36


def test_guess_by_hand():
    """Friction 2 sqrt(0.816)/13.6 = 0.132842, radiation 4e-4/0.32 = 0.00125, jets 24.96 (0.1 +
    0.06) = 3.9936; delta = 0.848826 mm * 0.86 * 51/101/3.44 = 0.107154 mm, mass 500 (t + delta)."""
    sheet = tl.sheet("guess", **HAND, mach=0.2)
    found = z(sheet, HAND_FREQUENCY, HAND_SPEED, ROUND)
    assert found == pytest.approx(4.127692 + 0.686419j, abs=2e-6)
    assert sheet.flow_resistance == pytest.approx(24.96 * 0.06)


def test_two_parameter_by_hand():
    """sigma C_D = 0.032: friction 4.8e-7/1.088e-5 = 0.044118, jets 1.36/0.69632 = 1.953125, flow
    0.2/(0.04 * 3.884) = 1.287333; epsilon = 0.731/3.44 = 0.2125, mass 500 * 1.2125e-3."""
    sheet = tl.sheet("two-parameter", **HAND, discharge_coefficient=0.8, mach=0.2, displacement_thickness=1.5e-3)
    found = z(sheet, HAND_FREQUENCY, HAND_SPEED, ROUND)
    assert found == pytest.approx(3.284576 + 0.60625j, abs=2e-6)
    assert sheet.flow_resistance == pytest.approx(1.287333, abs=1e-6)


# What |v| adds, of the jet's slope 1.953125 * 0.9984 = 1.95: Melling 1.200422 of it; Maa 3.2/pi of
# it, and of the mass 0.85 * 20e-3/0.04 = 0.425 it leaves 1/(1 + 1.36/(340 * 0.0016)) = 1/3.5.
# Goodrich has C_D = 0.80695 sqrt(0.724779 * 1.660635) = 0.885292, so 1.336541 * 0.9984 * 1.36 /
# (1.088 * 0.783742), and takes 2.07e-5 * 20/0.0016 * 1.36 of mass.
ADDED = {"goodrich": 2.128256 - 0.35190j, "melling": 2.340823, "maa": 1.986254 - 0.303571j}


@pytest.mark.parametrize(("law", "wanted"), ADDED.items())
def test_what_speed_adds_by_hand(law, wanted):
    """The nonlinear terms alone."""
    stated = {} if law == "goodrich" else {"discharge_coefficient": 0.8}
    sheet = tl.sheet(law, **HAND, **stated)
    added = z(sheet, HAND_FREQUENCY, HAND_SPEED, ROUND) - z(sheet, HAND_FREQUENCY, 0.0, ROUND)
    assert added == pytest.approx(wanted, abs=2e-6)


def oscillating_flow(radius: float, omega: float, viscosity: float, rings: int = 4000) -> complex:
    """Mean of u, of j omega u = 1 + nu (u'' + u'/r), u(radius) = 0, by finite volumes."""
    step = radius / rings
    edges = np.arange(rings + 1) * step
    flux = viscosity * edges / step
    flux[-1] *= 2  # half a ring to the wall
    volume = (edges[1:] ** 2 - edges[:-1] ** 2) / 2
    bands = np.zeros((3, rings), complex)
    bands[0, 1:], bands[2, :-1] = -flux[1:-1], -flux[1:-1]
    bands[1] = 1j * omega * volume + flux[:-1] + flux[1:]
    return solve_banded((1, 1), bands, volume) @ volume / (radius**2 / 2)


@pytest.mark.parametrize("frequency", [1.0, 60.0, 400.0, 1500.0, 6000.0])
@pytest.mark.parametrize("diameter", [0.15e-3, 1e-3])
def test_tube_against_the_flow_in_it(frequency, diameter):
    """Crandall's tube and the flow solved ring by ring, and ordinary Bessel functions."""
    omega = frequency * math.tau
    numbers = (torch.tensor(x, dtype=torch.float64) for x in (omega, 2e-3, diameter))
    found = complex(tube_impedance(*numbers, AIR))
    flow = oscillating_flow(diameter / 2, omega, AIR.kinematic_viscosity)
    assert found == pytest.approx(2e-3 / AIR.sound_speed / flow, rel=2e-6)
    x = diameter / 2 * np.sqrt(-1j * omega / AIR.kinematic_viscosity)
    viscous = 1 - 2 * jv(1, x) / (x * jv(0, x))
    assert found == pytest.approx(1j * omega * 2e-3 / AIR.sound_speed / viscous, rel=1e-9)


@pytest.mark.parametrize(("ratio", "off"), [(0.05, 2e-4), (0.2, 1e-4), (0.3, 1e-4), (0.4, 3e-4), (0.5, 2e-3)])
def test_fok_against_potential_flow(ratio, off):
    """Rayleigh-Ritz in a tube with a disc: velocity 1/sqrt(1 - r^2) in the hole, Bessel series.

    Such a trial is too heavy by the square of its error, which grows with the ratio.
    """
    root = jn_zeros(1, 20000)
    wanted = (np.sin(root * ratio) ** 2 / (root**3 * j0(root) ** 2)).sum() / ratio / (math.pi / 4)
    found = float(fok_sum(torch.tensor(ratio**2, dtype=torch.float64)))
    assert found == pytest.approx(wanted, rel=off)


# Other codes. The values are what they print for the numbers in the test.


@pytest.mark.parametrize("constant", [0.1, 1.0, 3.0, 5.5, 10.0])
def test_maa_against_his_approximation(constant):
    """Maa's rational form, as acoustipy documents it, is within 6.5 % of the exact tube."""
    diameter, thickness, porosity = 0.3e-3, 0.5e-3, 0.01
    nu, c = AIR.kinematic_viscosity, AIR.sound_speed
    omega = 4 * nu * (constant / diameter) ** 2
    friction = 32 * nu * thickness / (porosity * c * diameter**2)
    resistance = friction * ((1 + constant**2 / 32) ** 0.5 + 2**0.5 / 32 * constant * diameter / thickness)
    shape = 1 + (9 + constant**2 / 2) ** -0.5 + 0.85 * diameter / thickness
    found = z(tl.sheet("maa", thickness=thickness, orifice_diameter=diameter, porosity=porosity), omega / math.tau)
    assert found.real == pytest.approx(resistance, rel=0.065)
    assert found.imag == pytest.approx(omega * thickness / (porosity * c) * shape, rel=0.065)


@pytest.mark.parametrize(
    ("law", "longer"), [("maa", 0.0), ("melling", 0.849 * 0.689), ("goodrich", 0.85 * 0.843), ("two-parameter", 0.0)]
)
def test_slow_flow_is_poiseuilles(law, longer):
    """32 nu L/(c sigma d^2), L the thickness or with its end correction, in diameters; in the
    two-parameter model over C_D. Guess has no such limit: friction vanishes with omega."""
    numbers = {"discharge_coefficient": 1.0, "edge_factor": 0.0}
    known = {n: x for n, x in numbers.items() if n in FIELDS[law]}
    length = COMMON["thickness"] + longer * 1e-3
    wanted = 32 * AIR.kinematic_viscosity * length / (AIR.sound_speed * 0.05 * 1e-6)
    assert z(make(law, **known), 1e-3).real == pytest.approx(wanted, rel=2e-3)
    assert z(make("guess"), 1e-3).real < 0.01 * wanted


@pytest.mark.parametrize("law", GRAZED)
def test_flow_adds_resistance_and_takes_mass(law):
    """Mach 0 is no flow; else R rises by ``flow_resistance`` (and what friction in the lost end
    correction was worth) and the end correction falls by 1/(1 + 305 M^3)."""
    still, moved = make(law), in_flow(law, 0.3)
    assert z(in_flow(law, 0.0), 1500.0, 2.0) == z(still, 1500.0, 2.0)
    assert still.flow_resistance == 0
    difference = z(moved, 1500.0) - z(still, 1500.0)
    assert difference.real == pytest.approx(moved.flow_resistance, abs=0.05)
    lost = 0.85e-3 * (1 - 0.7 * 0.05**0.5) * (1 - 1 / 9.235) * 1500 * math.tau / 0.05 / 343.2
    assert difference.imag == pytest.approx(-lost, rel=0.12)


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data(), frequency=st.floats(1e-3, 1e6), speed=st.floats(0, 30))
def test_passive_and_finite_everywhere(data, frequency, speed):
    """Re Z >= 0, so |R| <= 1, of every law, for any plate and flow, 1e-3 Hz to 1 MHz."""
    law = data.draw(st.sampled_from(LAWS))
    ranges = {
        "thickness": (1e-5, 0.1),
        "orifice_diameter": (1e-5, 0.1),
        "porosity": (1e-3, 1),
        "mach": (0, 1),
        "displacement_thickness": (1e-6, 0.1),
        "edge_factor": (0, 10),
        "discharge_coefficient": (0.1, 1),
        "vena_contracta": (0.1, 1),
        "resistance_rayl": (0, 1e5),
        "resistance_slope_rayl": (0, 1e5),
        "surface_mass": (0, 10),
    }
    numbers = {name: data.draw(st.floats(*ranges[name])) for name in FIELDS[law]}
    ends = numbers.get("orifice_diameter", 0) * (1.14 * numbers.get("porosity", 0) ** 0.5 - 1)
    if law == "goodrich":
        numbers["thickness"] = min(numbers["thickness"], 0.8 * numbers["orifice_diameter"])
    assume(law != "perforate" or 0.85 * ends < numbers["thickness"])
    sheet = tl.sheet(law, **numbers)
    impedance = z(sheet, frequency, speed)
    assert 0 <= impedance.real < math.inf
    assert math.isfinite(impedance.imag)
    assert abs(1 - 2 / (impedance + 1)) <= 1 + 1e-12


@pytest.mark.parametrize("law", LAWS)
def test_derivatives(law):
    """Backward and forward, in every parameter, omega, |v|, sound speed and viscosity."""
    start = in_flow(law, 0.2) if law in GRAZED else make(law)
    if law == "mesh":
        start = make(law, resistance_slope_rayl=50.0, surface_mass=0.02)
    names = list(start.numbers())
    scale = [start.numbers()[name].value for name in names]

    def impedance(omega, speed, sound_speed, viscosity, *shares):
        values = {n: s * x for n, s, x in zip(names, scale, shares, strict=True)}
        gas = tl.Fluid(sound_speed=343.2 * sound_speed, dynamic_viscosity=1.8e-5 * viscosity)
        return torch.view_as_real(tl.sheet(law, **values).impedance(9e3 * omega, 2 * speed, gas))

    ones = [torch.ones((), dtype=torch.float64, requires_grad=True) for _ in names + [0] * 4]
    assert torch.autograd.gradcheck(impedance, ones, eps=1e-6, atol=1e-6, check_forward_ad=True)
    found = impedance(*ones)
    slopes = torch.autograd.grad(found.sum(), ones[4:])
    assert all(float(slope.abs()) > 1e-9 for slope in slopes), "a parameter does not enter"


BAD = [
    ("melling", {"porosity": 5.5}, r"'melling': porosity is 5.5; .* at most 1 \(5 % is 0.05\)"),
    ("perforate", {"porosity": 1.0, "thickness": 1e-4}, r"-1.9e-05 m together .*holds to 0.77"),
    ("guess", {"porosity": 0.0}, "porosity is 0; it is above 0"),
    ("goodrich", {"mach": -0.1}, "mach is -0.1; it is at least 0"),
    ("goodrich", {"mach": 0.3}, "mach is 0.3 and displacement_thickness is 0 m; state it"),
    ("mesh", {"resistance_rayl": -1.0}, "resistance_rayl is -1 Pa s/m; it is at least 0"),
    ("goodrich", {"thickness": 2e-3}, "discharge coefficient of 1.15; .* holds to 1, law 'two-p"),
]


@pytest.mark.parametrize(("law", "change", "message"), BAD)
def test_bad_input(law, change, message):
    """The law, the parameter, its value, unit and limit."""
    with pytest.raises(ValueError, match=message):
        make(law, **change)
