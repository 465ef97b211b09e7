"""Intervals of Z from the deviation of R, block by block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from torchliner.conversions import impedance_from_reflection
from torchliner.records import Interval
from torchliner.signals.bootstrap import (
    deviations,
    mean_factor,
    run_lengths,
    student_factor,
    tails,
    tile_draws,
)

COLUMNS = 4096  # of probes and frequencies, at most, whose block deviations are held at once
DRAWN = 1 << 22  # draws times columns at once


@dataclass(frozen=True)
class Resampling:
    """What all intervals of a map have in common.

    Args:
        weights: of the blocks in the window, float64, (S,), of sum 1.
        level: of the intervals, 0 to 1.
        draws: M.
        seed: of the generator.
        dtype: complex, of the draws of single probes: they are many, and their bounds are known
            to some per cent.
        convert: impedance from the quantity that is resampled, the reflection unless stated; all
            docstrings below call it R.
        matrices: by length of a run, filled as they are needed.
    """

    weights: Tensor
    level: float
    draws: int
    seed: int
    dtype: torch.dtype = torch.complex128
    convert: Callable[[Tensor], Tensor] = impedance_from_reflection
    matrices: dict[int, Tensor] = field(default_factory=dict, repr=False)

    def matrix(self, length: int) -> Tensor:
        """``deviations`` for runs of ``length`` blocks, made once for all probes."""
        if length not in self.matrices:
            self.matrices[length] = deviations(self.weights, length, self.draws, self.seed)
        return self.matrices[length]

    def over_time(self, series: Tensor, reflection: Tensor) -> Interval:
        """Runs of blocks of time, each column with the run length that suits it.

        Args:
            series: deviation of R in each block, complex, (S, ...).
            reflection: R, (...).
        """
        flat, middle = series.flatten(1).to(self.dtype), reflection.flatten().to(self.dtype)
        step = max(1, DRAWN // self.draws)
        parts = [
            self._columns(flat[:, low : low + step], middle[low : low + step])
            for low in range(0, len(middle), step)
        ]
        low, high, error, runs = (
            torch.cat(each).reshape(reflection.shape) for each in zip(*parts, strict=True)
        )
        exact = reflection.dtype
        return Interval(
            low.to(exact), high.to(exact), error.to(exact), runs, torch.zeros_like(reflection)
        )

    def _columns(self, series: Tensor, reflection: Tensor) -> tuple[Tensor, ...]:
        lengths, count = run_lengths(series), len(series)
        low, high, error = (torch.empty_like(reflection) for _ in range(3))
        for length in lengths.unique().tolist():
            mine = lengths == length
            draws = (self.matrix(length).to(series) @ series[:, mine]).T
            draws = draws * mean_factor(count, length)
            low[mine], high[mine], error[mine] = self._bounds(
                draws, reflection[mine], count / length
            )
        return low, high, error, count / lengths.to(torch.float64)

    def over_tiles(self, series: Tensor, reflection: Tensor, wide: int) -> Interval:
        """Tiles of time and of rows that are alike.

        What all rows share, however far apart, tiles would miss: where blocks of time alone scatter
        more, the tiles' draws are widened to that.

        Args:
            series: deviation of R in each block and row, (S, G, F).
            reflection: R of the mean over the rows, (F,).
            wide: rows of a tile.
        """
        count, rows = series.shape[:2]
        long = int(run_lengths(series.mean(1)).max())
        draws = tile_draws(series, self.weights.to(series.device), (long, wide), self.draws,
                           self.seed)  # fmt: skip
        runs = count / long * (rows / wide)
        together = (self.matrix(long).to(series) @ series.mean(1)).abs().square().mean(0)
        alone = draws.abs().square().mean(0).clamp(min=1e-300)
        draws = draws * (together / alone).clamp(min=1).sqrt()
        bounds = self._bounds(draws.T * mean_factor(count, long), reflection, runs)
        behind = torch.full(reflection.shape, runs, dtype=torch.float64, device=reflection.device)
        low, high, error = bounds
        return Interval(low, high, error, behind, torch.zeros_like(reflection))

    def _bounds(self, draws: Tensor, reflection: Tensor, runs: float) -> tuple[Tensor, ...]:
        return impedance_bounds(draws, reflection, runs, self.level, self.convert)

    def second_moment(self, series: Tensor) -> Tensor:
        """E of the square of the mean's deviation, not of its modulus: complex, (...).

        Args:
            series: deviation of each block, complex, (S, ...).
        """
        flat = series.flatten(1)
        lengths, count = run_lengths(flat), len(flat)
        found = torch.empty_like(flat[0])
        for length in lengths.unique().tolist():
            mine = lengths == length
            matrix = self.matrix(length)
            covariance = (matrix.T @ matrix / self.draws * mean_factor(count, length) ** 2).to(flat)
            found[mine] = (flat[:, mine] * (covariance @ flat[:, mine])).sum(0)
        return found.reshape(series.shape[1:])


def impedance_bounds(
    draws: Tensor, value: Tensor, runs: float, level: float, convert: Callable[[Tensor], Tensor]
) -> tuple[Tensor, Tensor, Tensor]:
    """Both ends of the interval of Z and its standard error, (N,) each.

    Args:
        draws: deviations of the resampled quantity, complex, (N, M).
        value: the quantity itself, (N,).
        runs: independent runs that the draws rest on.
        level: of the interval, 0 to 1.
        convert: impedance from the quantity.
    """
    student = student_factor(runs, level)
    impedance = convert(value[:, None] + student * draws)
    found = []
    for part in (impedance.real, impedance.imag):
        low, high = tails(part, level)
        found.append((low, high, part.std(dim=1) / student))
    low, high, error = (torch.complex(*pair) for pair in zip(*found, strict=True))
    return low, high, error
