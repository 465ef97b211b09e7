"""What each analysis frequency needs: R at its lines, their weights, the ends of the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.conversions import reflection_from_impedance
from torchliner.liners.model import Liner, LinerModel
from torchliner.liners.nonlinear import SpeedLaw
from torchliner.replay.edges import EdgeTable, Reach, Record
from torchliner.replay.kernels import KernelTable, impedance_of, reflection_at_levels
from torchliner.replay.levels import VelocityGrid, interpolate


@dataclass(frozen=True)
class Line:
    """One analysis frequency, ready to be summed.

    Args:
        frequency: Hz.
        record: window and edge rule.
        law: formula of R at the frequency's lines, (lines,), or None.
        response: R at the lines and levels where there is no formula, complex128, (V, lines).
        edges: table of the record's ends, None where the lines are exact.
        backward: whether the reply to e^{-j omega t} is summed too.
        grid: velocity levels of its tables; None for those of the pass.
    """

    frequency: float
    record: Record
    law: SpeedLaw | None
    response: Tensor | None
    edges: EdgeTable | None
    backward: bool
    grid: VelocityGrid | None = None

    @property
    def directions(self) -> int:
        """1, or 2 with the backward reply."""
        return 2 if self.backward else 1

    def weights(self, begin: int, end: int) -> Tensor:
        """Of the lines at emissions begin .. end - 1, complex128, (t, lines, directions)."""
        forward = self.record.line_weights(self.frequency, begin, end)
        if not self.backward:
            return forward[..., None]
        steps = torch.arange(begin, end, dtype=torch.float64)
        turn = 4 * torch.pi * self.frequency / self.record.sampling_rate
        turning = torch.exp(-1j * turn * steps)
        return torch.stack([forward, forward * turning[:, None]], dim=-1)

    def rows(self, begin: int, end: int) -> Tensor | None:
        """Table over (time, level), complex128, (t, V, directions); None if there is none."""
        found = None if self.edges is None else self.edges.rows(begin, end)
        total = None if found is None else torch.stack(found[: self.directions], dim=-1)
        if self.response is not None:
            lines = torch.einsum("tld,vl->tvd", self.weights(begin, end), self.response)
            total = lines if total is None else total + lines
        return total


def plan_lines(
    liner: LinerModel,
    frequency: Sequence[float],
    record: Record,
    grid: VelocityGrid,
    kernels: KernelTable | None = None,
    *,
    of_kernel: bool = False,
    backward: bool = True,
) -> list[Line]:
    """What the engine needs for the line at each frequency (Hz).

    Args:
        liner: with ``speed_law`` it is evaluated in place, else tabulated over ``grid``.
        frequency: Hz, F of them.
        record: window and edge rule.
        grid: velocity levels of all tables.
        kernels: impulse responses, needed where the lines are not exact.
        of_kernel: let the kernels' response stand for the liner's.
        backward: whether the reply to e^{-j omega t} is needed too.
    """
    reach = None
    lines = []
    for value in frequency:
        at = torch.tensor(record.line_frequencies(value)[0], dtype=torch.float64)
        law, response, edges = None, None, None
        if of_kernel:
            assert kernels is not None
            response = kernels.response(at)
        elif (law := liner.speed_law(at)) is None:
            response = reflection_at_levels(liner, at, grid)
        if record.needs_table(value):
            assert kernels is not None
            reach = reach or Reach(record, kernels.taps.shape[1])
            edges = EdgeTable(kernels, reach, value)
        lines.append(Line(value, record, law, response, edges, backward, grid))
    return lines


def interpolation_error(liner: Liner, frequency: float, grid: VelocityGrid) -> float:
    """Largest error in R of the levels' interpolation, halfway between levels."""
    speeds = grid.speeds
    middle = (speeds[1:] + speeds[:-1]) / 2
    at = torch.tensor([frequency], dtype=torch.float64)
    table = reflection_at_levels(liner, at, grid)
    found = interpolate(table, *grid.locate(middle))
    exact = reflection_from_impedance(impedance_of(liner, at, middle[:, None]))
    return float((found - exact).abs().max())


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
