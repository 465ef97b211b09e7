"""Running moments of |v| of one group of columns: over the record, and over its blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchliner.reduction.basis import STENCIL, Basis, Chebyshev, Levels
from torchliner.reduction.eager import Speeds, rounded
from torchliner.reduction.plan import PassPlan
from torchliner.reduction.sources import Columns
from torchliner.reduction.sums import add, zeros

LEVEL_ELEMENTS = 1 << 16  # velocities whose levels are looked up at once


@dataclass(frozen=True, eq=False)
class GroupMoments:
    """Of the columns of one group.

    Args:
        totals: over the weighed samples, with weight 1 and each row of the plan, float64,
            (R, K, P): exact sums of what each piece gave, in any order of the pieces.
        of_blocks: over each block and the rest, (S + 1, R, K, P) in the data's precision; None
            where they are not kept.
    """

    totals: Tensor
    of_blocks: Tensor | None

    def part(self, columns: slice) -> GroupMoments:
        """Of some columns, views."""
        blocks = None if self.of_blocks is None else self.of_blocks[..., columns]
        return GroupMoments(self.totals[..., columns], blocks)


class SpeedSums:
    """Running sums of one group.

    Args:
        plan: pieces, blocks and rows.
        basis: functions of |v|.
        width: P.
        keeps_blocks: whether sums over blocks are kept.
        numbers: of the blocks that the samples of a part reach; default all, and the rest.
    """

    def __init__(
        self, plan: PassPlan, basis: Basis, width: int, dtype: torch.dtype,
        device: torch.device, keeps_blocks: bool, numbers: range | None = None,
    ) -> None:  # fmt: skip
        self.numbers = range(plan.rest + 1) if numbers is None else numbers
        self.plan, self.basis, self.width, self.dtype = plan, basis, width, dtype
        shape = (1 + 2 * len(plan.lines), basis.count, width)
        self.totals = zeros(shape, torch.float64, device)
        self.of_blocks = None
        if keeps_blocks:
            blocks = (len(self.numbers), *shape)
            self.of_blocks = zeros(blocks, dtype, device)

    def add(self, begin: int, columns: Columns) -> None:
        """Samples from ``begin`` on."""
        add(columns.velocity, (), self.asked(begin, columns), columns.taken)

    def asked(self, begin: int, columns: Columns) -> Speeds | None:
        """What is to be summed of samples from ``begin`` on; levels of tables are summed here."""
        end, first = begin + len(columns.velocity), self.numbers.start
        pieces = self.plan.pieces(begin, end) - (0, 0, first)
        rows = self.plan.rows(begin, end)
        rows = None if rows is None else rows.to(columns.velocity.device, self.dtype)
        if not isinstance(self.basis, Chebyshev):
            if len(pieces):
                add_levels(columns, pieces, self.basis, rows, self.totals, self.of_blocks)
            return None
        return Speeds(pieces, self.basis.count, self.basis.centre, self.totals, self.of_blocks, rows)

    def follow(self, other: SpeedSums) -> None:
        """Add a part; totals are exact in any order, blocks that parts share to rounding."""
        self.totals += other.totals
        if self.of_blocks is not None and other.of_blocks is not None:
            first = other.numbers.start - self.numbers.start
            self.of_blocks[first : first + len(other.numbers)] += other.of_blocks

    def result(self) -> GroupMoments:
        """After the last sample."""
        return GroupMoments(self.totals, self.of_blocks)


def add_levels(
    columns: Columns,
    pieces: np.ndarray,
    basis: Levels,
    rows: Tensor | None,
    totals: Tensor,
    of_blocks: Tensor | None,
) -> None:
    """As ``eager.Speeds`` says, for the levels of a table."""
    width, count = columns.velocity.shape[1], basis.count
    wide = max(1, min(width, LEVEL_ELEMENTS // (pieces[:, 1] - pieces[:, 0]).max()))
    for low, high, block in pieces.tolist():
        weights = [None] if rows is None else [None, *rows[:, low:high]]
        for left in range(0, width, wide):
            part = slice(left, min(left + wide, width))
            index, shares = basis.locate(columns.part(slice(low, high), part).speed)
            index = index.clamp(0, count - STENCIL)
            for row, weight in enumerate(weights):
                sums = torch.zeros(count, index.shape[1]).to(shares)
                for step, share in enumerate(shares):
                    value = share if weight is None else share * weight[:, None]
                    sums.scatter_add_(0, index + step, value)
                totals[row, :, part] += rounded(sums.to(torch.float64))
                if of_blocks is not None:
                    of_blocks[block, row, :, part] += sums


def constant_moments(plan: PassPlan, basis: Basis, speed: Tensor) -> GroupMoments:
    """Of columns whose |v|, (P,), never changes; no sums over blocks."""
    # Contiguous as the sums of samples are, so that a product adds in the same order.
    functions = basis.functions(speed.cpu()).T.contiguous().to(speed.device)
    sums = plan.wave_sums(torch.tensor(plan.lines, dtype=torch.float64)).to(speed.device)
    weights = torch.cat([sums.real.new_full((1,), plan.end - plan.begin), sums.real, -sums.imag])
    return GroupMoments(weights[:, None, None] * functions, None)
