"""The same reading with the incoherent velocity scaled otherwise, and what that does to intervals."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import torch

from torchliner.engine.drives import Drive, phase_locked
from torchliner.engine.moments import Moments
from torchliner.engine.sums import reduce
from torchliner.records.educed import Educed
from torchliner.velocity.averages import Averages
from torchliner.velocity.reading import Reading, run_jobs


def with_drive(reading: Reading, known: Moments, locked: Drive) -> Moments:
    """Moments of the same reading with another phase-locked drive, for which the plane is read once more."""
    reading = reading if bool(known.used.all()) else reading.without(~known.used)
    jobs = {name: job for name, job in reading.second_jobs(known.survey, locked).items() if name == "phase-locked"}
    sums = run_jobs(jobs, reading, reduce, None) if jobs else {}
    return dataclasses.replace(known, locked=locked, sums={**known.sums, **sums})


def ends_of_background(reading: Reading, known: Moments) -> list[Moments]:
    """Moments with the background at either bound of its interval; none where it has none."""
    background, seen, cells = reading.chosen.background, known.survey, known.membership
    if background is None or not background.low or known.locked is None or reading.chosen.interval is None:
        return []
    bounds = [dataclasses.replace(background, rms=rms) for rms in (background.low, background.high)]
    return [with_drive(reading, known, phase_locked(seen, cells, each.scale(seen, cells))) for each in bounds]


def widened(found: Averages, ends: Sequence[Averages]) -> Averages:
    """Intervals that also hold what a stated input may be off by, from the averages at both of its bounds."""

    def wider(own: Educed | None, others: Sequence[Educed | None]) -> Educed | None:
        if own is None or own.interval is None:
            return own
        changes = torch.stack([torch.view_as_real(each.impedance - own.impedance) for each in others if each])
        value, low, high = map(torch.view_as_real, (own.impedance, own.interval.low, own.interval.high))
        below, above = (value - low).clamp(min=0), (high - value).clamp(min=0)
        lower = low + below - below.hypot(changes.amin(0).clamp(max=0))
        upper = high - above + above.hypot(changes.amax(0).clamp(min=0))
        bounds = {"low": torch.where(low.isfinite(), lower, low), "high": torch.where(high.isfinite(), upper, high)}
        bounds = {name: torch.view_as_complex(each.contiguous()) for name, each in bounds.items()}
        return dataclasses.replace(own, interval=dataclasses.replace(own.interval, **bounds))

    names = ("probes", "cells", "liner", "along_x")
    every: Any = {name: wider(getattr(found, name), [getattr(end, name) for end in ends]) for name in names}
    return dataclasses.replace(found, **every)
