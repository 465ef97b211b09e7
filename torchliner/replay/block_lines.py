r"""Means of R over blocks of the record, gathered in the same pass as the lines themselves.

The educed reflection is a weighted mean of R(f, |v_k|) over emission times, so that the means of
R(f, |v|) and of R(f, |v|) e^{-2 j omega t} over blocks of whole periods say all that a bootstrap
needs to know of the record. They are plain means: the window comes back as weights of the blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.liners.model import LinerModel
from torchliner.liners.nonlinear import SpeedLaw
from torchliner.records.slabs import SLAB_ROWS
from torchliner.replay.kernels import KernelTable, reflection_at_levels
from torchliner.replay.levels import VelocityGrid
from torchliner.signals.blocks import Blocks


@dataclass(frozen=True)
class BlockLine:
    """One frequency, ready to be summed by blocks.

    Args:
        frequency: Hz.
        sampling_rate: Hz.
        blocks: S of them.
        law: formula of R at the frequency, (1,), or None.
        response: else R at the levels, complex128, (V,).
        backward: whether the second mean is needed.
    """

    frequency: float
    sampling_rate: float
    blocks: Blocks
    law: SpeedLaw | None
    response: Tensor | None
    backward: bool

    @property
    def directions(self) -> int:
        """1, or 2 with the backward mean."""
        return 2 if self.backward else 1

    @property
    def spread(self) -> int:
        """Most blocks that ``SLAB_ROWS`` samples touch."""
        shortest = max(1, int(self.blocks.lengths.min()))
        return min(self.blocks.count, -(-(SLAB_ROWS - 1) // shortest) + 1)

    def turning(self, begin: int, end: int) -> Tensor:
        """1 and e^{-2 j omega t}, complex128, (t, directions)."""
        steps = torch.arange(begin, end, dtype=torch.float64)
        turn = 4 * torch.pi * self.frequency / self.sampling_rate
        waves = [torch.ones_like(steps) + 0j, torch.exp(-1j * turn * steps)]
        return torch.stack(waves[: self.directions], dim=1)

    def weights(self, begin: int, end: int) -> tuple[int, Tensor]:
        """First block of the samples, and their weights in it and the next ones.

        Returns: block number; complex128, (t, spread, directions), 0 but in a sample's own block.
        """
        number = self.blocks.number(begin, end)
        inside = number < self.blocks.count
        first = int(number.min()) if bool(inside.any()) else 0
        place = torch.where(inside, number - first, 0)
        one_hot = torch.nn.functional.one_hot(place, self.spread) * inside[:, None]
        return first, one_hot[..., None] * self.turning(begin, end)[:, None]

    def means(self, sums: Tensor) -> list[Tensor]:
        """From sums of (R - 1)/2 twice (``law``) or of R: (S, directions, P) to (S, P) each."""
        lengths = self.blocks.lengths.to(sums.device)[:, None]
        found = []
        for direction in range(self.directions):
            means = sums[:, direction] / lengths
            if self.law is not None:
                waves = self.turning(0, self.blocks.borders[-1])[:, direction]
                means = means + (self.blocks.sums(waves).to(sums.device)[:, None] / lengths)
            found.append(means)
        return found


def plan_block_lines(
    liner: LinerModel,
    frequency: Sequence[float],
    sampling_rate: float,
    blocks: Blocks,
    grid: VelocityGrid,
    response_of: KernelTable | None = None,
    *,
    backward: bool = True,
) -> list[BlockLine]:
    """What the engine needs for the block means at each frequency (Hz).

    Args:
        liner: with ``speed_law`` it is evaluated in place, else tabulated over ``grid``.
        frequency: Hz, F of them.
        sampling_rate: Hz.
        blocks: S of them.
        grid: velocity levels of the tables.
        response_of: kernels whose response stands for the liner's.
        backward: whether the second mean is needed.
    """
    lines = []
    for value in frequency:
        at = torch.tensor([value], dtype=torch.float64)
        law, response = None, None
        if response_of is not None:
            response = response_of.response(at)[:, 0]
        elif (law := liner.speed_law(at)) is None:
            response = reflection_at_levels(liner, at, grid)[:, 0]
        lines.append(BlockLine(value, sampling_rate, blocks, law, response, backward))
    return lines
