"""Moments of a record that goes on, against one reading of all of it."""

from __future__ import annotations

import dataclasses
import warnings

import pytest
import torch
from conftest import plane_of, turbulence
from hypothesis import given, settings
from hypothesis import strategies as st

import torchliner as tl
from torchliner.campaign.follow import MOST
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import reading_of, take_moments

PROBES, PITCH = 4, 5e-3
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def record(samples: int, low: int = 0, rate: float = 42000.0, **about) -> tl.VelocityPlane:
    v = turbulence((PROBES, 9000), seed=2)[:, low : low + samples]
    return plane_of(v, sampling_rate=rate, x=2e-3 * torch.arange(PROBES), **about)


def at_once(plane: tl.VelocityPlane, known: tl.Moments, **choices) -> tl.Moments:
    """One reading with the same borders."""
    frequency = torch.tensor([1400.0], dtype=torch.float64)
    chosen = Choices(**choices, allow_short=True)
    reading = reading_of(plane, [], frequency, chosen, cell_pitch=PITCH, nodes=known.nodes)
    return take_moments(dataclasses.replace(reading, blocks=known.survey.blocks), reviewed=False)


@settings(max_examples=20)
@given(
    st.integers(1, 500),
    st.lists(st.integers(1, 3000), max_size=8),
    st.sampled_from([42000.0, 41234.5]),
    st.sampled_from(["averaged", "self-consistent"]),
)
def test_moments_are_those_of_one_reading(first, pieces, rate, phase):
    """Whatever the pieces, and however often neighbours became one."""
    choices = {"averaging": "velocity", "phase": phase}
    growing = tl.GrowingMoments(record(first, rate=rate), cell_pitch=PITCH, **choices)
    held = first
    for piece in pieces:
        piece = min(piece, 9000 - held)
        if piece:
            growing.update(record(piece, held, rate).velocity)
        held += piece
    assert growing.periods == int((held + 0.5) * 1400 / rate) // growing.each * growing.each
    if not growing.periods:
        return
    found = growing.moments()
    assert 1 <= found.survey.blocks.count < MOST
    assert found.plane.samples == found.survey.blocks.borders[-1] <= held
    wanted = at_once(record(held, rate=rate), found, **choices)
    assert found.sums.keys() == wanted.sums.keys()
    for name in found.sums:
        torch.testing.assert_close(found.sums[name], wanted.sums[name], rtol=1e-12, atol=1e-12)
    for name in ("sums", "squares", "peaks", "gram"):
        mine, theirs = getattr(found.survey, name), getattr(wanted.survey, name)
        torch.testing.assert_close(mine, theirs, rtol=1e-12, atol=1e-12)


def test_a_standing_is_left_alone_by_what_comes_later(liner):
    """And is educed like any record of moments, in the averaging that was chosen."""
    growing = tl.GrowingMoments(record(2400), liner, averaging="velocity")
    then = growing.moments()
    before = then.educe(liner, averaging="velocity").answer
    growing.update(record(6000, 2400).velocity)
    assert torch.equal(then.educe(liner, averaging="velocity").answer, before)
    wanted = tl.educe(record(growing.moments().plane.samples), liner, averaging="velocity")
    assert float((growing.educe(liner).answer - wanted.answer).abs().max()) < 1e-6
    assert growing.educe(liner).averaging == "velocity"


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"averaging": "phase-locked"}, "needs the whole record; take 'admittance' or 'velocity'"),
        ({"mean": "removed"}, "has mean 'kept' alone"),
        ({"drive": "rms"}, "has drive 'instantaneous' alone"),
        ({"missing": "exclude"}, "has missing 'refuse' alone"),
    ],
)
def test_what_needs_the_whole_record_is_refused(choices, words):
    """Before a sample is added."""
    with pytest.raises(ValueError, match=words):
        tl.GrowingMoments(record(600), cell_pitch=PITCH, **choices)


def test_samples_that_do_not_fit_are_refused():
    """And nothing of them is added."""
    growing = tl.GrowingMoments(record(20), cell_pitch=PITCH)
    with pytest.raises(ValueError, match="holds 20 samples so far; a period has 30"):
        growing.moments()
    bad = record(30, 20).velocity.clone()
    bad[2, 5] = torch.nan
    with pytest.raises(ValueError, match="1 of 4 probes hold nan or inf among the new samples, the first is probe 2"):
        growing.update(bad)
    with pytest.raises(ValueError, match=r"shape \(3, 9\); they are of probes \(4,\), time last"):
        growing.update(torch.zeros(3, 9))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        growing.update(record(30, 20).velocity)
    assert growing.periods == 1
