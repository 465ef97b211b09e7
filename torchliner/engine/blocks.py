"""A record cut into blocks of whole periods: the unit of work, of merging and of error bars.

A block has one owner. So a record that is streamed, split over workers or still growing gives the same bits as one
that is reduced at once: more or fewer rows of tensors whose first axis is the block.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

MOST_BLOCKS = 32  # twice as many would sharpen an interval by 5 % and double the memory of every probe
SLACK = 0.05  # of a period: a record of 15.96 periods counts as 16
SLAB = 256  # rows that are summed in the precision of the data; sums of slabs are added in float64


class Slab(NamedTuple):
    """Samples ``begin`` .. ``end`` - 1 of the block at ``place`` among those that are taken."""

    place: int
    begin: int
    end: int


@dataclass(frozen=True)
class Blocks:
    """S blocks of whole periods of one tone, ``periods`` in all, by their first samples and the end of the last one."""

    borders: tuple[int, ...]
    sampling_rate: float
    periods: int

    @classmethod
    def of(cls, samples: int, sampling_rate: float, tone: float, most: int = MOST_BLOCKS) -> Blocks:
        """All whole periods of a record, in at most ``most`` blocks as equal as can be; ``tone`` in Hz. ValueError
        where it holds none."""
        periods = int(samples * tone / sampling_rate + SLACK)
        if periods < 1:
            raise ValueError(f"the record holds no period of {tone:g} Hz; one is the least")
        count = min(periods, most)
        steps = (round(periods * i // count * sampling_rate / tone) for i in range(count + 1))
        return cls(tuple(min(samples, step) for step in steps), sampling_rate, periods)

    @property
    def count(self) -> int:
        """S."""
        return len(self.borders) - 1

    @property
    def lengths(self) -> Tensor:
        """Samples of each block, float64, (S,)."""
        return torch.tensor(self.borders, dtype=torch.float64).diff()

    def batches(
        self, rows: int, slab: int = SLAB, only: Iterable[int] | None = None, *, across: bool = False
    ) -> Iterator[list[Slab]]:
        """Slabs in order of time, those that are worked on together in one list: of at most ``rows`` samples if one
        slab is not longer, and of several blocks if ``across``. Slabs of a block are as equal as can be. ``only``:
        blocks to take, rising; default all."""
        batch: list[Slab] = []
        for place, block in enumerate(range(self.count) if only is None else only):
            begin, end = self.borders[block : block + 2]
            count = max(1, math.ceil((end - begin) / slab))
            for low, high in pairwise(begin + (end - begin) * i // count for i in range(count + 1)):
                goes_on = batch and batch[-1].end == low and (across or batch[-1].place == place)
                if batch and not (goes_on and high - batch[0].begin <= rows):
                    yield batch
                    batch = []
                batch.append(Slab(place, low, high))
        if batch:
            yield batch

    def wave_sums(self, frequency: Tensor) -> Tensor:
        """Sum of e^{-j omega t} over each block, in closed form: complex128, (S, F), of frequencies in Hz, (F,)."""
        begin, end = torch.tensor(self.borders, dtype=torch.float64)[:, None].unfold(0, 2, 1).unbind(-1)
        turn = 2 * torch.pi / self.sampling_rate * frequency.to("cpu", torch.float64)
        sine, count = torch.sin(turn / 2), end - begin + 0 * turn
        still = sine.abs() < 1e-12  # f is 0 or a multiple of the sampling rate
        ratio = torch.where(still, count, torch.sin(turn / 2 * count) / torch.where(still, 1.0, sine))
        return torch.exp(-0.5j * turn * (begin + end - 1)) * ratio


def waves(lines: Tensor, sampling_rate: float, begin: int, end: int) -> Tensor:
    """Rows 1, cos and sin of lines (Hz, (L,)) at samples begin .. end - 1: float64, (1 + 2 L, t). Each sample has the
    same bits wherever the rows begin."""
    steps = torch.arange(begin, end, dtype=torch.float64, device=lines.device)
    angle = torch.outer(2 * torch.pi / sampling_rate * lines, steps)
    return torch.cat([torch.ones_like(steps)[None], angle.cos(), angle.sin()])
