"""What |v| under one tone says of others: by the share of v that is the tone's own."""

import re
import warnings

import pytest
import torch
from conftest import RATE, plane_of, turbulence

import torchliner as tl
from torchliner.velocity.sound import LARGEST_CHANGE

SAMPLES = 4200  # 100 ms
TIMES = torch.arange(SAMPLES, dtype=torch.float64) / RATE
TONE = torch.cos(2 * torch.pi * 1400 * TIMES)
GIVEN = r"Without this one it would be about (\S+) instead of (\S+) at 2100 Hz"


def educed(velocity, liner, frequency, **choices):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        return tl.educe(plane_of(velocity), liner, frequency, interval=None, **choices)


def shown(found):
    (note,) = (each for each in found.notes if each.code == "other-tone")
    return note.text


@pytest.mark.parametrize(
    ("tone", "rms", "share"),
    [(3.0, 0.0, 1.0), (3.0, 0.5, 0.947), (2.0, 2.0, 1 / 3), (0.0, 2.0, 0.0)],
)
def test_share_is_that_of_the_variance(tone, rms, share, liner):
    v = tone * TONE + (turbulence((20, SAMPLES), rms=rms) if rms else torch.zeros(20, SAMPLES))
    found = educed(v, liner, 2100.0)
    assert found.choices["tone_share"] == pytest.approx(share, abs=0.01)
    assert [note.code for note in found.notes] == (["other-tone"] if share else ["no-tone"])


def test_the_number_is_what_the_turbulence_alone_gives(liner):
    """The note's values are those that planes with and without the tone give."""
    flow = turbulence((40, SAMPLES), seed=2, rms=1.0)
    both = educed(flow + 3 * TONE, liner, 2100.0)
    alone = educed(flow, liner, 2100.0)
    without, beside = (complex(text) for text in re.search(GIVEN, shown(both)).groups())
    assert without == pytest.approx(complex(alone.liner["admittance"].impedance[0]), rel=0.03)
    assert beside == pytest.approx(complex(both.liner["admittance"].impedance[0]), rel=0.03)
    assert [note.code for note in alone.notes] == ["no-tone"]


def test_a_tone_that_changes_little_is_no_warning(liner):
    """Below the limit |v| is the turbulence's, and Z at 2100 Hz moves by less than it."""
    flow = turbulence((40, SAMPLES), seed=3, rms=2.0)
    weak, none = (educed(flow + a * TONE, liner, 2100.0) for a in (0.4, 0.0))
    assert weak.choices["tone_share"] < 0.1
    assert not weak.notes
    moved = (weak.liner["admittance"].impedance / none.liner["admittance"].impedance - 1).abs()
    assert float(moved[0]) < LARGEST_CHANGE
