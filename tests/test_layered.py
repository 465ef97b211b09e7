"""Liners of several layers: limits, a case by hand, passivity, gradients, files, bad input."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Annotated, Any

import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import torchliner as tl
from torchliner.liners.catalogue import liner_text
from torchliner.liners.laws import LAWS
from torchliner.liners.model import Number
from torchliner.liners.plates import Sheet

AIR = tl.Fluid()
SMOOTH = tl.Fluid(dynamic_viscosity=1e-15)  # in which cavities lose nothing
BAND = torch.linspace(200.0, 5000.0, 97, dtype=torch.float64)
SPEEDS = torch.tensor([[0.0], [0.3], [2.0], [9.0]], dtype=torch.float64)


def perforate(thickness, diameter, porosity, vena_contracta=0.8):
    return tl.sheet(
        "perforate", thickness=thickness, orifice_diameter=diameter, porosity=porosity, vena_contracta=vena_contracta
    )


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
    """A new law is a class and a row."""
    LAWS["weave"] = Woven
    yield
    del LAWS["weave"]


def Weave(resistance, slope=0.0, mass=0.0):
    return tl.sheet("weave", resistance=resistance, slope=slope, mass=mass)


def cavity(depth=20e-3, porosity=1.0):
    return tl.Cavity(depth, 5e-3, porosity)


def difference(one, other, **at):
    """Largest |dR| over band and speeds."""
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
    shared = ("open_area_fraction", "velocity_gain", "offset_resistance", "temperature", "pressure")
    for number in shared:
        assert found.numbers()[number] == wanted.numbers()[number]
    if name not in ("name", "cell_pitch", "flow_facing_porosity"):
        assert found.resonance() == pytest.approx(wanted.resonance(), rel=1e-9)


def lossless(depth, omega):
    """Its own arithmetic: tan and cos of k h."""
    return math.tan(omega * depth / AIR.sound_speed), math.cos(omega * depth / AIR.sound_speed)


def test_two_degrees_of_freedom_worked_by_hand():
    """1000 Hz, |v| = 2 m/s, cavities that lose nothing: every step written out.

    Lower cavity 15 mm: -j cot kh. The septum at rest, 0.5 + 2e-5 j omega, on top of it; 25 mm up
    the line Z -> (Z + j tan/phi)/(1 + j phi Z tan), phi 0.8. Velocity at the septum over that at
    the facesheet 1/|cos + j phi Z sin|; with it the septum's resistance, and once more up the line.
    """
    omega, speed = 2 * math.pi * 1000.0, 2.0
    lower, _ = lossless(15e-3, omega)
    upper, cosine = lossless(25e-3, omega)

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
    """A sheet without any impedance changes nothing, wherever it is, losses included."""
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
    """Perforate plus mesh on one cavity; both see the measured |v|."""
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
    """gradcheck of Z over all numbers, backward and forward, through the speed at the septum."""
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
    """They are what the layers hold, with their units; a copy with others differs there alone."""
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
    """Its keys and ranges come from its fields."""
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
        ([PLATE, cavity()], {"cell_pitch": 0.5e-3}, "orifice_diameter is 0.001 m, larger than"),
        ([PLATE, cavity()], {"open_area_fraction": 55}, "open_area_fraction is 55; .* at most 1"),
    ],
)
def test_stacks_that_are_no_liner_are_refused(layers, more, message):
    with pytest.raises(ValueError, match=message):
        tl.LayeredLiner(layers, **more)
    with pytest.raises(TypeError, match=r"layer 2 is 0\.02; a sheet or a Cavity"):
        tl.LayeredLiner([PLATE, 0.02])
