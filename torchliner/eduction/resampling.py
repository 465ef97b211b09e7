"""Intervals of Z from the deviation of a mean, block by block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.records import Interval
from torchliner.signals.bootstrap import (
    common_run_length,
    deviations,
    mean_factor,
    run_lengths,
    student_factor,
    tile_draws,
)

COLUMNS = 4096  # whose draws are held at once

ToImpedance = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Resampling:
    """What all intervals of a map have in common.

    Args:
        weights: of the blocks in the window, float64, (S,), of sum 1.
        level: of the intervals, 0 to 1.
        draws: M.
        seed: of the generator.
    """

    weights: Tensor
    level: float
    draws: int
    seed: int

    def over_time(self, series: Tensor, centre: Tensor, to_impedance: ToImpedance) -> Interval:
        """Runs of blocks of time, each column with the run length that suits it.

        Args:
            series: deviation of each block, complex, (S, ...).
            centre: what deviates, (...).
            to_impedance: from it to Z.
        """
        flat, middle = series.flatten(1), centre.flatten()
        parts = [
            self._columns(flat[:, low : low + COLUMNS], middle[low : low + COLUMNS], to_impedance)
            for low in range(0, len(middle), COLUMNS)
        ]
        joined = [torch.cat(each).reshape(centre.shape) for each in zip(*parts, strict=True)]
        return Interval(*joined)

    def _columns(
        self, series: Tensor, centre: Tensor, to_impedance: ToImpedance
    ) -> tuple[Tensor, ...]:
        lengths = run_lengths(series)
        low, high, error = (torch.empty_like(centre) for _ in range(3))
        count = len(series)
        for length in lengths.unique().tolist():
            mine = lengths == length
            matrix = deviations(self.weights, length, self.draws, self.seed)
            draws = (matrix.to(series) @ series[:, mine]).T * mean_factor(count, length)
            low[mine], high[mine], error[mine] = self._bounds(
                draws, centre[mine], to_impedance, count / length
            )
        return low, high, error, count / lengths.to(torch.float64)

    def over_tiles(
        self, series: Tensor, centre: Tensor, to_impedance: ToImpedance, *, independent: bool
    ) -> Interval:
        """Tiles of time and of rows that are alike.

        Args:
            series: deviation of each block and row, (S, G, F).
            centre: what deviates, (F,).
            to_impedance: from it to Z.
            independent: the rows are independent, so that a tile is one row wide.
        """
        count, rows = series.shape[:2]
        long = int(run_lengths(series.mean(1)).max())
        wide = 1 if independent else common_run_length(series.movedim(1, 0))
        draws = tile_draws(series, self.weights.to(series.device), (long, wide), self.draws,
                           self.seed)  # fmt: skip
        runs = count / long * (rows / wide)
        bounds = self._bounds(draws.T * mean_factor(count, long), centre, to_impedance, runs)
        return Interval(*bounds, torch.full(centre.shape, runs, dtype=torch.float64))

    def _bounds(
        self, draws: Tensor, centre: Tensor, to_impedance: ToImpedance, runs: float
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Quantiles of Z of widened draws, (N, M), and its standard error: (N,) each."""
        student = student_factor(runs, self.level)
        values = to_impedance(centre[:, None] + student * draws)
        place = (1 - self.level) / 2 * (self.draws - 1)
        below, share = int(place), place - int(place)
        above = self.draws - 1 - below
        found = []
        for part in (values.real, values.imag):
            ordered = part.sort(dim=1).values
            low = (1 - share) * ordered[:, below] + share * ordered[:, below + 1]
            high = (1 - share) * ordered[:, above] + share * ordered[:, above - 1]
            found.append((low, high, part.std(dim=1) / student))
        low, high, error = (torch.complex(*pair) for pair in zip(*found, strict=True))
        return low, high, error
