"""Sheets and liners of several layers: each law by hand and against others, limits, passivity, gradients, files."""

import cmath
import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_banded
from scipy.special import jv

import torchliner as tl
from torchliner.liners.catalogue import liner_text
from torchliner.liners.laws import LAWS
from torchliner.liners.model import Number, arguments_of
from torchliner.liners.plates import Sheet, tube_impedance

AIR = tl.Fluid()
SMOOTH = tl.Fluid(dynamic_viscosity=1e-15)  # in which cavities lose nothing
BAND = torch.linspace(200.0, 5000.0, 97, dtype=torch.float64)
SPEEDS = torch.tensor([[0.0], [0.3], [2.0], [9.0]], dtype=torch.float64)


def perforate(thickness, diameter, porosity, contraction=0.8):
    about = {"thickness": thickness, "orifice_diameter": diameter, "porosity": porosity, "vena_contracta": contraction}
    return tl.sheet("perforate", **about)


PLATE = perforate(0.6e-3, 1e-3, 0.06, 0.75)


@dataclass(frozen=True, kw_only=True)
class Woven(Sheet):
    """R0 + R1 |v| + j omega m, all normalised, m in s: enough to work by hand."""

    kind = "weave"

    resistance: Annotated[Any, Number(low_included=True)]
    slope: Annotated[Any, Number(unit="s/m", low_included=True)] = 0.0
    mass: Annotated[Any, Number(unit="s", low_included=True)] = 0.0

    def impedance(self, omega, speed, fluid):
        return self.resistance + self.slope * speed + 1j * self.mass * omega


@pytest.fixture(autouse=True, scope="module")
def weave_law():
    LAWS["weave"] = Woven
    yield
    del LAWS["weave"]


def Weave(resistance, slope=0.0, mass=0.0):
    return tl.sheet("weave", resistance=resistance, slope=slope, mass=mass)


def cavity(depth=20e-3, porosity=1.0):
    return tl.Cavity(depth, 5e-3, porosity)


def difference(one, other, **at):
    found = [tl.reflection_from_impedance(each.impedance(BAND, SPEEDS)) for each in (one, other)]
    return float((found[0] - found[1]).abs().max())


SHARED = {
    "open_area_fraction": 0.63,
    "velocity_reading": "conserved",
    "velocity_gain": 1.3,
    "impedance_offset": 0.1 - 0.02j,
    "cell_pitch": 12e-3,
    "flow_facing_porosity": 0.04,
    "fluid": tl.Fluid.from_temperature(310.0, 9e4),
    "name": "cell",
}


@pytest.mark.parametrize("name", [None, *SHARED])
def test_one_perforate_over_one_cavity_is_the_sdof(name):
    """With any of the arguments that both have, to rounding; numbers of cell and gas too."""
    more = {} if name is None else {name: SHARED[name]}
    wanted = tl.SDoFLiner(0.6e-3, 1e-3, 0.06, 20e-3, 5e-3, 0.8, vena_contracta=0.75, **more)
    found = tl.LayeredLiner([PLATE, cavity(porosity=0.8)], **more)
    z, z0 = (each.impedance(BAND, SPEEDS) for each in (found, wanted))
    assert float(((z - z0) / z0).abs().max()) < 1e-13
    assert found.surface_porosity == wanted.surface_porosity
    assert (found.hole_diameter, found.cell_pitch) == (wanted.hole_diameter, wanted.cell_pitch)
    for number in ("open_area_fraction", "velocity_gain", "offset_resistance", "temperature", "pressure"):
        assert found.numbers()[number] == wanted.numbers()[number]
    if name not in ("name", "cell_pitch", "flow_facing_porosity"):
        assert found.resonance() == pytest.approx(wanted.resonance(), rel=1e-9)


def test_two_degrees_of_freedom_worked_by_hand():
    """1000 Hz, |v| = 2 m/s, cavities that lose nothing: every step written out.

    Lower cavity 15 mm: -j cot kh. The septum at rest, 0.5 + 2e-5 j omega, on top of it; 25 mm up
    the line Z -> (Z + j tan/phi)/(1 + j phi Z tan), phi 0.8. Velocity at the septum over that at
    the facesheet 1/|cos + j phi Z sin|; with it the septum's resistance, and once more up the line.
    """
    omega, speed = 2 * math.pi * 1000.0, 2.0
    lower, upper = (math.tan(omega * depth / AIR.sound_speed) for depth in (15e-3, 25e-3))
    cosine = math.cos(omega * 25e-3 / AIR.sound_speed)

    def up(z):
        return (z + 1j * upper / 0.8) / (1 + 0.8j * z * upper)

    behind = -1j / lower
    at_rest = 0.5 + 2e-5j * omega + behind
    ratio = 1 / abs(cosine * (1 + 0.8j * at_rest * upper))
    loud = 0.5 + 0.3 * ratio * speed + 2e-5j * omega + behind
    wanted = 0.1 + 0.05 * speed + up(loud)
    liner = tl.LayeredLiner([Weave(0.1, 0.05), cavity(25e-3, 0.8), Weave(0.5, 0.3, 2e-5), cavity(15e-3)], fluid=SMOOTH)
    assert complex(liner.impedance(1000.0, speed)) == pytest.approx(wanted, rel=2e-6)
    assert abs(ratio - 1) > 0.05  # the septum does not just see |v|


def test_a_transparent_septum_is_one_deep_cavity():
    one = tl.LayeredLiner([PLATE, cavity(40e-3)])
    for depth in (1e-3, 13e-3, 39e-3):
        both = tl.LayeredLiner([PLATE, cavity(depth), Weave(0.0), cavity(40e-3 - depth)])
        assert difference(one, both) < 1e-13
    assert difference(one, tl.LayeredLiner([PLATE, cavity(10e-3), cavity(30e-3)])) < 1e-13
    below = [PLATE, cavity(22e-3, 0.7)]  # a septum that |v| at it tells apart
    parted = [PLATE, cavity(6e-3, 0.7), Weave(0.0), cavity(7e-3, 0.7), *below]
    whole = tl.LayeredLiner([PLATE, cavity(13e-3, 0.7), *below])
    assert difference(whole, tl.LayeredLiner(parted)) < 1e-12
    seen = tl.LayeredLiner([PLATE, cavity(13e-3), Weave(1.0), cavity(27e-3)])
    assert difference(one, seen) > 0.1


def test_sheets_in_series_add():
    mesh = Weave(0.4, 0.2, 1e-5)
    omega = 2 * torch.pi * BAND
    one = tl.LayeredLiner([PLATE, cavity()]).impedance(BAND, SPEEDS)
    found = tl.LayeredLiner([PLATE, mesh, cavity()]).impedance(BAND, SPEEDS)
    torch.testing.assert_close(found - one, mesh.impedance(omega, SPEEDS, AIR) + 0 * one)
    swapped = tl.LayeredLiner([mesh, PLATE, cavity()])
    assert difference(swapped, tl.LayeredLiner([PLATE, mesh, cavity()])) < 1e-14
    assert swapped.hole_diameter is None and swapped.surface_porosity is None  # noqa: PT018


sheets = st.one_of(
    st.builds(perforate, st.floats(2e-4, 3e-3), st.floats(1e-4, 3e-3), st.floats(0.005, 0.6)),
    st.builds(Weave, st.floats(0, 50), st.floats(0, 10), st.floats(0, 1e-3)),
)
cavities = st.builds(tl.Cavity, st.floats(1e-4, 0.5), st.floats(2e-4, 0.1), st.floats(0.05, 1))
stacks = st.tuples(
    st.lists(sheets, min_size=1, max_size=2), st.lists(st.one_of(sheets, cavities), max_size=4), cavities
).map(lambda parts: [*parts[0], *parts[1], parts[2]])


@settings(max_examples=150)
@given(layers=stacks, frequency=st.floats(1, 2e5), speed=st.floats(0, 30))
def test_any_stack_is_passive(layers, frequency, speed):
    """|R| <= 1, finite, from 1 Hz to 200 kHz and up to 30 m/s."""
    found = complex(tl.LayeredLiner(layers).impedance(frequency, speed))
    assert abs(complex(tl.reflection_from_impedance(torch.tensor(found)))) <= 1 + 1e-12


@settings(max_examples=50)
@given(frequency=st.floats(500, 6000), upper=st.floats(5e-3, 0.1), lower=st.floats(5e-3, 0.1), speed=st.floats(0, 10))
def test_energy_goes_where_the_resistances_are(frequency, upper, lower, speed):
    """Without losses in the air Re Z |v|^2 is R_1 |v|^2 + R_2 |v_s|^2, |v_s| = ratio |v|."""
    layers = [Weave(0.2), cavity(upper), Weave(0.7), cavity(lower)]
    linear = tl.LayeredLiner(layers, fluid=SMOOTH)
    z = complex(linear.impedance(frequency, speed))
    k = 2 * math.pi * frequency / AIR.sound_speed
    assume(abs(math.sin(k * lower)) > 0.1)  # there even what little the air loses counts
    below = 0.7 - 1j / math.tan(k * lower)
    ratio = 1 / abs(cmath.cos(k * upper) + 1j * below * cmath.sin(k * upper))
    assert z.real == pytest.approx(0.2 + 0.7 * ratio**2, rel=1e-4, abs=1e-6)


DOUBLE = tl.LayeredLiner([PLATE, cavity(15e-3, 0.9), perforate(0.8e-3, 0.3e-3, 0.04), cavity(22e-3, 0.9)])


def test_every_number_has_a_gradient():
    liner = DOUBLE.replace(impedance_offset=0.1 + 0.05j, open_area_fraction=0.7)
    names = [name for name in liner.numbers() if not name.startswith("offset")]
    scales = [liner.numbers()[name].value for name in names]

    def impedance(*shares):
        values = {n: s * x for n, s, x in zip(names, scales, shares, strict=True)}
        z = liner.with_numbers(values).impedance([800.0, 2100.0], [0.0, 2.0])
        return torch.view_as_real(z)

    ones = [torch.ones((), dtype=torch.float64, requires_grad=True) for _ in names]
    check = {"eps": 1e-6, "atol": 1e-5, "check_forward_ad": True, "fast_mode": True}
    assert torch.autograd.gradcheck(impedance, ones, **check)


def test_numbers_are_named_by_layer():
    numbers = DOUBLE.numbers()
    assert list(DOUBLE.named_layers()) == ["facesheet", "cavity", "septum", "cavity2"]
    assert (numbers["septum.porosity"].value, numbers["septum.porosity"].high) == (0.04, 1.0)
    assert (numbers["cavity2.depth"].value, numbers["cavity2.depth"].unit) == (22e-3, "m")
    moved = DOUBLE.with_numbers({"cavity2.depth": 30e-3, "temperature": 350.0})
    assert moved.layers[:3] == DOUBLE.layers[:3]
    assert moved.layers[3] == cavity(30e-3, 0.9)
    assert moved.fluid.sound_speed > DOUBLE.fluid.sound_speed
    assert moved.with_numbers({"cavity2.depth": 22e-3}).layers == DOUBLE.layers
    with pytest.raises(ValueError, match=r"'cavity': depth is -0.01 m; it is above 0 m"):
        DOUBLE.with_numbers({"cavity2.depth": -0.01})


@pytest.mark.parametrize("more", [{}, SHARED])
def test_a_liner_is_read_back_from_its_text(tmp_path, more):
    (tmp_path / "mine.toml").write_text(liner_text(DOUBLE.replace(**more), "me"))
    assert tl.load_liner(tmp_path / "mine.toml") == DOUBLE.replace(**more)


def test_a_new_law_needs_no_code_in_the_files(tmp_path):
    liner = tl.LayeredLiner([tl.sheet("weave", resistance=0.3, mass=1e-5), cavity()], name="w")
    (tmp_path / "w.toml").write_text(liner_text(liner, "me"))
    assert tl.load_liner(tmp_path / "w.toml") == liner
    with pytest.raises(ValueError, match=r"law of a sheet 'weeve' \(did you mean 'weave'\?\)"):
        tl.sheet("weeve")
    with pytest.raises(TypeError, match="resist"):
        tl.sheet("weave", resist=0.3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "layers: missing"),
        ("layers = [3]", r"layers\.0 = 3.*\[\[layers\]\]"),
        ("layers = []", "layers none; the first is the sheet"),
        ("[[layers]]\ndepth = 1", r"layers\.0: kind is None.*perforate"),
        ("[[layers]]\nkind = 'cavty'", r"layers\.0: kind is 'cavty'.*'cavity'"),
        ("[[layers]]\nkind = 'weave'\nresistence = 1", r"layers\.0\.weave\.resistence: .*'resistance'"),
        ("[[layers]]\nkind = 'cavity'\ndepth = 38.1\nhydraulic_radius = 1e-3", "depth is 38.1 m; .*at most 10 m"),
    ],
)
def test_files_that_are_no_stack_are_refused(tmp_path, text, message):
    (tmp_path / "a.toml").write_text(f"model = 'layered'\n{text}\n")
    with pytest.raises(ValueError, match=f"a.toml: .*{message}"):
        tl.load_liner(tmp_path / "a.toml")


@pytest.mark.parametrize(
    ("layers", "more", "message"),
    [
        ([cavity(), PLATE, cavity()], {}, "layers cavity, septum, cavity2; the first is the sheet"),
        ([PLATE, cavity(), PLATE], {}, "layers facesheet, cavity, septum; .* the last a cavity"),
        ([PLATE, cavity()], {"open_area_fraction": 55}, "open_area_fraction is 55; .* at most 1"),
        ([PLATE, 0.02], {}, r"layer 2 is 0\.02; a sheet or a Cavity"),
    ],
)
def test_stacks_that_are_no_liner_are_refused(layers, more, message):
    with pytest.raises((ValueError, TypeError), match=message):
        tl.LayeredLiner(layers, **more)


KINDS = [*LAWS]
FIELDS = {name: [*arguments_of(row)] for name, row in LAWS.items()}
PLATES = [name for name in KINDS if "porosity" in FIELDS[name]]
GRAZED = [name for name in PLATES if "mach" in FIELDS[name]]
ROUND = tl.Fluid(sound_speed=340.0, density=1.2, dynamic_viscosity=1.8e-5)  # nu 1.5e-5, rho c 408
COMMON = {"thickness": 0.8e-3, "orifice_diameter": 1e-3, "porosity": 0.05}
NEED = {"mesh": {"resistance_rayl": 100.0}}


def make(law: str, **numbers) -> Sheet:
    return tl.sheet(law, **{**NEED.get(law, COMMON), **numbers})


def in_flow(law: str, mach: float, **numbers) -> Sheet:
    if "displacement_thickness" in FIELDS[law]:
        numbers = {"displacement_thickness": 1.5e-3, **numbers}
    return make(law, mach=mach, **numbers)


def z(sheet: Sheet, frequency: float, speed: float = 0.0, fluid: tl.Fluid = AIR) -> complex:
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


# What |v| adds, of the jet's slope 1.953125 * 0.9984 = 1.95: Maa 3.2/pi of
# it, and of the mass 0.85 * 20e-3/0.04 = 0.425 it leaves 1/(1 + 1.36/(340 * 0.0016)) = 1/3.5.
# Goodrich has C_D = 0.80695 sqrt(0.724779 * 1.660635) = 0.885292, so 1.336541 * 0.9984 * 1.36 /
# (1.088 * 0.783742), and takes 2.07e-5 * 20/0.0016 * 1.36 of mass.
ADDED = {"goodrich": 2.128256 - 0.35190j, "maa": 1.986254 - 0.303571j}


@pytest.mark.parametrize(("law", "wanted"), ADDED.items())
def test_what_speed_adds_by_hand(law, wanted):
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


@pytest.mark.parametrize(("law", "longer"), [("maa", 0.0), ("goodrich", 0.85 * 0.843)])
def test_slow_flow_is_poiseuilles(law, longer):
    """32 nu L/(c sigma d^2), L the thickness or with its end correction, in diameters. Guess has no such limit:
    friction vanishes with omega."""
    known = {"edge_factor": 0.0} if law == "maa" else {}
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
    law = data.draw(st.sampled_from(KINDS))
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


@pytest.mark.parametrize("law", KINDS)
def test_derivatives(law):
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


@pytest.mark.parametrize(
    ("law", "change", "message"),
    [
        ("maa", {"porosity": 5.5}, r"'maa': porosity is 5.5; .* at most 1 \(5 % is 0.05\)"),
        ("guess", {"porosity": 0.0}, "porosity is 0; it is above 0"),
        ("goodrich", {"mach": -0.1}, "mach is -0.1; it is at least 0"),
        ("goodrich", {"mach": 0.3}, "mach is 0.3 and displacement_thickness is 0 m; state it"),
        ("mesh", {"resistance_rayl": -1.0}, "resistance_rayl is -1 Pa s/m; it is at least 0"),
        ("goodrich", {"thickness": 2e-3}, "discharge coefficient of 1.15; .* holds to 1"),
    ],
)
def test_bad_input(law, change, message):
    with pytest.raises(ValueError, match=message):
        make(law, **change)
