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
from torchliner.replay.sources import block_elements, blocks, in_full_precision, weighted_sums
from torchliner.replay.survey_blocks import VelocityBlocks, VelocityBlockSums
from torchliner.signals.blocks import Blocks
from torchliner.signals.tones import line_sums, waves

PERIODS_PER_SEGMENT = 2.0


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
        segments: behind ``coherence`` at each frequency, F of them.
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
    segments: tuple[int, ...]
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
        joined: Any = {name: torch.cat([getattr(p, name) for p in parts]) for name in columns}
        blocks = [part.blocks for part in parts if part.blocks is not None]
        kept = VelocityBlocks.join(blocks) if blocks else None
        return dataclasses.replace(parts[0], **joined, blocks=kept)


@in_full_precision
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
        blocks: over which v's own means are kept too, without ``of_probes`` of the cells alone.
        periodic: to be given the probes of the first group as they come by.

    Sums of up to 16 samples are made in the data's precision, all others in float64. The coherence
    is that between v and a tone of constant phase, from S segments of two of its own periods with
    Hann windows: |sum V_s|^2 / (S sum |V_s|^2). Without a tone its mean is 1/S.
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
        rows = analysis.rows(begin, end)
        for group, slab in zip(groups, slabs, strict=True):
            group.add(begin, rows, slab)
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
        self.coherence = [_Coherence(each, width, device) for each in analysis.segments]

    def add(self, begin: int, rows: Tensor, slab: Tensor) -> None:
        """Samples from ``begin`` on, with the analysis' rows."""
        rows = rows.to(slab.device, slab.dtype)
        for part, columns in blocks(slab.shape[0], slab.shape[1], block_elements(slab.device)):
            block, first = slab[part, columns], begin + part.start
            low, high = block.amin(0), block.amax(0)
            if not bool(torch.isfinite(low + high).all()):
                block = self._without_faults(block, first, columns)
                low, high = block.amin(0), block.amax(0)
            self.smallest[columns] = torch.minimum(self.smallest[columns], low)
            self.largest[columns] = torch.maximum(self.largest[columns], high)
            self.square[columns] += (block * block).sum(0, dtype=torch.float64)
            self.linear[:, columns] += weighted_sums(rows[:, part], block)
            for each in self.coherence:
                each.add(first, block, columns)

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
        coherence = torch.empty(len(lines), len(mean), dtype=torch.float64, device=mean.device)
        for each in self.coherence:
            coherence[each.own.index] = each.result(mean, self.square / n)
        return Survey(
            mean, self.square / n, self.smallest, self.largest, self.bad, self.first_bad,
            lines.T, coherence.T, self.analysis.counts(),
        )  # fmt: skip


class _Analysis:
    """Rows of e^{-j omega t} under the window, and the segments of each frequency."""

    def __init__(self, n: int, frequency: Tensor, sampling_rate: float, weights: Tensor) -> None:
        self.samples, self.weights = n, weights
        self.frequency, self.sampling_rate = frequency.cpu(), sampling_rate
        # Two of each frequency's own periods, so that no other frequency matters to it.
        lengths = (PERIODS_PER_SEGMENT * sampling_rate / self.frequency).round().clamp(1, n)
        self.lengths = lengths.to(torch.int64)
        self.segments = [
            _Segments(n, int(length), self.frequency, (self.lengths == length).nonzero()[:, 0],
                      sampling_rate)
            for length in self.lengths.unique()
        ]  # fmt: skip

    def counts(self) -> tuple[int, ...]:
        """Segments at each frequency."""
        return tuple((self.samples // self.lengths).tolist())

    def rows(self, begin: int, end: int) -> Tensor:
        """Ones; lines, real and imaginary."""
        turning = waves(self.frequency, self.sampling_rate, begin, end)
        lines = turning * self.weights[begin:end]
        return torch.cat([torch.ones(1, end - begin), lines.real, lines.imag])

    def window_lines(self) -> Tensor:
        return line_sums(self.weights, self.frequency, self.sampling_rate)


class _Segments:
    """Segments of one length, and the frequencies that have it."""

    def __init__(
        self, n: int, length: int, frequency: Tensor, index: Tensor, sampling_rate: float
    ) -> None:
        """``index`` of the frequencies among all, (G,)."""
        self.index, self.length, self.count = index, length, n // length
        self.frequency, self.sampling_rate = frequency[index], sampling_rate
        steps = torch.arange(length, dtype=torch.float64)
        hann = 0.5 - 0.5 * torch.cos(2 * torch.pi * steps / length)
        # Of a segment, phase from its own first sample on, (G, length).
        self.turning = waves(self.frequency, sampling_rate, 0, length) * hann

    def pieces(self, begin: int, end: int) -> list[tuple[int, int]]:
        """begin .. end - 1 in parts of a segment and whole segments; none beyond the last."""
        end = min(end, self.count * self.length)
        borders = (-(-begin // self.length) * self.length, end // self.length * self.length)
        cuts = sorted({begin, end, *(k for k in borders if begin < k < end)}) if begin < end else []
        return list(itertools.pairwise(cuts))


class _Coherence:
    """Running sums over segments of one group of columns; only unfinished ones are held."""

    def __init__(self, own: _Segments, width: int, device: torch.device) -> None:
        self.own = own
        shape = (len(own.index), width)
        self.current = torch.zeros(shape, dtype=torch.complex128, device=device)
        self.total = torch.zeros_like(self.current)
        self.power = torch.zeros(shape, dtype=torch.float64, device=device)
        # With the window's own line, for the mean velocity that is known only at the end.
        self.cross = torch.zeros_like(self.power)
        self.window = own.turning.sum(1).to(device)[:, None]
        self.rounding = 1e-12

    def add(self, begin: int, block: Tensor, columns: slice) -> None:
        """Samples from ``begin`` on of some columns, (t, p), in order."""
        self.rounding = max(1e-12, 16 * torch.finfo(block.dtype).eps)
        length = self.own.length
        for low, high in self.own.pieces(begin, begin + len(block)):
            piece, place = block[low - begin : high - begin], low % length
            whole = max(1, (high - low) // length)
            turning = self.own.turning[:, place : place + (high - low) // whole]
            rows = torch.cat([turning.real, turning.imag]).to(block.device, block.dtype)
            # Segments side by side as columns.
            wide = piece.unflatten(0, (whole, -1)).transpose(0, 1).flatten(1)
            lines = torch.complex(*weighted_sums(rows, wide).chunk(2)).unflatten(1, (whole, -1))
            if high - low < length:
                self.current[:, columns] += lines[:, 0]
                if high % length:
                    continue
                lines = self.current[:, None, columns].clone()
                self.current[:, columns] = 0
            self._keep(high // length - whole, lines, columns)

    def _keep(self, first: int, lines: Tensor, columns: slice) -> None:
        """Whole segments from number ``first`` on, read from their own first samples, (G, S, p)."""
        phase = self._phase(first, first + lines.shape[1]).to(lines.device)
        self.total[:, columns] += (phase[..., None] * lines).sum(1)
        self.power[:, columns] += lines.abs().square().sum(1)
        self.cross[:, columns] += (lines * self.window.conj()[:, None]).real.sum(1)

    def _phase(self, first: int, last: int) -> Tensor:
        """Of segments first .. last - 1, (G, S)."""
        own = self.own
        starts = own.length * torch.arange(first, last, dtype=torch.float64)
        turns = torch.outer(2 * torch.pi / own.sampling_rate * own.frequency, starts)
        return torch.exp(-1j * turns)

    def result(self, mean: Tensor, mean_square: Tensor) -> Tensor:
        """|sum V_s|^2 / (S sum |V_s|^2) of v without its mean, (G, P)."""
        count, length = self.own.count, self.own.length
        turns = self._phase(0, count).sum(1, keepdim=True).to(mean.device)
        total = self.total - mean * turns * self.window
        power = self.power - 2 * mean * self.cross + mean**2 * count * self.window.abs() ** 2
        # A constant probe leaves rounding behind, which would be coherent with itself.
        floor = (count * length * self.rounding) ** 2 * mean_square
        power = count * power
        return torch.where(power > floor, total.abs() ** 2 / power.clamp(min=1e-300), 0.0)
