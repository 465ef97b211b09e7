r"""The fast engine: the impedance at chosen frequencies in one pass over the data.

For a tone the windowed line of the reflected signal is a weighted sum over the emission times of
R(f_q, |v_k|) at one to a few frequencies f_q (see ``edges``), so no reflected signal is formed:
R is evaluated in place for liners that offer a ``speed_law``, gathered and interpolated from a
small table for all others, weighted and reduced. This also says what the method is: the educed R
is the window-weighted mean of R(f0, |v(t)|), plus its line at 2 f0 when a phase is stated.

Sums over slabs of time add up; a probe's sum never meets its neighbours'. Slabs are cut into blocks
small enough for the cache; within a block products are summed in the data's precision, across
blocks in float64.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from torchliner.conversions import reflection_from_impedance
from torchliner.liners.nonlinear import SpeedLaw, powers
from torchliner.replay.edges import EdgeTable, Record
from torchliner.replay.incident import LineSums
from torchliner.replay.kernels import KernelTable, Liner, reflection_at_levels
from torchliner.replay.levels import VelocityGrid, interpolate

SLAB_ROWS = 256
BLOCK_ELEMENTS = 1 << 16

Parts = tuple[Tensor, Tensor]


class SpeedSource(Protocol):
    """|v| of many probes over time, read by slabs."""

    samples: int
    probes: int
    dtype: torch.dtype
    device: torch.device

    def read(self, begin: int, end: int) -> Tensor:
        """|v| in m/s of samples begin .. end - 1, shape (t, P)."""
        ...


class Response(Protocol):
    """R at the lines of one frequency: |v| (t, P) -> real and imaginary part per line."""

    def lines(self, speed: Tensor) -> list[Parts]:
        """Real and imaginary part of R, each (t, P), line by line."""
        ...


@dataclass(frozen=True)
class LawResponse:
    """R evaluated in place from the liner's own formula."""

    law: SpeedLaw

    def lines(self, speed: Tensor) -> list[Parts]:
        """Each line's R, split by hand into parts so that no complex temporary is made."""
        fitting = self.law.to(speed.dtype, speed.device)
        square, power = powers(speed)
        found = []
        for i in range(len(fitting.a)):
            resistance, reactance = fitting.line(i).parts_from_powers(speed, square, power)
            found.append(reflection_parts(resistance, reactance))
        return found


def reflection_parts(resistance: Tensor, reactance: Tensor) -> Parts:
    """Real and imaginary part of R = (Z - 1)/(Z + 1), as R = 1 - 2 (Z + 1)*/|Z + 1|^2."""
    above = resistance + 1
    scale = 2 / (above * above + reactance * reactance)
    return 1 - above * scale, reactance * scale


@dataclass(frozen=True)
class TableResponse:
    """R gathered and interpolated from its values at the levels, complex128, (V, lines)."""

    table: Tensor
    grid: VelocityGrid

    def lines(self, speed: Tensor) -> list[Parts]:
        """Each line's R, by the grid's interpolation."""
        index, weights = self.grid.locate(speed)
        table = torch.view_as_real(self.table).to(speed.device, speed.dtype)
        return [
            (
                interpolate(table[:, i, 0], index, weights),
                interpolate(table[:, i, 1], index, weights),
            )
            for i in range(table.shape[1])
        ]


def response_of(
    liner: Liner, frequency: list[float], grid: VelocityGrid | None, kernels: KernelTable | None
) -> Response:
    """How R is had at ``frequency``: from the kernels if given, else from the liner.

    Args:
        liner: with ``speed_law`` it is evaluated in place, else tabulated over ``grid``.
        frequency: Hz, the lines of one analysis frequency.
        grid: velocity levels for a liner without ``speed_law``.
        kernels: if given, their response stands for the liner's.
    """
    wanted = torch.tensor(frequency, dtype=torch.float64)
    if kernels is not None:
        return TableResponse(kernels.response(wanted), kernels.grid)
    law: Callable[[Tensor], SpeedLaw] | None = getattr(liner, "speed_law", None)
    if law is not None:
        return LawResponse(law(wanted))
    if grid is None:
        raise ValueError("a liner without speed_law needs a velocity grid")
    return TableResponse(reflection_at_levels(liner, wanted, grid), grid)


def interpolation_error(liner: Liner, frequency: float, grid: VelocityGrid) -> float:
    """Largest error in R of the levels' interpolation, halfway between levels."""
    speeds = grid.speeds
    middle = (speeds[1:] + speeds[:-1]) / 2
    at = torch.tensor([frequency], dtype=torch.float64)
    table = reflection_at_levels(liner, at, grid)
    found = interpolate(table, *grid.locate(middle))
    exact = reflection_from_impedance(
        torch.as_tensor(liner.impedance(at, middle[:, None])).to(torch.complex128)
    )
    return float((found - exact).abs().max())


def spectral_sums(
    source: SpeedSource,
    responses: list[Response],
    frequency: Tensor,
    record: Record,
    tables: list[EdgeTable | None],
    grid: VelocityGrid | None,
    *,
    backward: bool,
    slab_rows: int = SLAB_ROWS,
    block_elements: int = BLOCK_ELEMENTS,
    progress: Callable[[int], None] | None = None,
) -> LineSums:
    """Windowed lines of the reflected signal at each frequency, without forming the signal.

    Args:
        source: |v|, read by slabs of ``slab_rows`` samples.
        responses: R of the lines of each frequency, F of them.
        frequency: Hz, shape (F,).
        record: window and edge rule.
        tables: edge table of each frequency, None where the lines are exact.
        grid: velocity levels of ``tables``.
        backward: whether the reply to e^{-j omega t} is needed too.
        slab_rows, block_elements: sizes; they change the result by rounding only.
        progress: called with the number of samples done.
    Returns:
        Sums, complex128, (P, F), on the source's device; differentiable in the liner.
    """
    weights = [_weights(record, float(f), backward) for f in frequency]
    real = torch.complex64 if source.dtype == torch.float32 else torch.complex128
    totals = [[_zero(source) for _ in range(2 if backward else 1)] for _ in weights]
    for begin in range(0, record.samples, slab_rows):
        end = min(begin + slab_rows, record.samples)
        slab = source.read(begin, end)
        rows = [None if table is None else table.rows(begin, end) for table in tables]
        step = max(1, block_elements // max(1, slab.shape[1]))
        for low in range(0, end - begin, step):
            high = min(low + step, end - begin)
            block = slab[low:high]
            located = grid.locate(block) if grid and any(r is not None for r in rows) else None
            for total, response, weight, row in zip(totals, responses, weights, rows, strict=True):
                sums = _line_sums(response.lines(block), weight[begin + low : begin + high])
                if row is not None and located is not None:
                    chosen = [r[low:high].to(source.device, real) for r in row[: len(total)]]
                    sums = [s + _edge_sum(c, located) for s, c in zip(sums, chosen, strict=True)]
                for i, value in enumerate(sums):
                    total[i] = total[i] + value
        if progress is not None:
            progress(end - begin)
    forward = torch.stack([total[0] for total in totals], dim=1)
    if not backward:
        return LineSums(forward, None)
    return LineSums(forward, torch.stack([total[1] for total in totals], dim=1))


def _zero(source: SpeedSource) -> Tensor:
    return torch.zeros(source.probes, dtype=torch.complex128, device=source.device)


def _weights(record: Record, frequency: float, backward: bool) -> Tensor:
    """Weights of the lines, complex128, (n, lines, 1 or 2)."""
    forward = record.line_weights(frequency)
    if not backward:
        return forward[..., None]
    steps = torch.arange(record.samples, dtype=torch.float64)
    turning = torch.exp(-4j * torch.pi * frequency / record.sampling_rate * steps)
    return torch.stack([forward, forward * turning[:, None]], dim=-1)


def _line_sums(lines: list[Parts], weights: Tensor) -> list[Tensor]:
    """Sum over time and lines of weight times R, complex128, (P,) per direction."""
    directions = weights.shape[-1]
    total = None
    for i, (real, imaginary) in enumerate(lines):
        pair = torch.view_as_real(weights[:, i]).reshape(len(weights), -1).T
        pair = pair.to(real.device, real.dtype)  # (2 directions, t): re, im, re, im
        a, b = (pair @ real).to(torch.float64), (pair @ imaginary).to(torch.float64)
        part = torch.complex(a[0::2] - b[1::2], a[1::2] + b[0::2])
        total = part if total is None else total + part
    assert total is not None
    return [total[i] for i in range(directions)]


def _edge_sum(rows: Tensor, located: tuple[Tensor, list[Tensor]]) -> Tensor:
    """Sum over time of the edge table at each probe's |v|; rows (t, V), |v| located (t, P)."""
    index, weights = located
    flat = rows.reshape(-1)
    offset = torch.arange(rows.shape[0], device=rows.device)[:, None] * rows.shape[1]
    return interpolate(flat, index + offset, weights).to(torch.complex128).sum(0)
