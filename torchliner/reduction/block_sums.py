"""Sums of v over one block, which parts of a record may share."""

from __future__ import annotations

from dataclasses import dataclass

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
        return BlockSums(
            self.number, self.low, later.high, self.sums + later.sums, self.squares + later.squares
        )
