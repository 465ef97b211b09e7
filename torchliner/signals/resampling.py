r"""Intervals of Z from the deviation of R, block by block.

The replicates of R scatter by :math:`E|d|^2` and :math:`E[d^2]`, an ellipse in the plane of R. The
bounds of the resistance are its least and largest value on the ellipse that is Student's quantile
times as large, and so for the reactance: what the likelihood of R leaves of each by itself, exact
where Z is linear, and as crooked as Z(R) where it is not. Z has a pole (R = 1, a rigid wall); an
ellipse around it says that the record does not bound Z, as Fieller's theorem does for any ratio.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from torchliner.conversions import impedance_from_admittance, impedance_from_reflection
from torchliner.records import Interval
from torchliner.signals.bars import extremes, forms, neighbours
from torchliner.signals.bootstrap import (
    SHORTEST_RUN,
    beyond_runs,
    correlation_of,
    mean_factor,
    replicate_covariance,
    run_lengths,
    student_quantile,
)


@dataclass(frozen=True)
class Conversion:
    """How Z follows from what is resampled.

    Args:
        impedance: Z, a rational function of it of first degree, which so changes with a deviation d
            by slope d/(1 - d/(pole - value)).
        slope: dZ by it, of the same shape.
        pole: where Z is infinite; inf for nowhere.
    """

    impedance: Callable[[Tensor], Tensor]
    slope: Callable[[Tensor], Tensor]
    pole: complex


FROM_REFLECTION = Conversion(impedance_from_reflection, lambda r: 2 / (1 - r) ** 2, 1)
FROM_ADMITTANCE = Conversion(impedance_from_admittance, lambda y: -1 / y**2, 0)
ITSELF = Conversion(lambda z: z, torch.ones_like, math.inf)


@dataclass(frozen=True)
class Scatter:
    """How the replicates of R scatter, (...) each.

    Args:
        power, square: E|d|^2 and E[d^2] of their deviation d, float64 and complex128.
        runs: independent runs of blocks that they rest on.
        short: E[d^2] from the shortest runs alone, without what lies beyond them: for means over
            many columns, which know better what that is than each column by itself.
        pairs: ``neighbours`` of the blocks, (2, ...).
    """

    power: Tensor
    square: Tensor
    runs: Tensor
    short: Tensor
    pairs: Tensor


@dataclass(frozen=True)
class Resampling:
    """What all intervals of a map have in common.

    Args:
        weights: of the blocks in the window, float64, (S,), of sum 1.
        level: of the intervals, 0 to 1.
        conversion: from the quantity that is resampled, the reflection unless stated; all
            docstrings below call it R.
        covariances: by length of a run, filled as they are needed.
    """

    weights: Tensor
    level: float
    conversion: Conversion = FROM_REFLECTION
    covariances: dict[int, Tensor] = field(default_factory=dict, repr=False)

    def scatter(self, series: Tensor) -> Scatter:
        """Of the mean over time, each column with runs of the length that suits it.

        Args:
            series: deviation of R in each block, complex, (S, ...).
        """
        shape, count, series = series.shape[1:], len(series), series.flatten(1)
        pairs = neighbours(series)
        rho = correlation_of(pairs, count)
        lengths = run_lengths(rho, count)
        different, which = lengths.unique(return_inverse=True)
        covariances = torch.stack([self._covariance(count, each) for each in different.tolist()])
        sums = forms(series, covariances.to(rho), which)
        power, square = sums[0] + sums[1], _square(sums)
        short, longer = square, (lengths > SHORTEST_RUN).nonzero()[:, 0]
        if len(longer):
            shortest = self._covariance(count, SHORTEST_RUN)[None].to(rho)
            own = forms(series.index_select(1, longer), shortest, torch.zeros_like(longer))
            short = square.index_copy(0, longer, _square(own))
        beyond = beyond_runs(rho, lengths)
        runs = count / lengths.to(torch.float64)
        return Scatter(
            (power * beyond).reshape(shape), (square * beyond).reshape(shape), runs.reshape(shape),
            short.reshape(shape), pairs.reshape(2, *shape),
        )  # fmt: skip

    def _covariance(self, count: int, length: int) -> Tensor:
        """Of the mean, from runs of this length, float64, (S, S)."""
        if length not in self.covariances:
            covariance = replicate_covariance(self.weights, length)
            self.covariances[length] = covariance * mean_factor(count, length)
        return self.covariances[length]

    def interval(self, scatter: Scatter, reflection: Tensor) -> Interval:
        """Of Z where R, (...), scatters so."""
        found = impedance_interval(
            reflection.flatten(), scatter.power.flatten(), scatter.square.flatten(),
            scatter.runs.flatten(), self.level, self.conversion,
        )  # fmt: skip
        return found.map(lambda value: value.reshape(reflection.shape))

    def over_time(self, series: Tensor, reflection: Tensor) -> Interval:
        """Of Z from deviations of R in each block, (S, ...), and R, complex128, (...)."""
        return self.interval(self.scatter(series), reflection)


def _square(sums: Tensor) -> Tensor:
    """E[d^2] from ``forms``."""
    return torch.complex(sums[0] - sums[1], 2 * sums[2])


def impedance_interval(
    value: Tensor, power: Tensor, square: Tensor, runs: Tensor, level: float, conversion: Conversion
) -> Interval:
    """Bounds of Z and its standard error, (N,); infinite where the record does not bound Z.

    From values (N,), complex128, the E|d|^2 and E[d^2] of their deviation, and the independent
    runs that these rest on.
    """
    quantile = student_quantile(runs, level)
    # d = e^{jt} (long cos a + j short sin a), t half the angle of E[d^2].
    size = square.abs()
    long, short = ((power + sign * size).clamp(min=0).div(2).sqrt() for sign in (1, -1))
    turn = torch.exp(0.5j * square.angle())
    slope, pole = conversion.slope(value), (conversion.pole - value) * turn.conj()
    axes = torch.stack([quantile * long * turn, 1j * quantile * short * turn])
    share = axes / (conversion.pole - value) if math.isfinite(abs(conversion.pole)) else 0 * axes
    changes = extremes(axes * slope, share)  # of the real and the imaginary part: least, largest
    inside = (pole.real * short) ** 2 + (pole.imag * long) ** 2 < (long * short * quantile) ** 2
    inside |= value == conversion.pole
    z = conversion.impedance(value)
    low, high = (
        torch.complex(*(
            torch.where(inside, sign * math.inf, middle + change)
            for middle, change in zip((z.real, z.imag), changes[end::2], strict=True)
        ))
        for end, sign in enumerate((-1, 1))
    )  # fmt: skip
    turned = (slope**2 * square).real
    error = (slope.abs() ** 2 * power + torch.stack([turned, -turned])).clamp(min=0).div(2).sqrt()
    return Interval(low, high, torch.complex(*error), runs, torch.zeros_like(value))
