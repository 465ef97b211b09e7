"""A line over a part of the record, or of one direction alone, in a pass over all of it.

What is emitted outside the part has weight zero, so that halves of a record and coarser sampling
cost no pass of their own: the sums are those of the part educed alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.liners.nonlinear import SpeedLaw
from torchliner.replay.levels import VelocityGrid
from torchliner.replay.lines import Line


@dataclass(frozen=True)
class _Around:
    """What a line around another has of it."""

    inner: Line

    @property
    def law(self) -> SpeedLaw | None:
        """Formula of R."""
        return self.inner.law

    @property
    def grid(self) -> VelocityGrid | None:
        """Levels of the tables."""
        return self.inner.grid


@dataclass(frozen=True)
class PartLine(_Around):
    """Emission k of the part is sample ``begin + step k`` of the record.

    Args:
        inner: line of the part as a record of its own, at its own sampling rate.
        begin: first sample.
        step: samples of the record from one to the next of the part.
    """

    begin: int = 0
    step: int = 1

    @property
    def directions(self) -> int:
        """That of the part."""
        return self.inner.directions

    def _inside(self, begin: int, end: int) -> tuple[int, int, slice]:
        """First and last sample of the part in begin .. end - 1, and where they lie in it."""
        first = max(0, -(-(begin - self.begin) // self.step))
        last = min(self.inner.record.samples, -(-(end - self.begin) // self.step))
        if last <= first:
            return 0, 0, slice(0, 0)
        place = self.begin + first * self.step - begin
        stop = place + (last - first - 1) * self.step + 1
        return first, last, slice(place, stop, self.step)

    def weights(self, begin: int, end: int) -> Tensor:
        """As those of ``Line``, 0 outside the part."""
        first, last, where = self._inside(begin, end)
        own = self.inner.weights(first, last)
        return _spread(own, end - begin, where)

    def rows(self, begin: int, end: int) -> Tensor | None:
        """As those of ``Line``, 0 outside the part."""
        first, last, where = self._inside(begin, end)
        own = self.inner.rows(first, last) if last > first else None
        return None if own is None else _spread(own, end - begin, where)


@dataclass(frozen=True)
class BackwardLine(_Around):
    """The reply to e^{-j omega t} of a line alone, so that others of the pass can do without.

    Args:
        inner: a line with both directions.
    """

    directions: int = 1

    def weights(self, begin: int, end: int) -> Tensor:
        """Of its second direction."""
        return self.inner.weights(begin, end)[..., 1:]

    def rows(self, begin: int, end: int) -> Tensor | None:
        """Of its second direction."""
        rows = self.inner.rows(begin, end)
        return None if rows is None else rows[..., 1:]


def _spread(values: Tensor, count: int, where: slice) -> Tensor:
    whole = torch.zeros((count, *values.shape[1:]), dtype=values.dtype)
    whole[where] = values
    return whole


AnyLine = Line | PartLine | BackwardLine
