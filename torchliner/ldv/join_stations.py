"""Stations that were educed one by one as one line."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import chain
from typing import Any

import torch
from torch import Tensor

from torchliner.ldv.station import CASE
from torchliner.records import ImpedanceLine, Interval

SHARED = ("frequency", "goodrich")  # tensors that are those of the whole line
LISTS = ("names", "flags", "dropped", "station_notes")
PADDED = ("reflection", "segment_start")  # nan for the segments that a shorter station lacks


def join_lines(lines: Sequence[ImpedanceLine]) -> ImpedanceLine:
    """Stations of several lines as one, in the order given; averages are not carried over.

    Raises:
        ValueError: lines of different cases or frequencies.
    """
    first = lines[0]
    for other in lines[1:]:
        _require_same_case(first, other)
    most = max(line.segment_start.shape[1] for line in lines)
    joined: dict[str, Any] = {}
    for name, value in vars(first).items():
        values = [getattr(line, name) for line in lines]
        if name in LISTS:
            joined[name] = tuple(chain.from_iterable(values))
        elif name in PADDED:
            joined[name] = torch.cat([_padded(each, most) for each in values])
        elif isinstance(value, Tensor) and name not in SHARED:
            joined[name] = torch.cat(values)
    intervals = [line.interval for line in lines if line.interval is not None]
    joined["interval"] = Interval.joined(intervals) if len(intervals) == len(lines) else None
    return dataclasses.replace(first, average=None, notes=(), **joined)


def _padded(values: Tensor, segments: int) -> Tensor:
    nan = complex(float("nan"), float("nan")) if values.is_complex() else float("nan")
    missing = values.new_full((len(values), segments - values.shape[1], *values.shape[2:]), nan)
    return torch.cat([values, missing], dim=1)


def _require_same_case(first: ImpedanceLine, other: ImpedanceLine) -> None:
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
    for key in CASE:
        mine, theirs = getattr(first, key), getattr(other, key)
        if mine != theirs:
            raise ValueError(
                f"{other.names[0]} has {key} {theirs}, {first.names[0]} {mine}; the stations of a "
                "line share one case"
            )
