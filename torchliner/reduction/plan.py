"""How one pass cuts a record: pieces of time, blocks of whole periods, rows of weights."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchliner.records.slabs import SLAB_ROWS
from torchliner.signals.blocks import Blocks
from torchliner.signals.tones import waves

ENDLESS = 1 << 40  # samples, of a record whose end is not known
SAME = 1e-9  # relative: closer frequencies are one


@dataclass(frozen=True)
class PassPlan:
    """What is summed over which samples.

    Sums in the precision of the data are made over pieces, which end at the borders of blocks and
    at multiples of 256 samples of the record: so they do not depend on how the record is cut into
    slabs, whose bounds are such multiples.

    Args:
        samples: n of the record.
        sampling_rate: Hz.
        begin, end: samples that are weighed, of all.
        blocks: of whole periods, S of them, within them.
        lines: Hz, of the waves that are summed beside the weight 1, (L,) as a tuple.
    """

    samples: int
    sampling_rate: float
    begin: int
    end: int
    blocks: Blocks
    lines: tuple[float, ...] = ()

    @property
    def rest(self) -> int:
        """Number of the block of weighed samples beyond the last whole one; the next: no weight."""
        return self.blocks.count

    @functools.cached_property
    def _borders(self) -> tuple[list[int], list[int]]:
        """Where a block begins, rising from 0, and which."""
        starts: dict[int, int] = {0: self.rest + 1}
        starts[self.begin] = self.rest
        for number, border in enumerate(self.blocks.borders[:-1]):
            starts[border] = number
        if self.blocks.borders[-1] < self.end and self.blocks.count:
            starts[self.blocks.borders[-1]] = self.rest
        starts[self.end] = self.rest + 1
        places = sorted(place for place in starts if place < self.samples)
        return places, [starts[place] for place in places]

    def pieces(self, low: int, high: int) -> np.ndarray:
        """Of the weighed samples of a slab ``low`` .. ``high`` - 1.

        Returns:
            First row of the slab, the one after the last, block: int64, (pieces, 3).
        """
        found = self._cut(low, high)
        return found[found[:, 2] <= self.rest]

    def runs(self, low: int, high: int) -> tuple[np.ndarray, list[tuple[int, int, int]]]:
        """Of all samples of a slab: pieces with the number of their run, samples of one block in a
        row, instead of the block; and first sample, the one after the last and block of each run.

        What lies before the first block bears the number of what lies behind the last.
        """
        pieces = self._cut(low, high)
        change = np.diff(pieces[:, 2], prepend=-1) != 0
        first = np.flatnonzero(change)
        lows = (low + pieces[first, 0]).tolist()
        found = list(zip(lows, [*lows[1:], high], pieces[first, 2].tolist(), strict=True))
        pieces[:, 2] = change.cumsum() - 1
        return pieces, found

    def _cut(self, low: int, high: int) -> np.ndarray:
        places, numbers = self._borders
        inner = [place for place in places if low < place < high]
        multiples = range(-(-low // SLAB_ROWS) * SLAB_ROWS, high, SLAB_ROWS)
        edges = np.unique(np.array([low, high, *inner, *multiples]))
        number = np.array(numbers)[np.searchsorted(places, edges[:-1], side="right") - 1]
        return np.column_stack([edges[:-1] - low, edges[1:] - low, number])

    def numbers(self, low: int, high: int) -> range:
        """Of the weighed blocks that samples ``low`` .. ``high`` - 1 reach."""
        found = self.pieces(low, high)[:, 2].tolist()
        return range(found[0], found[-1] + 1) if found else range(0)

    def rows(self, low: int, high: int) -> Tensor | None:
        """cos and sin of the lines, float64, (2 L, t); None without any."""
        return wave_rows(self.lines, self.sampling_rate, low, high) if self.lines else None

    def wave_sums(self, frequency: Tensor) -> Tensor:
        """sum of e^{-j omega t} over the weighed samples, complex128, (F,)."""
        return geometric(frequency, self.sampling_rate, self.begin, self.end)


def geometric(frequency: Tensor, sampling_rate: float, begin: int, end: int) -> Tensor:
    """sum of e^{-j omega t} over samples begin .. end - 1, in closed form: complex128, (F,)."""
    turn = 2 * torch.pi / sampling_rate * frequency.to("cpu", torch.float64)
    half = torch.remainder(turn / 2, torch.pi)
    still = (half < SAME) | (half > torch.pi - SAME)
    ratio = torch.sin(turn / 2 * (end - begin)) / torch.where(still, 1.0, torch.sin(turn / 2))
    middle = torch.exp(-0.5j * turn * (begin + end - 1))
    return torch.where(still, (end - begin) * torch.exp(-1j * turn * begin), ratio * middle)


def block_waves(blocks: Blocks, frequency: Tensor, sampling_rate: float) -> Tensor:
    """Means of e^{-j omega t} over each block, complex128, (S, ...), of frequencies (...), Hz."""
    return torch.stack([
        geometric(frequency, sampling_rate, begin, end) / (end - begin)
        for begin, end in itertools.pairwise(blocks.borders)
    ])  # fmt: skip


def wave_rows(lines: Sequence[float], sampling_rate: float, low: int, high: int) -> Tensor:
    """cos and sin of the lines (Hz), float64, (2 L, t): first all of the one, then the other."""
    turning = waves(torch.tensor(lines, dtype=torch.float64), sampling_rate, low, high)
    return torch.cat([turning.real, -turning.imag])


def merged(lines: Iterable[float]) -> tuple[float, ...]:
    """Rising, each once, without 0; a wave and its conjugate are one line."""
    found: list[float] = []
    for line in sorted(abs(line) for line in lines):
        last = found[-1] if found else 0.0
        if line > last * (1 + SAME) and line > 1e-12:
            found.append(line)
    return tuple(found)


def index_of(lines: Sequence[float], line: float) -> int | None:
    """Place of a line among others; None where it is not."""
    for i, other in enumerate(lines):
        if abs(other - line) <= SAME * max(abs(line), 1e-300):
            return i
    return None
