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
from torchliner.records.slabs import rows_per_slab
from torchliner.replay.compiled import PAYS_FROM, Fused, compile_line_sums
from torchliner.replay.edges import EdgeTable, Record
from torchliner.replay.incident import LineSums
from torchliner.replay.kernels import KernelTable, Liner, reflection_at_levels
from torchliner.replay.levels import VelocityGrid, interpolate
from torchliner.replay.reflect import Parts, reflection_parts

SLAB_ROWS = 256
BLOCK_ELEMENTS = 1 << 18  # floats: a few rows of a large plane, within the cache


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
    slab_rows: int | None = None,
    block_elements: int = BLOCK_ELEMENTS,
    compiled: bool | None = None,
    progress: Callable[[int], None] | None = None,
) -> LineSums:
    """Windowed lines of the reflected signal at each frequency, without forming the signal.

    Args:
        source: |v|, read by slabs.
        responses: R of the lines of each frequency, F of them.
        frequency: Hz, shape (F,).
        record: window and edge rule.
        tables: edge table of each frequency, None where the lines are exact.
        grid: velocity levels of ``tables``.
        backward: whether the reply to e^{-j omega t} is needed too.
        slab_rows, block_elements: sizes; they change the result by rounding only. Default rows:
            ``SLAB_ROWS``, fewer where a plane has so many probes that memory would grow with it.
        compiled: fuse the formula into one loop; default only where that pays. A missing compiler
            is warned of once and changes nothing but the time.
        progress: called with the number of samples done.
    Returns:
        Sums, complex128, (P, F), on the source's device; differentiable in the liner.
    """
    slab_rows = rows_per_slab(source.probes, SLAB_ROWS) if slab_rows is None else slab_rows
    weights = [_weights(record, float(f), backward) for f in frequency]
    fused = [
        _fused(response, source, weight, slab_rows, compiled)
        for response, weight in zip(responses, weights, strict=True)
    ]
    totals = [_zero(source, 2 if backward else 1) for _ in weights]
    for begin in range(0, record.samples, slab_rows):
        end = min(begin + slab_rows, record.samples)
        slab = source.read(begin, end)
        for i, (response, weight, table) in enumerate(zip(responses, weights, tables, strict=True)):
            now = weight[begin:end]
            rows = None if table is None else table.rows(begin, end)
            loop = fused[i]
            if loop is not None and isinstance(response, LawResponse):
                totals[i] = totals[i] + _fused_sums(loop, response.law, slab, now, slab_rows)
            if loop is None or rows is not None:
                step = max(1, block_elements // max(1, slab.shape[1]))
                for low in range(0, end - begin, step):
                    part = slice(low, min(low + step, end - begin))
                    if loop is None:
                        totals[i] = totals[i] + _line_sums(response.lines(slab[part]), now[part])
                    if rows is not None and grid is not None:
                        located = grid.locate(slab[part])
                        totals[i] = totals[i] + _edge_sums(rows, part, located, len(totals[i]))
        if progress is not None:
            progress(end - begin)
    forward = torch.stack([total[0] for total in totals], dim=1)
    if not backward:
        return LineSums(forward, None)
    return LineSums(forward, torch.stack([total[1] for total in totals], dim=1))


def _zero(source: SpeedSource, directions: int) -> Tensor:
    return torch.zeros(directions, source.probes, dtype=torch.complex128, device=source.device)


def _fused(
    response: Response, source: SpeedSource, weights: Tensor, rows: int, compiled: bool | None
) -> Fused | None:
    """The compiled loop for one frequency, or None for the eager one."""
    if compiled is False or not isinstance(response, LawResponse):
        return None
    if any(value.requires_grad for value in vars(response.law).values()):
        return None
    lines, directions = weights.shape[1:]
    if compiled is None and source.samples * source.probes * lines < PAYS_FROM:
        return None
    shape = (rows, source.probes)
    return compile_line_sums(source.device, source.dtype, shape, lines, 2 * directions)


def _fused_sums(loop: Fused, law: SpeedLaw, slab: Tensor, weights: Tensor, rows: int) -> Tensor:
    """One slab through the compiled loop; a short last slab is padded with weight 0."""
    parts = torch.view_as_real(weights).reshape(*weights.shape[:2], -1)
    coefficients = torch.stack(list(vars(law).values()), dim=1)
    if len(slab) < rows:
        slab = torch.cat([slab, slab.new_zeros(rows - len(slab), slab.shape[1])])
        parts = torch.cat([parts, parts.new_zeros(rows - len(parts), *parts.shape[1:])])
    sums = loop(slab, coefficients.to(slab), parts.to(slab))
    return torch.complex(sums[0::2], sums[1::2])


def _weights(record: Record, frequency: float, backward: bool) -> Tensor:
    """Weights of the lines, complex128, (n, lines, 1 or 2)."""
    forward = record.line_weights(frequency)
    if not backward:
        return forward[..., None]
    steps = torch.arange(record.samples, dtype=torch.float64)
    turning = torch.exp(-4j * torch.pi * frequency / record.sampling_rate * steps)
    return torch.stack([forward, forward * turning[:, None]], dim=-1)


def _line_sums(lines: list[Parts], weights: Tensor) -> Tensor:
    """Sum over time and lines of weight times R, complex128, (directions, P)."""
    total = None
    for i, (real, imaginary) in enumerate(lines):
        pair = torch.view_as_real(weights[:, i]).reshape(len(weights), -1).T
        pair = pair.to(real.device, real.dtype)  # (2 directions, t): re, im, re, im
        a, b = (pair @ real).to(torch.float64), (pair @ imaginary).to(torch.float64)
        part = torch.complex(a[0::2] - b[1::2], a[1::2] + b[0::2])
        total = part if total is None else total + part
    assert total is not None
    return total


def _edge_sums(
    rows: tuple[Tensor, Tensor], part: slice, located: tuple[Tensor, list[Tensor]], count: int
) -> Tensor:
    """Sum over time of the edge tables at each probe's |v|, complex128, (directions, P).

    Args:
        rows: forward and backward table of the slab, (t, V) each.
        part: rows of the slab that ``located`` (t, P) stands for.
        located: |v| on the grid.
        count: 1 for the forward table alone, 2 for both.
    """
    index, weights = located
    single = weights[0].dtype == torch.float32
    kind = torch.complex64 if single else torch.complex128
    sums = []
    for table in rows[:count]:
        flat = table[part].to(index.device, kind).reshape(-1)
        offset = torch.arange(len(index), device=index.device)[:, None] * table.shape[1]
        sums.append(interpolate(flat, index + offset, weights).to(torch.complex128).sum(0))
    return torch.stack(sums)
