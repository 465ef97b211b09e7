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
from torchliner.signals.bootstrap import (
    beyond_runs,
    mean_factor,
    neighbour_correlation,
    replicate_covariance,
    run_lengths,
    student_quantile,
    tile_moments,
)

COLUMNS = 8192  # of probes and frequencies, at most, whose block deviations are held at once
ANGLES = 32  # on the ellipse; with a parabola through the best three 1e-4 of half a width, and 1e-2
# where the ellipse comes half as near to the pole as its centre


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
    """

    power: Tensor
    square: Tensor
    runs: Tensor


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
        shape, count = series.shape[1:], len(series)
        # In real parts, (2, S, N), whose sums over blocks are several times as fast.
        parts = torch.stack([series.real.flatten(1), series.imag.flatten(1)])
        rho = neighbour_correlation(parts)
        lengths = run_lengths(rho, count)
        sums = parts.new_empty(3, len(rho))
        for length in lengths.unique().tolist():
            mine = (lengths == length).nonzero()[:, 0]
            if length not in self.covariances:
                covariance = replicate_covariance(self.weights, length)
                self.covariances[length] = covariance * mean_factor(count, length)
            own = parts.index_select(2, mine)
            turned = self.covariances[length].to(own) @ own
            cross = own[0] * turned[1]
            sums[:, mine] = torch.stack([*(own.mul_(turned)).sum(1), cross.sum(0)])
        power, square = sums[0] + sums[1], torch.complex(sums[0] - sums[1], 2 * sums[2])
        beyond = beyond_runs(rho, lengths)
        runs = count / lengths.to(torch.float64)
        return Scatter(*(
            each.reshape(shape) for each in (power * beyond, square * beyond, runs)
        ))  # fmt: skip

    def second_moment(self, series: Tensor) -> Tensor:
        """E of the square of the mean's deviation, not of its modulus; see ``scatter``."""
        return self.scatter(series).square

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

    def over_tiles(self, series: Tensor, reflection: Tensor, wide: int) -> Interval:
        """Tiles of time and of rows that are alike.

        What all rows share, however far apart, tiles would miss: where blocks of time alone scatter
        more, the tiles' scatter is raised to that, which rests on the runs of time alone. (With
        runs that fall as smoothly as the scatter rises, rows that share a third of their energy
        are covered by 88 %.)

        Args:
            series: deviation of R in each block and row, complex128, (S, G, F).
            reflection: R of the mean over the rows, (F,).  wide: rows of a tile.
        """
        count, rows = series.shape[:2]
        rho = neighbour_correlation(series.mean(1))
        long = int(run_lengths(rho, count).max())
        power, square = tile_moments(series, self.weights, (long, wide))
        together, _ = tile_moments(series.mean(1, keepdim=True), self.weights, (long, 1))
        factor = (together / power.clamp(min=1e-300)).clamp(min=1)
        runs = count / long * torch.where(factor > 1, 1.0, rows / wide)
        factor = factor * mean_factor(count, long) * beyond_runs(rho, torch.full_like(rho, long))
        return impedance_interval(
            reflection, power * factor, square * factor, runs, self.level, self.conversion
        )


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
    real, imaginary = _changes(axes * slope, share)
    inside = (pole.real * short) ** 2 + (pole.imag * long) ** 2 < (long * short * quantile) ** 2
    inside |= value == conversion.pole
    z = conversion.impedance(value)
    low, high = (
        torch.complex(*(
            torch.where(inside, sign * math.inf, middle + _peak(part, sign))
            for middle, part in ((z.real, real), (z.imag, imaginary))
        ))
        for sign in (-1, 1)
    )  # fmt: skip
    turned = (slope**2 * square).real
    error = (slope.abs() ** 2 * power + torch.stack([turned, -turned])).clamp(min=0).div(2).sqrt()
    return Interval(low, high, torch.complex(*error), runs, torch.zeros_like(value))


def _changes(ahead: Tensor, share: Tensor) -> tuple[Tensor, Tensor]:
    """Real and imaginary part of n/(1 - u) around ellipses n and u whose half axes, complex,
    (2, N), are given: (N, ANGLES) each. In real parts and in place: here bars spend their time."""
    angle = math.tau / ANGLES * torch.arange(ANGLES, dtype=torch.float64, device=share.device)
    circle = torch.stack([angle.cos(), angle.sin()])
    n_real, n_imaginary, u_real, u_imaginary = (
        each.T.contiguous() @ circle for each in (ahead.real, ahead.imag, share.real, share.imag)
    )
    left = u_real.neg_().add_(1)
    scale = (left * left).addcmul_(u_imaginary, u_imaginary).reciprocal_()
    real = (n_real * left).addcmul_(n_imaginary, u_imaginary, value=-1).mul_(scale)
    return real, n_real.mul_(u_imaginary).addcmul_(n_imaginary, left).mul_(scale)


def _peak(values: Tensor, sign: int) -> Tensor:
    """Largest (sign 1) or least (-1) value of a smooth periodic function at equal steps, (N, A):
    (N,)."""
    top, place = values.max(1) if sign > 0 else values.min(1)
    steps = (place[:, None] + torch.tensor([-1, 1], device=place.device)) % values.shape[1]
    before, after = values.gather(1, steps).unbind(1)
    curve = 2 * top - before - after
    return top + torch.where(sign * curve > 0, (after - before) ** 2 / (8 * curve), 0.0)
