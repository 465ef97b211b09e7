"""The first pass over a plane: what must be known of the whole record before it is replayed."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.reduction.block_sums import BlockSums, VelocityBlocks
from torchliner.reduction.coherence import SegmentLines, SegmentWeights, ToneCoherence
from torchliner.reduction.eager import Lines, continued
from torchliner.reduction.periodic import PeriodicSums
from torchliner.reduction.plan import PassPlan
from torchliner.signals.tones import line_sums, waves


@dataclass(frozen=True)
class Survey:
    """Sums over a whole record, float64 or complex128.

    Args:
        mean: m/s, (P,).
        mean_square: of v, m2/s2, (P,).
        smallest, largest: of v, m/s, (P,).
        bad: number of samples that are nan or inf, (P,); the other sums of such a column are nan.
        first_bad: time index of the first of them, -1 if none, (P,).
        line: sum of w (v - mean) e^{-j omega t}, (P, F); nan where no tone was asked for.
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

    @property
    def peak(self) -> Tensor:
        """Largest |v|, m/s, (P,)."""
        return torch.maximum(self.largest.abs(), self.smallest.abs())

    @classmethod
    def join(cls, parts: Sequence[Survey]) -> Survey:
        """Groups of columns side by side."""
        columns = set(vars(parts[0])) - {"segments", "blocks", "cell_blocks"}
        joined: Any = {name: torch.cat([getattr(p, name) for p in parts]) for name in columns}
        blocks = [part.blocks for part in parts if part.blocks is not None]
        kept = VelocityBlocks.join(blocks) if blocks else None
        return dataclasses.replace(parts[0], **joined, blocks=kept)

    def part(self, count: int) -> Survey:
        """Of the first columns alone."""
        columns = set(vars(self)) - {"segments", "blocks", "cell_blocks"}
        cut: Any = {name: getattr(self, name)[:count] for name in columns}
        kept = self.blocks
        if kept is not None:
            cut["blocks"] = VelocityBlocks(*(each[:, :count] for each in vars(kept).values()))
        return dataclasses.replace(self, **cut)

    def to_frequencies(self, place: Tensor) -> Survey:
        """With the lines at ``place``, int64, (F,), of those that were measured; -1: nan."""
        missing = place < 0

        def pick(values: Tensor) -> Tensor:
            if values.shape[-1] == 0:
                return torch.full((*values.shape[:-1], len(place)), torch.nan).to(values)
            known = values[..., place.clamp(min=0)]
            return torch.where(missing.to(values.device), torch.nan, known)

        def of_blocks(blocks: VelocityBlocks | None) -> VelocityBlocks | None:
            return None if blocks is None else dataclasses.replace(blocks, line=pick(blocks.line))

        return dataclasses.replace(
            self, line=pick(self.line), coherence=pick(self.coherence),
            segments=tuple(self.segments[i] if i >= 0 else 0 for i in place.tolist()),
            blocks=of_blocks(self.blocks), cell_blocks=of_blocks(self.cell_blocks),
        )  # fmt: skip


@dataclass(frozen=True)
class SlabWeights:
    """What the samples of a slab are weighed with, alike for all groups of columns.

    Args:
        begin: its first sample.
        runs: of samples of one block in a row: the first, the one after the last, block.
        pieces: of the slab, with the number of the run in place of the block.
        rows: ones; waves; the same under the window if it is not flat; harmonics: (R, t).
        segments: the same for the coherence of each tone.
    """

    begin: int
    runs: list[tuple[int, int, int]]
    pieces: np.ndarray
    rows: Tensor
    segments: list[SegmentWeights | None]


@dataclass(frozen=True)
class SurveyLines:
    """Of one group and slab.

    Args:
        weights: of all groups.
        lines: sums over the runs, once they are made; the first one goes on with the open block.
        segments: the same for the coherence.
    """

    weights: SlabWeights
    lines: Lines
    segments: list[SegmentLines]


class SurveySums:
    """Running sums of one group of columns.

    Args:
        plan: pieces and blocks.
        tones: Hz, whose lines and coherence are wanted, (F,).
        weights: window over the n samples, float64, (n,).
        width: P.
        keeps_blocks: whether the means over blocks are kept.
        periodic: to be given the harmonics' sums.
        sound: Hz, of the tone in the data, if it is known.
        part: whether other samples come before or after these: blocks are kept apart.
    """

    def __init__(
        self, plan: PassPlan, tones: Tensor, weights: Tensor, width: int, device: torch.device,
        keeps_blocks: bool, periodic: PeriodicSums | None, sound: float | None, part: bool = False,
    ) -> None:  # fmt: skip
        self.plan, self.tones, self.weights, self.periodic = plan, tones.cpu(), weights, periodic
        self.flat = bool((weights[plan.begin : plan.end] == weights[plan.begin]).all())
        self.harmonics = 0 if periodic is None else len(periodic.harmonics.owner) - 1
        count = 1 + (2 if self.flat else 4) * len(tones) + self.harmonics
        zeros = torch.zeros(count, width, dtype=torch.float64, device=device)
        self.current, self.total = zeros, zeros.clone()
        self.weighed = zeros[1 : 1 + 2 * len(tones)].clone()
        self.current_square, self.square = torch.zeros_like(zeros[0]), torch.zeros_like(zeros[0])
        self.smallest = torch.full_like(self.square, torch.inf)
        self.largest = torch.full_like(self.square, -torch.inf)
        self.bad = torch.zeros(width, dtype=torch.int64, device=device)
        self.first_bad = torch.full_like(self.bad, -1)
        self.coherence = ToneCoherence(plan, self.tones, width, device, sound)
        self.means: list[tuple[Tensor, Tensor]] | None = [] if keeps_blocks else None
        self.open: tuple[int, int, int] | None = None  # block, its first sample and the next
        self.apart: list[BlockSums] | None = [] if part else None

    def _rows(self, low: int, high: int, turning: Tensor) -> Tensor:
        parts = [torch.ones(1, high - low, dtype=torch.float64), turning.real, turning.imag]
        if not self.flat:
            weighed = turning * self.weights[low:high]
            parts += [weighed.real, weighed.imag]
        if self.periodic is not None:
            parts.append(self.periodic.harmonics.rows(low, high)[1:])
        return torch.cat(parts)

    def weights_of(self, begin: int, slab: Tensor) -> SlabWeights:
        """Those of a slab (t, P), of samples from ``begin`` on; groups of a pass share them."""
        end = begin + len(slab)
        turning = waves(self.tones, self.plan.sampling_rate, begin, end)
        rows = self._rows(begin, end, turning).to(slab.device, slab.dtype)
        pieces, runs = self.plan.runs(begin, end)
        segments = self.coherence.weights_of(begin, slab, turning)
        return SlabWeights(begin, runs, pieces, rows, segments)

    def asked(self, weights: SlabWeights) -> SurveyLines:
        """What is to be summed of a slab, in order; then ``add`` it."""
        runs = weights.runs
        if self.open is not None and self.open[0] != runs[0][2]:
            self._close()
        if self.open is None:
            self.current = torch.zeros_like(self.current)
            self.current_square = torch.zeros_like(self.current_square)
        sums, squares = (continued(each, len(runs)) for each in (self.current, self.current_square))
        lines = Lines(weights.pieces, weights.rows, sums, squares, self.smallest, self.largest)
        return SurveyLines(weights, lines, self.coherence.asked(weights.segments))

    def add(self, found: SurveyLines, slab: Tensor) -> None:
        """What ``asked`` stands for, summed."""
        squares = found.lines.squares
        assert squares is not None
        for i, (low, high, number) in enumerate(found.weights.runs):
            if i:
                self._close()
            self.open = number, low if self.open is None else self.open[1], high
            self.current, self.current_square = found.lines.sums[i], squares[i]
        if len(squares) > 1:  # not to keep all of them in memory, and in files of parts
            self.current, self.current_square = self.current.clone(), self.current_square.clone()
        for each in found.segments:
            each.segments.add(each)
        wrong = ~torch.isfinite(self.current[0] + self.total[0])
        if bool(wrong.any()):
            self._find_faults(found.weights.begin, slab, wrong.nonzero()[:, 0])

    def _find_faults(self, begin: int, slab: Tensor, columns: Tensor) -> None:
        wrong = ~torch.isfinite(slab[:, columns])
        new = wrong.any(0) & (self.first_bad[columns] < 0)
        where = columns[new]
        self.first_bad[where] = begin + wrong[:, new].to(torch.int8).argmax(0)
        self.bad[columns] += wrong.sum(0)

    def _close(self) -> None:
        """The block that is open is complete."""
        assert self.open is not None
        own = BlockSums(*self.open, self.current, self.current_square)
        if self.apart is None:
            self._fold(own)
        else:
            self.total += self.current  # faults show in it
            self.apart.append(own)
        self.open = None

    def _fold(self, block: BlockSums) -> None:
        count, length = 2 * len(self.tones), block.high - block.low
        self.total += block.sums
        self.square += block.squares
        if block.number <= self.plan.rest:
            self.weighed += block.sums[1 : 1 + count]
        if self.means is not None and block.number < self.plan.rest:
            self.means.append((block.sums[: 1 + count] / length, block.squares / length))
        if self.periodic is not None:
            own = torch.cat([block.sums[:1], block.sums[len(block.sums) - self.harmonics :]])
            self.periodic.add(block.low, block.high, own)

    def follow(self, other: SurveySums) -> None:
        """Add the part that comes next in the record; both are kept apart by blocks."""
        assert self.apart is not None
        assert other.apart is not None
        for each in (self, other):
            if each.open is not None:
                each._close()
        first, *others = other.apart
        last = self.apart[-1] if self.apart else None
        if last is not None and last.number == first.number:
            self.apart[-1] = last.joined(first)
        else:
            self.apart.append(first)
        self.apart += others
        self.smallest = torch.minimum(self.smallest, other.smallest)
        self.largest = torch.maximum(self.largest, other.largest)
        self.first_bad = torch.where(self.first_bad < 0, other.first_bad, self.first_bad)
        self.bad = self.bad + other.bad
        self.coherence.follow(other.coherence)

    def so_far(self, plan: PassPlan) -> SurveySums:
        """What a record that ended here would have; this goes on."""
        assert self.apart is not None
        found = copy.copy(self)
        found.plan, found.apart, found.open = plan, None, None
        found.means = None if self.means is None else []
        found.total, found.weighed, found.square = (
            torch.zeros_like(each) for each in (self.total, self.weighed, self.square)
        )
        opened = [] if self.open is None else [
            BlockSums(*self.open, self.current, self.current_square)]  # fmt: skip
        for block in [*self.apart, *opened]:
            found._fold(block)
        found.coherence = self.coherence.so_far(plan)
        return found

    def halved(self) -> None:
        """Blocks 2 i and 2 i + 1 become block i."""
        assert self.apart is not None
        if self.open is not None:
            self._close()
        merged: list[BlockSums] = []
        for block in (dataclasses.replace(each, number=each.number // 2) for each in self.apart):
            if merged and merged[-1].number == block.number:
                merged[-1] = merged[-1].joined(block)
            else:
                merged.append(block)
        self.apart = merged

    def whole(self) -> SurveySums:
        """Of parts that are all there: ready for its result."""
        assert self.apart is not None
        self.total.zero_()
        for block in self.apart:
            self._fold(block)
        self.apart = None
        return self

    def result(self) -> Survey:
        """After the last sample."""
        if self.open is not None:
            self._close()
        if self.periodic is not None:
            self.periodic.finish()
        n, count = self.plan.samples, len(self.tones)
        mean = self.total[0] / n
        begin = self.plan.begin
        if self.flat:
            of_window = self.plan.wave_sums(self.tones) * self.weights[begin]
            lines = torch.complex(*self.weighed.chunk(2)) * self.weights[begin]
        else:
            of_window = line_sums(self.weights, self.tones, self.plan.sampling_rate)
            lines = torch.complex(*self.total[1 + 2 * count : 1 + 4 * count].chunk(2))
        lines = lines - of_window.to(mean.device)[:, None] * mean
        return Survey(
            mean, self.square / n, self.smallest, self.largest, self.bad, self.first_bad, lines.T,
            self.coherence.result(mean, self.square / n).T, self.coherence.counts, self._blocks(),
        )  # fmt: skip

    def _blocks(self) -> VelocityBlocks | None:
        if not self.means:  # not asked for, or no whole period
            return None
        linear, square = (torch.stack(each) for each in zip(*self.means, strict=True))
        line = torch.complex(*linear[:, 1:].chunk(2, dim=1))
        return VelocityBlocks(linear[:, 0], square, line.movedim(1, 2))
