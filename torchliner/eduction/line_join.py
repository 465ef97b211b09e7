"""Stations that were educed one by one as one line."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.records import ImpedanceLine, Interval

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
    joined["interval"] = None if not whole else Interval(*(
        torch.cat([getattr(each, name) for each in intervals]) for name in vars(intervals[0])
    ))  # fmt: skip
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
