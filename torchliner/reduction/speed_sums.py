"""Running moments of |v| of one group of columns: over the record, and over its blocks."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.reduction.basis import STENCIL, Basis, Chebyshev, Levels
from torchliner.reduction.eager import rounded
from torchliner.reduction.plan import PassPlan, Piece, wave_rows
from torchliner.reduction.sources import Columns, Taken
from torchliner.reduction.sums import NARROW, add_moments, by_length

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
        self.totals = torch.zeros(shape, dtype=torch.float64, device=device)
        self.of_blocks = None
        if keeps_blocks:
            blocks = (len(self.numbers), *shape)
            self.of_blocks = torch.zeros(blocks, dtype=dtype, device=device)

    def add(self, begin: int, columns: Columns) -> None:
        """Samples from ``begin`` on."""
        first = self.numbers.start
        pieces = [
            (low, high, block - first)
            for low, high, block in self.plan.pieces(
                begin, begin + len(columns.velocity), weighed=True
            )
        ]
        if not pieces:
            return
        if self.width < NARROW and isinstance(self.basis, Chebyshev) and len(pieces) > 1:
            self._add_folded(begin, columns.speed, pieces)
            return
        rows = self.plan.rows(begin, begin + len(columns.velocity))
        rows = None if rows is None else rows.to(columns.velocity.device, self.dtype)
        self._add(columns.velocity, pieces, rows, columns.taken, self.totals, self.of_blocks)

    def _add(
        self, slab: Tensor, pieces: list[Piece], rows: Tensor | None, taken: Taken | None,
        totals: Tensor, of_blocks: Tensor | None,
    ) -> None:  # fmt: skip
        if isinstance(self.basis, Chebyshev):
            add_moments(
                slab, pieces, self.basis.count, self.basis.centre, rows, taken, totals, of_blocks
            )
        elif isinstance(self.basis, Levels):
            speed = Columns(slab, taken)
            add_levels(speed, pieces, self.basis, rows, totals, of_blocks)

    def _add_folded(self, begin: int, speed: Tensor, pieces: list[Piece]) -> None:
        """Pieces of equal length side by side, as if they were so many columns.

        Waves start anew in each piece and are turned afterwards.
        """
        lines, rate = self.plan.lines, self.plan.sampling_rate
        for length, same in by_length(pieces).items():
            first = torch.tensor([low for low, _, _ in same])
            wide = speed[torch.arange(length)[:, None] + first].flatten(1)
            rows = wave_rows(lines, rate, 0, length).to(speed) if lines else None
            shape = (len(self.totals), self.basis.count, wide.shape[1])
            whole = torch.zeros(shape, dtype=torch.float64, device=speed.device)
            parts = torch.zeros((1, *shape), dtype=self.dtype, device=speed.device)
            self._add(wide, [(0, length, 0)], rows, None, whole, parts)
            starts = torch.tensor([begin + low for low, _, _ in same], dtype=torch.float64)
            whole, own = (
                self._turned(values.unflatten(-1, (len(same), self.width)), starts)
                for values in (whole, parts[0])
            )
            # Each piece by itself, or the last bits would tell how many a slab holds.
            self.totals += rounded(whole).sum(2)
            if self.of_blocks is not None:
                blocks = torch.tensor([block for _, _, block in same], device=speed.device)
                self.of_blocks.index_add_(0, blocks, own.movedim(2, 0))

    def _turned(self, values: Tensor, starts: Tensor) -> Tensor:
        """Sums (R, K, n, P) of waves that began at 0, for waves of pieces from ``starts`` on."""
        if not self.plan.lines:
            return values
        count = len(self.plan.lines)
        turn = torch.tensor(self.plan.lines, dtype=torch.float64)
        angle = 2 * torch.pi / self.plan.sampling_rate * torch.outer(turn, starts)
        cosine, sine = (part.to(values)[:, None, :, None] for part in (angle.cos(), angle.sin()))
        c, s = values[1 : 1 + count], values[1 + count :]
        return torch.cat([values[:1], cosine * c - sine * s, sine * c + cosine * s])

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
    pieces: list[Piece],
    basis: Levels,
    rows: Tensor | None,
    totals: Tensor,
    of_blocks: Tensor | None,
) -> None:
    """As ``sums.add_moments``, for the levels of a table."""
    width, count = columns.velocity.shape[1], basis.count
    wide = max(1, min(width, LEVEL_ELEMENTS // max(high - low for low, high, _ in pieces)))
    for low, high, block in pieces:
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
