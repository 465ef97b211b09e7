"""Stations that were educed one by one as one line."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.records import ImpedanceLine, Interval
from torchliner.signals.attenuation import DAMPED

SAME = ("fluid", "mach", "incident_level", "source_side", "reference")
LISTS = ("names", "flags", "dropped", "station_notes")
PADDED = ("reflection", "segment_start")  # nan for the segments that a shorter station lacks


def join_lines(lines: Sequence[ImpedanceLine]) -> ImpedanceLine:
    """Stations of several lines as one, in the order given; averages are not carried over.

    Raises:
        ValueError: no line, or lines of different cases or frequencies.
    """
    if not lines:
        raise ValueError("no line to join")
    first = lines[0]
    for other in lines[1:]:
        _require_same(first, other)
    most = max(line.segment_start.shape[1] for line in lines)
    joined: dict[str, Any] = {
        key: torch.cat([getattr(line, key) for line in lines])
        for key, value in vars(first).items()
        if isinstance(value, Tensor) and key not in (*PADDED, "frequency", "goodrich", "wall")
    }
    for key in PADDED:
        joined[key] = torch.cat([_padded(getattr(line, key), most) for line in lines])
    for key in LISTS:
        joined[key] = tuple(item for line in lines for item in getattr(line, key))
    intervals = [line.interval for line in lines if line.interval is not None]
    whole = len(intervals) == len(lines)
    joined["interval"] = Interval.joined(intervals) if whole else None
    walls = [line.wall for line in lines if line.wall is not None]
    joined["wall"] = torch.cat(walls) if walls else None
    return dataclasses.replace(first, average=None, notes=(), **joined)


def _padded(values: Tensor, segments: int) -> Tensor:
    missing = segments - values.shape[1]
    nan = complex(float("nan"), float("nan")) if values.is_complex() else float("nan")
    shape = (values.shape[0], missing, *values.shape[2:])
    return torch.cat([values, torch.full(shape, nan, dtype=values.dtype)], dim=1)


def _require_same(first: ImpedanceLine, other: ImpedanceLine) -> None:
    if not torch.equal(first.frequency, other.frequency):
        raise ValueError(
            f"{other.names[0]} is educed at {other.frequency.tolist()} Hz, {first.names[0]} at "
            f"{first.frequency.tolist()} Hz; name the frequency for all"
        )
    mine, theirs = (
        None if line.goodrich is None else line.goodrich.tolist() for line in (first, other)
    )
    if mine != theirs:
        raise ValueError(
            f"{other.names[0]} has another displacement thickness or Mach number than "
            f"{first.names[0]}; the stations of a line share one case"
        )
    for key in SAME:
        mine, theirs = getattr(first, key), getattr(other, key)
        if mine != theirs:
            raise ValueError(
                f"{other.names[0]} has {key} {theirs}, {first.names[0]} {mine}; the stations of a "
                "line share one case"
            )


SHOWN = 4  # names in a note


def review_line(line: ImpedanceLine) -> list[str]:
    """What is to be said of a line."""
    return [*_flagged(line), *_damped(line), *_walls(line), *_fallen_back(line), *_others(line)]


def _flagged(line: ImpedanceLine) -> list[str]:
    which = [i for i, flags in enumerate(line.flags) if flags]
    if not which:
        return []
    names = ", ".join(line.names[i] for i in which[:SHOWN])
    more = f" and {len(which) - SHOWN} more" if len(which) > SHOWN else ""
    count = int((~line.used).sum())
    done = "do not count in the averages" if count else "count in the averages all the same"
    return [
        f"{len(which)} of {line.stations} stations are flagged and {done}: {names}{more}; the "
        f"first: {line.flags[which[0]][0]}"
    ]


def _damped(line: ImpedanceLine) -> list[str]:
    notes = []
    sizes = line.attenuation.abs()
    for i, frequency in enumerate(line.frequency.tolist()):
        if float(sizes[:, i].min()) >= DAMPED:
            continue
        corrected = bool(line.corrected[:, i].all())
        said = (
            "the tone is corrected, the turbulence is not"
            if corrected
            else "it is not corrected there"
        )
        notes.append(
            f"{line.choices['method']} reconstruction damps {frequency:g} Hz to "
            f"{float(sizes[:, i].mean()):.3f} in the mean of the stations (least "
            f"{float(sizes[:, i].min()):.3f}); {said}"
        )
    return notes


def _walls(line: ImpedanceLine) -> list[str]:
    if line.wall is None:
        return []
    limit = line.choices["wall_filter"]
    return [
        f"wall filter: {count} of {line.stations} stations have a squared coherence below "
        f"{limit:g} with {frequency:g} Hz and count as wall, admittance 0, in the averages"
        for frequency, count in zip(line.frequency.tolist(), line.wall.sum(0).tolist(), strict=True)
    ]


def _fallen_back(line: ImpedanceLine) -> list[str]:
    share = line.phase_held.mean(0)
    return [
        f"self-consistent phase: at {frequency:g} Hz it held in {100 * held:.3g} % of the segments;"
        " the others, with too little coherence, are 'averaged' instead"
        for frequency, held in zip(line.frequency.tolist(), share.tolist(), strict=True)
        if held < 1
    ]


def _others(line: ImpedanceLine) -> list[str]:
    notes = []
    which = [i for i, said in enumerate(line.station_notes) if said]
    if which:
        notes.append(
            f"{len(which)} of {line.stations} stations have notes of their own (station_notes); "
            f"the first, of {line.names[which[0]]}: {line.station_notes[which[0]][0]}"
        )
    if line.interval is None and line.choices["interval"] is not None:
        notes.append(
            f"no error bars: a station has {int(line.segments.min())} segments, four at least are "
            "needed; a longer record or shorter segments give them"
        )
    return notes
