"""The first pass over a plane: what must be known of the whole record before it is replayed."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.records import VelocityPlane
from torchliner.records.slabs import slab_bounds
from torchliner.replay.periodic import PeriodicSums
from torchliner.replay.probe_velocity import ProbeVelocity
from torchliner.replay.sources import block_elements, blocks, weighted_sums
from torchliner.replay.survey_blocks import VelocityBlocks, VelocityBlockSums
from torchliner.signals.blocks import Blocks
from torchliner.signals.tones import line_sums, waves

PERIODS_PER_SEGMENT = 2.0
TOGETHER = 1 << 17  # samples times columns of coherence segments that are added at once


@dataclass(frozen=True)
class Survey:
    """Sums over a whole record, float64 or complex128.

    Args:
        mean: m/s, (P,).
        mean_square: of v, m2/s2, (P,).
        smallest, largest: of v, m/s, (P,).
        bad: number of samples that are nan or inf, (P,).
        first_bad: time index of the first of them, -1 if none, (P,).
        line: sum of w (v - mean) e^{-j omega t}, (P, F).
        coherence: of v with a steady tone, 0 to 1, (P, F).
        segments: number of segments behind ``coherence``.
        blocks, cell_blocks: means over blocks of the record, of all columns where they were asked
            for, of the cells, the last group, wherever there are blocks.
    """

    mean: Tensor
    mean_square: Tensor
    smallest: Tensor
    largest: Tensor
    bad: Tensor
    first_bad: Tensor
    line: Tensor
    coherence: Tensor
    segments: int
    blocks: VelocityBlocks | None = None
    cell_blocks: VelocityBlocks | None = None

    @property
    def rms(self) -> Tensor:
        """rms of v with its mean removed, eq. (3.6), (P,)."""
        return (self.mean_square - self.mean**2).clamp(min=0).sqrt()

    @classmethod
    def join(cls, parts: Sequence[Survey]) -> Survey:
        """Groups of columns side by side."""
        columns = set(vars(parts[0])) - {"segments", "blocks", "cell_blocks"}
        joined: dict[str, Any] = {
            name: torch.cat([getattr(part, name) for part in parts]) for name in columns
        }
        blocks = [part.blocks for part in parts if part.blocks is not None]
        kept = VelocityBlocks.join(blocks) if blocks else None
        return dataclasses.replace(parts[0], **joined, blocks=kept)


def survey(
    source: ProbeVelocity,
    frequency: Tensor,
    sampling_rate: float,
    weights: Tensor,
    progress: Callable[[int], None] | None = None,
    blocks: Blocks | None = None,
    of_probes: bool = True,
    periodic: PeriodicSums | None = None,
) -> Survey:
    """One pass over ``source``: extremes, moments, faults, tone and coherence.

    Args:
        source: n samples of P columns.
        frequency: Hz, (F,).
        sampling_rate: Hz.
        weights: window over the n samples, float64, (n,), zero in the pre-roll.
        progress: called with the number of samples done.
        blocks: over which the velocity's own means are kept too; ``of_probes``: of all columns,
            not of the cells alone.
        periodic: to be given the probes of the first group as they come by.

    Sums of up to 16 samples are made in the data's precision, all others in float64. The coherence
    is that between v and a tone of constant phase, from S segments of two periods with Hann
    windows: |sum V_s|^2 / (S sum |V_s|^2). Without a tone its mean is 1/S.
    """
    n = source.samples
    analysis = _Analysis(n, frequency, sampling_rate, weights)
    groups = [_Sums(analysis, width, source.device) for width in source.widths]
    first = 0 if of_probes else -1
    means = [
        VelocityBlockSums(blocks, frequency.cpu(), sampling_rate, width, source.device)
        for width in source.widths[first:]
        if blocks is not None
    ]
    bounds = source.bounds()
    for (begin, end), slabs in zip(bounds, source.slabs(bounds), strict=True):
        for low, high in analysis.pieces(begin, end, sum(source.widths)):
            rows = analysis.rows(low, high)
            for group, slab in zip(groups, slabs, strict=True):
                group.add(low, high, rows, slab[low - begin : high - begin])
        for each, slab in zip(means, slabs[first:], strict=bool(means)):
            each.add(begin, slab)
        if periodic is not None:
            periodic.add(begin, slabs[0])
        if progress is not None:
            progress(end - begin)
    kept, found = [each.result() for each in means], Survey.join([g.result() for g in groups])
    joined = VelocityBlocks.join(kept) if kept and of_probes else None
    return dataclasses.replace(found, blocks=joined, cell_blocks=kept[-1] if kept else None)


def moments(plane: VelocityPlane) -> tuple[Tensor, Tensor]:
    """Time mean of v and of v squared, m/s and m2/s2, each (P,), by slabs in float64."""
    total = torch.zeros(plane.probes, dtype=torch.float64)
    square = torch.zeros_like(total)
    for begin, end in slab_bounds(plane.samples, plane.probes):
        slab = plane.read(begin, end).cpu().to(torch.float64)
        total += slab.sum(0)
        square += (slab**2).sum(0)
    return total / plane.samples, square / plane.samples


class _Sums:
    """Running sums of one group of columns."""

    def __init__(self, analysis: _Analysis, width: int, device: torch.device) -> None:
        self.analysis = analysis
        count = len(analysis.frequency)
        # Mean, then real and imaginary parts of the window's lines.
        self.linear = torch.zeros(1 + 2 * count, width, dtype=torch.float64, device=device)
        self.square = torch.zeros(width, dtype=torch.float64, device=device)
        self.smallest = torch.full_like(self.square, torch.inf)
        self.largest = torch.full_like(self.square, -torch.inf)
        self.bad = torch.zeros(width, dtype=torch.int64, device=device)
        self.first_bad = torch.full_like(self.bad, -1)
        self.coherence = _Coherence(analysis, width, device)

    def add(self, begin: int, end: int, rows: Tensor, slab: Tensor) -> None:
        """Samples begin .. end - 1, a piece of the analysis, with its rows."""
        count = len(self.linear)
        whole = self.analysis.whole_segments(begin, end)
        if whole > 1:
            self._add_segments(begin, whole, slab)
        window = torch.complex(*rows[count:].sum(1).to(slab.device).chunk(2))
        rows = rows.to(slab.device, slab.dtype)
        segment = torch.zeros(
            len(rows) - count, slab.shape[1], dtype=torch.float64, device=slab.device
        )
        for part, columns in blocks(slab.shape[0], slab.shape[1], block_elements(slab.device)):
            block = slab[part, columns]
            low, high = block.amin(0), block.amax(0)
            if not bool(torch.isfinite(low + high).all()):
                block = self._without_faults(block, begin + part.start, columns)
                low, high = block.amin(0), block.amax(0)
            self.smallest[columns] = torch.minimum(self.smallest[columns], low)
            self.largest[columns] = torch.maximum(self.largest[columns], high)
            self.square[columns] += (block * block).sum(0, dtype=torch.float64)
            products = weighted_sums(rows[:, part], block)
            self.linear[:, columns] += products[:count]
            segment[:, columns] += products[count:]
        self.coherence.rounding = max(1e-12, 16 * torch.finfo(slab.dtype).eps)
        if len(segment):
            self.coherence.add(end, torch.complex(*segment.chunk(2)), window[:, None])

    def _add_segments(self, begin: int, whole: int, slab: Tensor) -> None:
        """Coherence of several whole segments at once: segments side by side as columns."""
        columns = slab.unflatten(0, (whole, -1)).transpose(0, 1).flatten(1)
        if not bool(torch.isfinite(columns).all()):
            columns = torch.where(torch.isfinite(columns), columns, 0.0)
        rows = self.analysis.segment_rows().to(slab.device)
        products = torch.complex(*weighted_sums(rows.to(slab.dtype), columns).chunk(2))
        window = torch.complex(*rows.sum(1).chunk(2))[:, None]
        self.coherence.add_whole(begin, products.unflatten(1, (whole, -1)), window)

    def _without_faults(self, block: Tensor, begin: int, columns: slice) -> Tensor:
        wrong = ~torch.isfinite(block)
        first = self.first_bad[columns]  # a view
        new = wrong.any(0) & (first < 0)
        first[new] = begin + wrong.to(torch.int8).argmax(0)[new]
        self.bad[columns] += wrong.sum(0)
        return torch.where(wrong, 0.0, block)

    def result(self) -> Survey:
        n = self.analysis.samples
        mean = self.linear[0] / n
        lines = torch.complex(*self.linear[1:].chunk(2))
        lines = lines - self.analysis.window_lines().to(mean.device)[:, None] * mean
        coherence = self.coherence.result(mean, self.square / n).T
        return Survey(
            mean, self.square / n, self.smallest, self.largest, self.bad, self.first_bad,
            lines.T, coherence, self.analysis.segments,
        )  # fmt: skip


class _Analysis:
    """Rows of e^{-j omega t} under the window and under the coherence segments."""

    def __init__(self, n: int, frequency: Tensor, sampling_rate: float, weights: Tensor) -> None:
        self.samples, self.weights = n, weights
        self.frequency, self.sampling_rate = frequency.cpu(), sampling_rate
        period = sampling_rate / float(frequency.min())
        self.segment_length = max(1, min(n, round(PERIODS_PER_SEGMENT * period)))
        self.segments = max(1, n // self.segment_length)
        steps = torch.arange(self.segment_length, dtype=torch.float64)
        self.hann = 0.5 - 0.5 * torch.cos(2 * torch.pi * steps / self.segment_length)

    def pieces(self, begin: int, end: int, columns: int) -> list[tuple[int, int]]:
        """begin .. end - 1 in parts of a segment, and in whole segments where they are small."""
        length, last = self.segment_length, self.segments * self.segment_length
        cuts = [k for k in range(begin - begin % length + length, end, length) if k <= last]
        together = max(1, TOGETHER // (length * columns))
        kept = [*cuts[:-1:together], *cuts[-1:]]
        return list(itertools.pairwise([begin, *kept, end]))

    def whole_segments(self, begin: int, end: int) -> int:
        """How many make up begin .. end - 1; 0 where it is a part, or beyond the last."""
        inside = begin % self.segment_length == 0 == end % self.segment_length
        whole = (end - begin) // self.segment_length
        return whole if inside and end <= self.segments * self.segment_length else 0

    def segment_rows(self) -> Tensor:
        """Lines of a segment from its own first sample on, real and imaginary, (2 F, L)."""
        line = waves(self.frequency, self.sampling_rate, 0, self.segment_length) * self.hann
        return torch.cat([line.real, line.imag])

    def rows(self, begin: int, end: int) -> Tensor:
        """Ones; lines, real and imaginary; lines of a segment, if this is one or a part of one."""
        turning = waves(self.frequency, self.sampling_rate, begin, end)
        parts = [torch.ones(1, end - begin, dtype=torch.float64)]
        lines = turning * self.weights[begin:end]
        parts += [lines.real, lines.imag]
        several = self.whole_segments(begin, end) > 1
        if begin < self.segments * self.segment_length and not several:
            segment = turning * self.hann[torch.arange(begin, end) % self.segment_length]
            parts += [segment.real, segment.imag]
        return torch.cat(parts)

    def window_lines(self) -> Tensor:
        return line_sums(self.weights, self.frequency, self.sampling_rate)


class _Coherence:
    """Running sums over segments; only the unfinished one is held."""

    def __init__(self, analysis: _Analysis, width: int, device: torch.device) -> None:
        self.analysis, self.rounding = analysis, 1e-12
        shape = (len(analysis.frequency), width)
        self.current = torch.zeros(shape, dtype=torch.complex128, device=device)
        self.total = torch.zeros_like(self.current)
        self.power = torch.zeros(shape, dtype=torch.float64, device=device)
        # The window's own lines, for the mean velocity that is known only at the end.
        self.window = torch.zeros(shape[0], 1, dtype=torch.complex128, device=device)
        self.window_total = torch.zeros_like(self.window)
        self.window_power = torch.zeros(shape[0], 1, dtype=torch.float64, device=device)
        self.cross = torch.zeros_like(self.power)

    def add(self, end: int, products: Tensor, window: Tensor) -> None:
        """Samples before ``end``, in order: segment lines times them, (F, P), and alone, (F, 1)."""
        self.current += products
        self.window += window
        if end % self.analysis.segment_length == 0:
            self.total += self.current
            self.power += self.current.abs() ** 2
            self.window_total += self.window
            self.window_power += self.window.abs() ** 2
            self.cross += (self.current * self.window.conj()).real
            self.current.zero_()
            self.window.zero_()

    def add_whole(self, begin: int, products: Tensor, window: Tensor) -> None:
        """Whole segments from sample ``begin`` on, read from their own first samples: (F, S, P)."""
        own = self.analysis
        starts = begin + own.segment_length * torch.arange(products.shape[1], dtype=torch.float64)
        turns = torch.outer(2 * torch.pi / own.sampling_rate * own.frequency, starts)
        phase = torch.exp(-1j * turns).to(products.device)
        self.total += (phase[..., None] * products).sum(1)
        self.power += products.abs().square().sum(1)
        self.window_total += (phase * window).sum(1, keepdim=True)
        self.window_power += products.shape[1] * window.abs() ** 2
        self.cross += (products * window.conj()[:, None]).real.sum(1)

    def result(self, mean: Tensor, mean_square: Tensor) -> Tensor:
        """|sum V_s|^2 / (S sum |V_s|^2) of v without its mean, (F, P)."""
        total = self.total - mean * self.window_total
        power = self.power - 2 * mean * self.cross + mean**2 * self.window_power
        power = self.analysis.segments * power
        # A constant probe leaves rounding behind, which would be coherent with itself.
        length, segments = self.analysis.segment_length, self.analysis.segments
        floor = (segments * length * self.rounding) ** 2 * mean_square
        return torch.where(power > floor, total.abs() ** 2 / power.clamp(min=1e-300), 0.0)
