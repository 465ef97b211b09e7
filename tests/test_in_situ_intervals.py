"""Statistical intervals of the in situ and microphone methods, because records are finite."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from test_in_situ import FREQUENCY, RATE, file_of, record_of, standing_wave

import torchliner as tl

AVERAGINGS = ("", "_pressure_first")


def noisy(seed: int, samples: int = 571, **about) -> tl.PressureRecord:
    """Z = 1 under noise on the facesheet whose correlation lasts a third of a period."""
    record = record_of([standing_wave(1.0, 1.0)], 1.0, samples=samples, **about)
    noise = np.random.default_rng(seed).standard_normal(samples + 60)
    kernel = np.exp(-np.arange(60) / 10)
    smooth = torch.from_numpy(np.convolve(noise, kernel, "full")[60 : samples + 60])
    return dataclasses.replace(record, facesheet=record.facesheet + 0.2 * smooth)


def covers(bounds: tuple[complex, complex], value: complex) -> list[bool]:
    low, high = bounds
    return [low.real < value.real < high.real, low.imag < value.imag < high.imag]


@pytest.mark.parametrize("options", [{}, {"segment": 4 / FREQUENCY}])
def test_intervals_hold_the_truth_as_often_as_they_say(options):
    """Blocks of time, or segments: 95 % of records of 20 periods, within what 40 tell."""
    held = []
    for seed in range(40):
        found = tl.in_situ(noisy(seed), **options)
        held.append([covers(found.bounds_of_liner(order), 1.0) for order in AVERAGINGS])
    share = np.mean(held, 0)
    assert share.min() > 0.85
    assert found.uncertainty.settings["blocks"] == (20 if not options else 9)


def test_too_few_blocks_are_said():
    """Three periods tell nothing of their scatter; without intervals nothing is said."""
    record = record_of([1.0], 1.0, samples=round(3.2 * RATE / FREQUENCY))
    with pytest.warns(tl.DataWarning, match="no statistical interval, since the record holds few"):
        found = tl.in_situ(record, allow_short=True)
    assert found.uncertainty is None
    assert found.bounds_of_liner() is None
    assert tl.in_situ(record, allow_short=True, interval=None).notes == ()
    with pytest.raises(ValueError, match="interval is 95; it is a level between 0 and 1"):
        tl.in_situ(record_of([1.0], 1.0), interval=95.0)


@pytest.mark.parametrize("case", ["g01_145", "g03_145", "o145"])
def test_turbulent_cases_lie_within(case):
    """With flow the miss of pressure first is the record's length: the truth is inside."""
    record = file_of(case)
    found = tl.in_situ(record).bounds_of_liner("_pressure_first")
    assert all(covers(found, complex(record.reference["true"])))


def test_microphones_have_intervals_and_a_pair_no_residual():
    """Waves: R through the same blocks. Two pressures leave nothing by construction: unknown."""
    record = file_of("g03_145")
    many, pair = (tl.decompose_waves(record, microphones=which) for which in ("all", "pair"))
    for found in (many, pair):
        assert all(covers(found.interval.bounds(0), complex(record.reference["true"])))
    assert 0 < float(many.residual[0]) < 0.01
    assert torch.isnan(pair.residual[0])
    steady = tl.decompose_waves(file_of("n130"), velocities=True).interval
    assert float((steady.high - steady.low).abs().max()) < 0.01
    assert tl.decompose_waves(record, interval=None).interval is None
