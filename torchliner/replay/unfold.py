"""The whole reflected signal of every column, block by block.

Emissions come in blocks; each block's reply (``convolve``) is longer than the block by the kernel's
K - 1 samples, which are carried over and added to the next one's. What is complete goes to sinks,
which reduce or store it. Columns are worked on in batches, and in several passes over the data if
the carried tails of all of them exceed the memory: no temporary of columns x time x taps exists.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import torch
from torch import Tensor

from torchliner.reduction.sources import Columns, SpeedSource, in_full_precision
from torchliner.replay.convolve import CONVOLUTIONS, Convolution, Located
from torchliner.replay.edges import Record
from torchliner.replay.emissions import Emission
from torchliner.replay.factors import TOLERANCE, Factors, factor_taps
from torchliner.replay.kernels import KernelTable

WORK_NUMBERS = 1 << 21  # of a batch: its temporaries stay in the outer cache
GPU_NUMBERS = 1 << 27
DEFAULT_MEMORY = 1 << 30  # bytes for staged velocity and carried tails


class Sink(Protocol):
    """Takes the reflected signal as it is completed."""

    def add(self, reflected: Tensor, columns: slice, begin: int) -> None:
        """Samples ``begin`` .. of some columns: (channels, p, t), contiguous in time per column.

        Args:
            reflected: real; a complex emission has its real parts first, then the imaginary ones.
            columns: p of them.
            begin: sample.
        """
        ...

    def flush(self) -> None:
        """All columns of a pass have been given to the same sample."""
        ...


@in_full_precision
def replay_unfold(
    source: SpeedSource,
    kernels: KernelTable,
    emission: Emission,
    record: Record,
    sinks: Sequence[Sink],
    *,
    method: str = "fft",
    tolerance: float | None = None,
    memory: int | None = None,
    block: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Factors:
    """Replay ``emission`` through the kernels and hand the reflected signal to the sinks.

    Args:
        source: velocity of P columns.
        kernels: impulse responses over |v|.
        emission: incident wave, also outside the record.
        record: its edge rule says what is emitted outside.
        sinks: they see each column in order of time.
        method: ``fft``, ``matmul`` (both low-rank) or ``gather`` (whole kernels).
        tolerance: error in R allowed to the low rank; default by precision.
        memory: bytes for what is staged and carried; more passes over the data if it is small.
        block: emissions at once; default from the kernel's length, which is the least for the
            edge rule ``finite``. Rounding only.
        progress: called with numbers of samples done, n in all.
    Returns:
        The factors used, with their error.
    Raises:
        ValueError: the memory does not hold one column.
    Source: Roncen et al. (2026), eq. (3.2), extended to taps before zero. In exact arithmetic the
        same sum as ``direct``.
    """
    if tolerance is None:
        tolerance = TOLERANCE[source.dtype]
    factors = factor_taps(kernels, None if method == "gather" else tolerance)
    convolution = CONVOLUTIONS[method](_on(factors, source.device), source.dtype)
    length = block or max(3 * factors.taps, 512)
    if record.edge == "finite":  # the mean kernel of the first K samples comes from one block
        length = max(length, factors.taps)
    length = min(source.samples, length)
    plan = _Plan(factors, emission, record, length, source)
    passes = plan.passes(sum(source.widths), DEFAULT_MEMORY if memory is None else memory)
    for number, columns in enumerate(passes):
        share = None
        if progress is not None:
            done = [source.samples * (number + i) // len(passes) for i in (0, 1)]
            share = _portion(progress, done[1] - done[0], plan.emissions)
        _run_pass(plan, convolution, columns, sinks, share)
    return factors


def _on(factors: Factors, device: torch.device) -> Factors:
    return Factors(
        factors.across.to(device), factors.along.to(device), factors.first, factors.grid,
        factors.error,
    )  # fmt: skip


def _portion(progress: Callable[[int], None], total: int, count: int) -> Callable[[int], None]:
    """Report ``count`` emissions as ``total`` samples."""
    seen = [0, 0]

    def report(emissions: int) -> None:
        seen[0] += emissions
        now = total * seen[0] // count
        progress(now - seen[1])
        seen[1] = now

    return report


class _Plan:
    """What all passes share."""

    def __init__(
        self,
        factors: Factors,
        emission: Emission,
        record: Record,
        length: int,
        source: SpeedSource,
    ) -> None:
        self.factors, self.emission, self.record, self.length = factors, emission, record, length
        self.source = source
        n, taps, first = record.samples, factors.taps, factors.first
        self.low, self.high = 0, n
        if record.edge == "wrap":
            # What the record's own repetitions send into it.
            self.low, self.high = -(taps + first - 1), n - first
        self.emissions = self.high - self.low
        self.zone = min(n, taps)
        self.early = self.late = None
        if record.edge == "finite":
            self.early = self._outside(-(taps + first - 1), 0)
            self.late = self._outside(n, n - first)
        self.channels = len(self.waves(0, 1))

    def waves(self, begin: int, end: int) -> Tensor:
        """Real channels of the emission, float64, (C, t)."""
        if self.record.edge == "wrap":
            n, parts = self.record.samples, []
            while begin < end:
                lap = begin // n
                stop = min(end, (lap + 1) * n)
                parts.append(self.emission.values(begin - lap * n, stop - lap * n))
                begin = stop
            values = torch.cat(parts, dim=1)
        else:
            values = self.emission.values(begin, end)
        return torch.cat([values.real, values.imag]) if values.is_complex() else values

    def _outside(self, begin: int, end: int) -> tuple[int, Tensor] | None:
        """What emissions begin .. end - 1 outside add to the record per unit of each factor.

        Returns: first reception and (C, r, t), float64; None if there are none.
        """
        along, n = self.factors.along, self.record.samples
        if end <= begin:
            return None
        waves = self.waves(begin, end)
        size = waves.shape[1] + along.shape[1] - 1
        spectra = torch.fft.rfft(waves, n=size)[:, None] * torch.fft.rfft(along, n=size)
        replies = torch.fft.irfft(spectra, n=size)
        start = begin + self.factors.first  # reception of replies[..., 0]
        low, high = max(0, start), min(n, start + size)
        return (low, replies[..., low - start : high - start]) if low < high else None

    def passes(self, columns: int, memory: int) -> list[slice]:
        """Columns of each pass."""
        size = self.source.dtype.itemsize
        taps, rank = self.factors.taps, self.factors.rank
        each = size * (self.length + self.channels * taps) + 16 * rank
        room = memory // each
        if room < 1:
            raise ValueError(
                f"a memory limit of {memory / 1e6:.4g} MB is below the {each / 1e6:.4g} MB that "
                "one probe takes with its tail; raise memory"
            )
        count = -(-columns // room)
        step = -(-columns // count)
        return [slice(low, min(low + step, columns)) for low in range(0, columns, step)]

    def pieces(self) -> list[tuple[int, int]]:
        """Samples of the record in the order of emission."""
        n = self.record.samples
        bounds = list(self.source.bounds())
        rows = bounds[0][1] - bounds[0][0]
        found = []
        at = self.low
        while at < self.high:
            end = min(at + rows, self.high, (at // n + 1) * n)
            found.append((at % n, at % n + end - at))
            at = end
        return found


def _run_pass(
    plan: _Plan,
    convolution: Convolution,
    columns: slice,
    sinks: Sequence[Sink],
    progress: Callable[[int], None] | None,
) -> None:
    source = plan.source
    state = _Pass(plan, convolution, columns)
    width = columns.stop - columns.start
    staged = torch.empty(plan.length, width, dtype=source.dtype, device=source.device)
    filled, at = 0, plan.low
    for slab in source.slabs(plan.pieces()):
        taken, rows = 0, len(slab[0].velocity)
        while taken < rows:
            now = min(rows - taken, plan.length - filled)
            _stage(staged[filled : filled + now], slab, slice(taken, taken + now), columns)
            filled, taken = filled + now, taken + now
            last = at + filled == plan.high
            if filled == plan.length or last:
                state.process(staged[:filled], at, sinks, last)
                if progress is not None:
                    progress(filled)
                at, filled = at + filled, 0


def _stage(into: Tensor, slab: list[Columns], rows: slice, columns: slice) -> None:
    """|v| of some columns, counted over all groups."""
    start = 0
    for group in slab:
        width = group.velocity.shape[1]
        low, high = max(columns.start, start), min(columns.stop, start + width)
        if low < high:
            part = group.part(rows, slice(low - start, high - start))
            into[:, low - columns.start : high - columns.start] = part.speed
        start += width


class _Pass:
    """Carried tails and means at the ends, of the columns of one pass."""

    def __init__(self, plan: _Plan, convolution: Convolution, columns: slice) -> None:
        self.plan, self.convolution, self.columns = plan, convolution, columns
        source, factors = plan.source, plan.factors
        self.dtype, self.device = source.dtype, source.device
        width = columns.stop - columns.start
        tails = (plan.channels, width, factors.taps - 1)
        self.carry = torch.zeros(tails, dtype=self.dtype, device=self.device)
        self.means = [
            torch.zeros(width, factors.rank, dtype=torch.float64, device=self.device)
            for _ in range(2 if plan.record.edge == "finite" else 0)
        ]
        self.across = factors.across.to(self.device, self.dtype)
        self.outside = [
            None if edge is None else (edge[0], edge[1].to(self.device, self.dtype)) for edge in (plan.early, plan.late)
        ]

    def process(self, speed: Tensor, begin: int, sinks: Sequence[Sink], last: bool) -> None:
        """Emissions begin .. of |v| (l, columns); the tail too if they are the last."""
        plan, length = self.plan, len(speed)
        waves = plan.waves(begin, begin + length).to(self.device, self.dtype)
        work = WORK_NUMBERS if self.device.type == "cpu" else GPU_NUMBERS
        at_once = max(1, work // self.convolution.numbers(length))
        first = begin + plan.factors.first  # reception of the reply's first sample
        done = length + plan.factors.taps - 1 if last else length
        low, high = max(0, -first), min(done, plan.record.samples - first)
        for left in range(0, speed.shape[1], at_once):
            part = slice(left, min(left + at_once, speed.shape[1]))
            block = Located(*plan.factors.grid.locate(speed[:, part].T.contiguous()))
            reply = self.convolution(block, waves)
            reply[..., : plan.factors.taps - 1] += self.carry[:, part]
            self.carry[:, part] = reply[..., length:]
            self._collect_ends(block, part, begin, length)
            if low >= high:
                continue
            complete = reply[..., low:high]
            self._add_outside(complete, part, first + low)
            where = slice(self.columns.start + part.start, self.columns.start + part.stop)
            for sink in sinks:
                sink.add(complete, where, first + low)
        for sink in sinks:
            sink.flush()

    def _collect_ends(self, block: Located, part: slice, begin: int, length: int) -> None:
        """Mean factors of the first and the last K samples, for the rule ``finite``."""
        zone, n = self.plan.zone, self.plan.record.samples
        for mean, (low, high) in zip(self.means, ((0, zone), (n - zone, n)), strict=False):
            left, right = max(low - begin, 0), min(high - begin, length)
            if left < right:
                rows = block.rows(self.across, left, right)
                mean[part] += rows.sum(1, dtype=torch.float64) / zone

    def _add_outside(self, complete: Tensor, part: slice, begin: int) -> None:
        end = begin + complete.shape[2]
        for mean, edge in zip(self.means, self.outside, strict=False):
            if edge is None:
                continue
            start, replies = edge
            low, high = max(begin, start), min(end, start + replies.shape[2])
            if low < high:
                seen = replies[..., low - start : high - start]
                amount = mean[part].to(self.dtype)
                complete[..., low - begin : high - begin] += amount @ seen
