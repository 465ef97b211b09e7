"""A record cut into blocks of whole periods: the units that error bars are resampled in."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

MOST_BLOCKS = 32  # twice as many would sharpen an interval by 5 %, and double every probe's memory
SLACK = 0.05  # of a period: a record of 15.96 periods counts as 16


@dataclass(frozen=True)
class Blocks:
    """S blocks of consecutive samples.

    Args:
        borders: first sample of each block, and the end of the last one, (S + 1,).
        periods: of the reference tone in each block.
    """

    borders: tuple[int, ...]
    periods: int

    @property
    def count(self) -> int:
        """S."""
        return len(self.borders) - 1

    @property
    def lengths(self) -> Tensor:
        """Samples of each block, float64, (S,)."""
        return torch.tensor(self.borders, dtype=torch.float64).diff()

    def sums(self, values: Tensor) -> Tensor:
        """Sum of each block of a signal (n,): (S,)."""
        return torch.stack([values[begin:end].sum() for begin, end in pairwise(self.borders)])


def plan_blocks(samples: int, start: int, period: float, most: int = MOST_BLOCKS) -> Blocks:
    """Blocks of whole periods, as short as ``most`` of them allow.

    Whole periods, because what a tone leaves in every period alike is no fluctuation. What is left
    of the record after the last whole block belongs to none.

    Args:
        samples: n of the record.  start: first sample under the window.
        period: of the reference tone, samples.  most: blocks.
    """
    periods = int((samples - start) / period + SLACK)
    each = max(1, -(-periods // most))
    count = periods // each
    borders = [min(samples, start + round(i * each * period)) for i in range(count + 1)]
    return Blocks(tuple(borders), each)
