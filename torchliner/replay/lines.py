"""What each analysis frequency needs: R at its lines, their weights, the ends of the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.conversions import reflection_from_impedance
from torchliner.liners.nonlinear import SpeedLaw
from torchliner.replay.edges import EdgeTable, Reach, Record
from torchliner.replay.kernels import KernelTable, Liner, impedance_of, reflection_at_levels
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
    liner: Liner,
    frequency: Sequence[float],
    record: Record,
    grid: VelocityGrid,
    kernels: KernelTable | None = None,
    *,
    of_kernel: bool = False,
    backward: bool = True,
) -> list[Line]:
    """How the line at each frequency (Hz) is had.

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
        elif hasattr(liner, "speed_law"):
            law = liner.speed_law(at)
        else:
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
