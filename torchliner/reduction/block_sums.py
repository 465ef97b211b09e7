"""Sums of v over one block, which parts of a record may share, and means over all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class BlockSums:
    """Sums of v over the samples ``low`` to ``high`` - 1 of one block.

    Args:
        number: of the block.
        low, high: samples.
        sums: of v times the rows of a pass, (R, P).
        squares: of v, (P,).
    """

    number: int
    low: int
    high: int
    sums: Tensor
    squares: Tensor

    def joined(self, later: BlockSums) -> BlockSums:
        """With what comes next of the same block."""
        return BlockSums(self.number, self.low, later.high, self.sums + later.sums, self.squares + later.squares)


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
