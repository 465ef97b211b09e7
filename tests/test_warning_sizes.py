"""Sizes of warnings: each is what its words say, by a way of its own; the list goes by them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, turbulence
from test_closure import (
    LEVELS,
    MODEL,
    OF_AIR,
    TIGHT,
    facesheet_record,
    incident_level_of,
    plane,
    square_wave,
)

import torchliner as tl
from torchliner.liners.layered import Cavity
from torchliner.report.page.sizes import KINDS, whole_line, whole_map, whole_points
from torchliner.report.page.subject import subject_of
from torchliner.report.page.warned import listed, of_map, size_of, sized_warnings
from torchliner.report.typesetting import typeset

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
WRONG = 1.9 - 0.8j  # the model has 0.8 - 0.15j
X = {"x": np.arange(6) * 1e-3}


def known(found, liner=None):
    return whole_map(subject_of(found, liner=liner))


def size(found, words, liner=None):
    """Of the one warning with these words."""
    (text,) = (note for note in found.notes if words in note)
    return size_of(text, known(found, liner))


@pytest.mark.parametrize("height", [None, 0.02])
def test_what_closes_is_an_impedance_with_that_level(height):
    """At normal incidence, from the sum of incident and reflected wave."""
    velocity, amplitude = square_wave(2.0)
    level = incident_level_of(amplitude, WRONG, height or 0.0)
    found = tl.educe(plane(velocity, height=height, incident_level=level), MODEL, **TIGHT)
    there = complex(found.answer[0]) + size(found, "closure at 1400 Hz fails").change
    assert abs(complex(found.answer[0]) - there) > 0.1
    assert incident_level_of(amplitude, there, height or 0.0) == pytest.approx(level, abs=LEVELS)


@pytest.mark.parametrize(("level_of", "said"), [(WRONG, False), (-0.9 + 0.1j, True)])
def test_what_no_liner_has_is_said(level_of, said):
    """A wave that is too weak for the velocity closes with a resistance below 0 alone."""
    velocity, amplitude = square_wave(2.0)
    level = incident_level_of(amplitude, level_of, 0.0)
    found = tl.educe(plane(velocity, incident_level=level), MODEL, **TIGHT)
    sized = size(found, "closure at 1400 Hz fails")
    assert ("R below 0, which no liner has" in sized.words) == said
    assert (complex(found.answer[0] + sized.change).real < 0) == said


def test_what_closes_with_a_phase_is_the_impedance_behind_the_pressure():
    """Z V is the pressure at the wall: with size and phase both parts of Z follow."""
    velocity, amplitude = square_wave(2.0)
    p = OF_AIR.characteristic_impedance * WRONG * amplitude
    turns = 2 * torch.pi * FREQUENCY * torch.arange(velocity.shape[-1], dtype=torch.float64) / RATE
    record = facesheet_record((p.real * turns.cos() - p.imag * turns.sin()).expand(3, -1))
    side = {"source_side": "upstream"}
    found = tl.educe(plane(velocity, **side), MODEL, pressure=record, **TIGHT)
    change = size(found, "closure at 1400 Hz fails").change
    assert complex(found.answer[0]) + change == pytest.approx(WRONG, abs=1e-6)


@pytest.fixture(scope="module")
def maps(liner):
    """Of one plane: as it is, with a probe at rest, with one left out, and with a wall filter."""
    tone = torch.cos(2 * torch.pi * torch.arange(600) / 30)
    velocity = turbulence((6, 600)) + torch.arange(6)[:, None] * tone
    asked = {"interval": None, "order": "probes first"}
    found = {"whole": tl.educe(plane_of(velocity, **X), liner, **asked)}
    still, lost = velocity.clone(), velocity.clone()
    still[2] = 0
    lost[2, 5] = torch.nan
    found["still"] = tl.educe(plane_of(still, **X), liner, **asked)
    found["lost"] = tl.educe(plane_of(lost, **X), liner, missing="exclude", **asked)
    found["wall"] = tl.educe(plane_of(velocity, **X), liner, wall_filter=0.5, **asked)
    assert 0 < int(found["wall"].wall.sum()) < 5
    return found


def test_what_probes_at_rest_and_a_filter_do(maps):
    """Educed without them."""
    found = maps["still"]
    change = size(found, "exactly 0 throughout").change
    assert complex(found.answer[0]) + change == pytest.approx(complex(maps["lost"].answer[0]))
    assert abs(change) > 0.01
    found = maps["wall"]
    change = size(found, "wall filter").change
    assert complex(found.answer[0]) + change == pytest.approx(complex(maps["whole"].answer[0]))
    assert abs(change) > 0.01


def test_what_a_share_left_out_does_if_it_lies_one_spread_off(maps):
    """The mean of five and of a sixth that is one standard deviation away."""
    found = maps["lost"]
    spread = complex(found.liner_spread[0])
    mean = (5 * complex(found.answer[0]) + (complex(found.answer[0]) + spread)) / 6
    assert size(found, "nan or inf").change == pytest.approx(mean - complex(found.answer[0]))


def test_half_of_the_interval(liner):
    """Of the order of the answer."""
    found = tl.educe(plane_of(turbulence((4, 480)), x=np.arange(4) * 1e-3), liner)
    low, high = found.bounds_of_liner(found.order)
    text = "p: the error bars rest on 5 independent blocks"
    assert size_of(text, known(found)).change == (high - low) / 2


def test_another_gas_flow_and_law(liner):
    """Z of the model with the data's, less its own, at the rms of v; a law's own resistance."""
    gas = dataclasses.replace(liner.fluid, sound_speed=320.0)
    velocity = torch.full((2, 600), 3.0, dtype=torch.float64)
    found = tl.educe(plane_of(velocity, fluid=gas), liner, interval=None)
    wanted = liner.replace(fluid=gas).impedance(FREQUENCY, 3.0) - liner.impedance(FREQUENCY, 3.0)
    assert size(found, "sound speed is").change == pytest.approx(complex(wanted), rel=1e-6)
    plate = tl.sheet("goodrich", thickness=1e-3, orifice_diameter=1e-3, porosity=0.08, mach=0.3,
                     displacement_thickness=2e-3)  # fmt: skip
    mine = tl.LayeredLiner([plate, Cavity(0.04, 5e-3)])
    found = tl.educe(plane_of(velocity), mine, interval=None)
    change = size(found, "for grazing flow").change
    assert change == pytest.approx(complex(mine.flow_resistance, 0), rel=1e-2)
    adjusted = tl.AdjustedSDoFLiner.of(liner, mach=0.1, mach_resistance=0.5)
    found = tl.educe(plane_of(velocity, mach=0.3), adjusted, interval=None)
    wanted = 0.5 * 0.2 / (liner.flow_facing_porosity or liner.porosity * liner.open_area_fraction)
    assert size(found, "mach is 0.1 in the liner").change == pytest.approx(wanted, rel=1e-6)


def test_an_error_of_the_reflection_moves_both_parts_at_most_so_much(maps):
    """|dZ| for dR in any direction, by differences."""
    found = maps["whole"]
    z = complex(found.answer[0])
    r = (z - 1) / (z + 1)
    turned = [r + 1e-6 * np.exp(0.1j * i) for i in range(63)]
    moved = [(1 + each) / (1 - each) - z for each in turned]
    text = "the causal kernel is off by up to 1e-06 in R within 300-3500 Hz (limit 0.001)"
    most = size_of(text, known(found)).change
    assert most.real == pytest.approx(max(abs(each.real) for each in moved), rel=2e-3)
    assert most.imag == pytest.approx(max(abs(each.imag) for each in moved), rel=2e-3)


def test_numbers_that_the_warning_states(maps):
    """Two impedances, and a bias."""
    whole = known(maps["whole"])
    text = "p: Without this one it would be about 1.50-0.25j instead of 1.00+0.50j at 900 Hz"
    assert size_of(text, whole).change == 0.5 - 0.75j
    text = "p: the mean of the probes' admittances is off by about +0.1-0.02j in Z at 900 Hz, more"
    assert size_of(text, whole).change == 0.1 - 0.02j


def test_the_largest_of_a_kind_comes_first_and_the_unknown_last(maps):
    """Kinds in their order; each has its size beside it, or that it is unknown."""
    notes = [
        "the error bars rest on 5 independent blocks", "p: 1 of 9 probes hold nan or inf; excluded",
        "p has 3 samples per period of 1 Hz, +9 dB", "p: 3 of 9 probes hold nan or inf; excluded",
        "between velocity levels R is off by up to 0.002 (limit 0.001)",
        "the causal kernel is off by up to 0.01 in R within 300-3500 Hz", "something else",
        "null test: there is a hard wall",
    ]  # fmt: skip
    _, found = listed(sized_warnings(notes, known(maps["lost"])))
    words = ("Null", "causal", "between", "3 samples", "3 of 9", "1 of 9", "Something", "blocks")
    assert all(word.lower() in text.lower() for word, text in zip(words, found.items, strict=True))
    unknown = [i for i, text in enumerate(found.beside) if text == "size unknown"]
    assert unknown == [0, 3, 6, 7]  # without intervals that of the error bars is unknown too
    z = size_of(notes[3], known(maps["lost"]))
    assert found.beside[4] == typeset(z.text())
    assert found.beside[4].startswith("size: R 0.")


def test_of_other_methods_lines_and_points(liner):
    """Beside a map each method has its own interval; lines and points have sizes too."""
    found = tl.educe(plane_of(turbulence((4, 480)), x=np.arange(4) * 1e-3), liner)
    few = "p: the error bars rest on 5 independent blocks"
    other = tl.PointImpedances(
        "in situ", found.frequency, found.cell_x, found.cell_z, found.cell_impedance,
        found.cell_impedance, found.liner_impedance, found.liner_impedance,
        torch.ones(found.cell_impedance.shape), found.cell_x, found.cell_z, found.cell_impedance,
        notes=(few,),
    )  # fmt: skip
    assert size_of(few, whole_points(other)) is None
    both = dataclasses.replace(found.with_alongside(other), notes=(few.replace("p:", "q:"),))
    bullets = of_map(subject_of(both))[1]
    assert [text == "size unknown" for text in bullets.beside] == [False, True]
    burst = torch.arange(4000, dtype=torch.float64) / 12e3
    wave = torch.cos(2 * torch.pi * 1500 * burst)
    line = tl.educe_bursts(
        [tl.BurstRecord(burst, wall_normal=wave, x=0.0, y=1e-3, z=0.0, incident_level=100.0,
                        source_side="normal")], liner, 1500.0, segment=0.1,
    )  # fmt: skip
    (text,) = (note for note in line.notes if "closure" in note)
    there = complex(line.average.impedance[0]) + size_of(text, whole_line(line)).change
    level = float(line.closure.liner.level[0, 0])
    k = 2 * np.pi * 1500 / float(line.fluid.sound_speed) * 1e-3
    implied = [abs((z + 1) / (np.cos(k) + 1j * z * np.sin(k)))
               for z in (complex(line.average.impedance[0]), there)]  # fmt: skip
    assert 20 * np.log10(implied[0] / implied[1]) == pytest.approx(level, abs=LEVELS)
    assert whole_line(dataclasses.replace(line, average=None)) is None


@pytest.mark.parametrize("text", [
    "law of liner x adds y rho c of resistance", "R is off by up to ...1",
    "closure at 1e9 Hz fails, a:",
    "closure at x Hz is open, probes first:", "0 of 0 probes hold nan or inf; excluded",
    "it would be about 1+j1j instead of zj at", "wall filter: with inf Hz and count as wall", "",
])  # fmt: skip
def test_words_of_others_have_no_size(maps, text):
    """Notes stand in files, where anybody may write."""
    assert size_of(text, known(maps["lost"])) is None


def test_every_warning_of_an_eduction_has_a_kind():
    """The last kind takes what no other does."""
    assert KINDS[-1].words == ""
