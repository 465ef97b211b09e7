"""Sizes of warnings: each is what its words say, by a way of its own; the list goes by them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, turbulence
from test_level_check import LEVELS, MODEL, OF_AIR, facesheet_record, incident_level_of, plane, square_wave

import torchliner as tl
from torchliner.liners.layers import Cavity
from torchliner.records.notes import Note
from torchliner.report.page.sizes import KINDS, passing
from torchliner.report.page.subject import subject_of
from torchliner.report.page.warned import as_notes, listed, of_map, size_of
from torchliner.report.typesetting import typeset

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
WRONG = 1.9 - 0.8j  # the model has 0.8 - 0.15j
X = {"x": np.arange(6) * 1e-3}


def size(found, code, liner=None):
    """Of the one warning of this kind."""
    (note,) = (note for note in found.notes if note.code == code)
    return size_of(note, subject_of(found, liner=liner))


@pytest.mark.parametrize("height", [None, 0.02])
def test_what_passes_is_an_impedance_with_that_level(height):
    """At normal incidence, from the sum of incident and reflected wave."""
    velocity, amplitude = square_wave(2.0)
    level = incident_level_of(amplitude, WRONG, height or 0.0)
    found = tl.educe(plane(velocity, height=height, incident_level=level), MODEL)
    there = complex(found.answer[0]) + size(found, "level-check").change
    assert abs(complex(found.answer[0]) - there) > 0.1
    assert incident_level_of(amplitude, there, height or 0.0) == pytest.approx(level, abs=LEVELS)


@pytest.mark.parametrize(("level_of", "said"), [(WRONG, False), (-0.9 + 0.1j, True)])
def test_what_no_liner_has_is_said(level_of, said):
    """A wave that is too weak for the velocity passes with a resistance below 0 alone."""
    velocity, amplitude = square_wave(2.0)
    level = incident_level_of(amplitude, level_of, 0.0)
    found = tl.educe(plane(velocity, incident_level=level), MODEL)
    sized = size(found, "level-check")
    assert ("R below 0, which no liner has" in sized.words) == said
    assert (complex(found.answer[0] + sized.change).real < 0) == said


def test_what_passes_with_a_phase_is_the_impedance_behind_the_pressure():
    """Z V is the pressure at the wall: with size and phase both parts of Z follow."""
    velocity, amplitude = square_wave(2.0)
    p = OF_AIR.characteristic_impedance * WRONG * amplitude
    turns = 2 * torch.pi * FREQUENCY * torch.arange(velocity.shape[-1], dtype=torch.float64) / RATE
    record = facesheet_record((p.real * turns.cos() - p.imag * turns.sin()).expand(3, -1))
    found = tl.educe(plane(velocity, source_side="upstream"), MODEL, pressure=record)
    change = size(found, "level-check").change
    assert complex(found.answer[0]) + change == pytest.approx(WRONG, abs=1e-6)


@pytest.fixture(scope="module")
def maps(liner):
    """Of one plane: as it is, with a probe at rest, with one left out, and with a wall filter."""
    tone = torch.cos(2 * torch.pi * torch.arange(600) / 30)
    velocity = turbulence((6, 600)) + torch.arange(6)[:, None] * tone
    asked = {"interval": None, "averaging": "admittance"}
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
    for name, code, other in (("still", "probes-at-rest", "lost"), ("wall", "wall-filter", "whole")):
        found = maps[name]
        change = size(found, code).change
        assert complex(found.answer[0]) + change == pytest.approx(complex(maps[other].answer[0]), abs=1e-6)
        assert abs(change) > 0.01


def test_what_a_share_left_out_does_if_it_lies_one_spread_off(maps):
    """The mean of five and of a sixth that is one standard deviation away."""
    found = maps["lost"]
    spread = complex(found.liner_spread[0])
    mean = (5 * complex(found.answer[0]) + (complex(found.answer[0]) + spread)) / 6
    assert size(found, "excluded-probes").change == pytest.approx(mean - complex(found.answer[0]))


def test_half_of_the_interval(liner):
    """In the averaging of the answer."""
    found = tl.educe(plane_of(turbulence((4, 480)), x=np.arange(4) * 1e-3), liner)
    low, high = found.bounds_of_liner(found.averaging)
    assert size_of(Note("few-blocks", ""), subject_of(found)).change == (high - low) / 2


def test_another_gas_flow_and_law(liner):
    """Z of the model with the data's, less its own, at the rms of v; a law's own resistance."""
    gas = dataclasses.replace(liner.fluid, sound_speed=320.0)
    velocity = torch.full((2, 600), 3.0, dtype=torch.float64)
    found = tl.educe(plane_of(velocity, fluid=gas), liner, interval=None)
    wanted = liner.replace(fluid=gas).impedance(FREQUENCY, 3.0) - liner.impedance(FREQUENCY, 3.0)
    assert size(found, "gas").change == pytest.approx(complex(wanted), rel=1e-6)
    plate = tl.sheet("goodrich", thickness=1e-3, orifice_diameter=1e-3, porosity=0.08, mach=0.3,
                     displacement_thickness=2e-3)  # fmt: skip
    mine = tl.LayeredLiner([plate, Cavity(0.04, 5e-3)])
    found = tl.educe(plane_of(velocity), mine, interval=None)
    change = size(found, "flow-counted-twice").change
    assert change == pytest.approx(complex(mine.flow_resistance, 0), rel=1e-2)


def test_an_error_of_the_reflection_moves_both_parts_at_most_so_much(maps):
    """|dZ| for dR in any direction, by differences."""
    found = maps["whole"]
    z = complex(found.answer[0])
    r = (z - 1) / (z + 1)
    turned = [r + 1e-6 * np.exp(0.1j * i) for i in range(63)]
    moved = [(1 + each) / (1 - each) - z for each in turned]
    most = size_of(Note("model-table", "", 1e-6), subject_of(found)).change
    assert most.real == pytest.approx(max(abs(each.real) for each in moved), rel=2e-3)
    assert most.imag == pytest.approx(max(abs(each.imag) for each in moved), rel=2e-3)


def test_the_largest_of_a_kind_comes_first_and_the_unknown_last(maps):
    """Kinds in their order; each has its size beside it, or that it is unknown."""
    notes = [
        Note("few-blocks", "blocks"), Note("excluded-probes", "excluded"), Note("model-table", "small", 1e-5),
        Note("other-tone", "large", 1.0), Note("model-table", "middle", 1e-2), Note("", "something else"),
        Note("null-test", "null"),
    ]  # fmt: skip
    subject = subject_of(maps["lost"])
    _, found = listed([(note, size_of(note, subject)) for note in notes])
    wanted = ["Null", "Large", "Middle", "Small", "Something else", "Excluded", "Blocks"]
    assert list(found.items) == wanted
    unknown = [text for text, beside in zip(found.items, found.beside, strict=True) if beside == "size unknown"]
    assert unknown == ["Null", "Something else", "Blocks"]  # that of the error bars without intervals
    assert found.beside[2] == typeset(size_of(notes[4], subject).text())


def test_of_other_methods_and_lines(liner):
    """Warnings of another method stand beside the map's; a line has its level check."""
    found = tl.educe(plane_of(turbulence((4, 480)), x=np.arange(4) * 1e-3), liner)
    cells, whole = found.cells["admittance"].impedance, found.liner["admittance"].impedance
    place = found.cell_x, found.cell_z
    other = tl.PointImpedances(
        "in situ", found.frequency, *place, cells, cells, whole, whole, torch.ones(cells.shape), *place, cells,
        notes=("few probes",),
    )  # fmt: skip
    both = dataclasses.replace(found.with_alongside(other), notes=(Note("few-blocks", "q"),))
    bullets = of_map(subject_of(both))[1]
    assert [text == "size unknown" for text in bullets.beside] == [True, False]
    burst = torch.arange(4000, dtype=torch.float64) / 12e3
    wave = torch.cos(2 * torch.pi * 1500 * burst)
    line = tl.educe_bursts(
        [tl.BurstRecord(burst, wall_normal=wave, x=0.0, y=1e-3, z=0.0, incident_level=100.0,
                        source_side="normal")], liner, 1500.0, segment=0.1,
    )  # fmt: skip
    (sized,) = (size for note in as_notes(line.notes) if (size := passing(line, note)))
    there = complex(line.average.impedance[0]) + sized.change
    level = float(line.level_check.liner.level[0, 0])
    k = 2 * np.pi * 1500 / float(line.fluid.sound_speed) * 1e-3
    implied = [abs((z + 1) / (np.cos(k) + 1j * z * np.sin(k)))
               for z in (complex(line.average.impedance[0]), there)]  # fmt: skip
    assert 20 * np.log10(implied[0] / implied[1]) == pytest.approx(level, abs=LEVELS)


@pytest.mark.parametrize("code", ["", *KINDS])
def test_texts_of_others_break_nothing(maps, code):
    """Notes stand in files, where anybody may write."""
    for found in maps.values():
        size_of(Note(code, "<b>"), subject_of(found))
