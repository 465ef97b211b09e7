"""Means of the velocity itself over blocks of the record, where error bars need them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.replay.sources import block_elements, weighted_sums
from torchliner.replay.sources import blocks as cache_blocks
from torchliner.signals.blocks import Blocks
from torchliner.signals.tones import waves


@dataclass(frozen=True)
class VelocityBlocks:
    """Means over S blocks of the record.

    Args:
        mean: of v, m/s, (S, P).
        mean_square: of v, m2/s2, (S, P).
        line: of v e^{-j omega t}, m/s, complex128, (S, P, F).
    """

    mean: Tensor
    mean_square: Tensor
    line: Tensor

    @classmethod
    def join(cls, parts: Sequence[VelocityBlocks]) -> VelocityBlocks:
        """Groups of columns side by side."""
        return cls(*(torch.cat([getattr(p, n) for p in parts], dim=1) for n in vars(parts[0])))


class VelocityBlockSums:
    """Running sums of one group of columns."""

    def __init__(
        self,
        blocks: Blocks,
        frequency: Tensor,
        sampling_rate: float,
        width: int,
        device: torch.device,
    ) -> None:
        """Frequency in Hz, (F,); ``width`` columns."""
        self.blocks, self.frequency, self.sampling_rate = blocks, frequency, sampling_rate
        # v, v e^{-j omega t} (real, imaginary), v^2; the last row is for samples of no block.
        shape = (blocks.count + 1, 2 + 2 * len(frequency), width)
        self.sums = torch.zeros(shape, dtype=torch.float64, device=device)

    def add(self, begin: int, slab: Tensor) -> None:
        """Samples from ``begin`` on, (t, P), of any number of blocks."""
        numbers = self.blocks.number(begin, begin + len(slab))
        turning = waves(self.frequency, self.sampling_rate, begin, begin + len(slab))
        rows = torch.cat([torch.ones(1, len(slab)), turning.real, turning.imag])
        rows = rows.to(slab.device, slab.dtype)
        for number in numbers.unique().tolist():
            own = (numbers == number).nonzero()[:, 0]
            low, high = int(own[0]), int(own[-1]) + 1
            piece, weights, sums = slab[low:high], rows[:, low:high], self.sums[number]
            elements = block_elements(slab.device)
            for part, columns in cache_blocks(len(piece), piece.shape[1], elements):
                block = piece[part, columns]
                sums[:-1, columns] += weighted_sums(weights[:, part], block)
                sums[-1, columns] += (block * block).sum(0, dtype=torch.float64)

    def result(self) -> VelocityBlocks:
        """The means."""
        lengths = self.blocks.lengths.to(self.sums.device)[:, None, None]
        means = self.sums[:-1] / lengths
        line = torch.complex(*means[:, 1:-1].chunk(2, dim=1))
        return VelocityBlocks(means[:, 0], means[:, -1], line.movedim(1, 2))
