r"""Averages over segments and stations, eqs (5.1) and (5.2), and how far each may be off.

(5.2) draws one segment a station, averages the admittances over the stations and then over the draws. The mean over all
possible draws is the mean over stations of the mean over segments, so that no draw is needed for it; with the variances
:math:`s_n^2` of a station's admittances over its segments the draws scatter by :math:`\sqrt{\sum s_n^2}/N`. This is
neither the spread along the line nor the uncertainty of the result.

For the latter results are computed without each segment of each station in turn (``engine.intervals``). Stations are
measured one after another, so that their variances add, with the degrees of freedom of Welch and Satterthwaite. A mean
over segments is also off because each segment is short and Z is not linear in R: by the mean of Z less Z of the mean R,
right to second order. The bounds are without that bias, which is stated.
"""

from __future__ import annotations

import dataclasses

import torch
from scipy.special import stdtrit
from torch import Tensor

from torchliner.conversions import (
    admittance_from_reflection,
    impedance_from_admittance,
    impedance_from_reflection,
    mean_impedance,
)
from torchliner.engine import intervals
from torchliner.engine.intervals import FEWEST_BLOCKS, FROM_REFLECTION, Conversion
from torchliner.records import ImpedanceLine, Interval, LineAverage
from torchliner.records.impedance_line import mean_over_segments

FROM_ADMITTANCE = Conversion(impedance_from_admittance, lambda y: -1 / y**2, 0)
SEED = 0  # of the Monte Carlo
Scatter = tuple[Tensor, Tensor, Tensor]  # E|d|^2 and E[d^2] of deviations d, and the independent runs behind them


def average_line(line: ImpedanceLine, level: float | None, draws: int) -> ImpedanceLine:
    """A line with (5.2) over the stations that count, by ``draws`` of the Monte Carlo, and intervals of a level.

    Raises:
        ValueError: no station counts.
    """
    used, counts, each = line.used, line.segments, segment_admittances(line)
    if not bool(used.any()):
        raise ValueError(
            "no station counts: all are flagged; look at them with 'torchliner ldv info', or take them as they are "
            "with flagged='use'"
        )
    drawn = monte_carlo(each[used], counts[used], draws, SEED)
    admittance = line.over_segments(each)
    average = LineAverage(
        impedance=mean_impedance(admittance[used]),
        monte_carlo=mean_impedance(drawn),
        monte_carlo_spread=_deviation(impedance_from_admittance(drawn)),
        spatial_spread=_deviation(line.impedance[used]),
        interval=None,
        stations=int(used.sum()),
    )
    interval = None
    if level is not None and int(counts[used].min()) >= FEWEST_BLOCKS:
        bias = admittance - admittance_from_reflection(line.over_segments(line.reflection))
        bias = bias if line.wall is None else torch.where(line.wall, 0, bias)
        power, square, runs = scatter(each[used] / average.stations, counts[used])
        # Of what all stations contribute to, as they are independent.
        whole, share = power.sum(0), (power**2 / (runs - 1)).sum(0)
        runs = torch.where(share > 0, 1 + whole**2 / share.clamp(min=1e-300), runs.sum(0))
        found = whole, square.sum(0), runs
        own = interval_of(admittance[used].mean(0), found, level, FROM_ADMITTANCE, bias[used].mean(0))
        average = dataclasses.replace(average, interval=own)
        if int(counts.min()) >= FEWEST_BLOCKS:
            interval = station_intervals(line.reflection, counts, level)
    return dataclasses.replace(line, average=average, interval=interval)


def station_intervals(reflection: Tensor, counts: Tensor, level: float) -> Interval:
    """Of the means of Z over the segments, (5.1), (N, F): bounds of Z at the mean R, and how far (5.1) is off it."""
    mean = mean_over_segments(reflection, counts)
    found = interval_of(mean, scatter(reflection, counts), level, FROM_REFLECTION)
    average = mean_over_segments(impedance_from_reflection(reflection), counts)
    return dataclasses.replace(found, bias=average - impedance_from_reflection(mean))


def segment_admittances(line: ImpedanceLine) -> Tensor:
    """1/Z of the segments, 0 at walls, (N, S, F)."""
    found = admittance_from_reflection(line.reflection)
    return found if line.wall is None else torch.where(line.wall[:, None], 0, found)


def monte_carlo(admittance: Tensor, counts: Tensor, draws: int, seed: int) -> Tensor:
    """Mean over the stations of one drawn segment each: (M, F).

    From admittances (N, S, F), ``counts`` (N,) segments of each station.
    Source: Roncen et al. (2026), eq. (5.2a), before its outer sum.
    """
    generator = torch.Generator().manual_seed(seed)
    uniform = torch.rand(draws, len(admittance), generator=generator, dtype=torch.float64)
    pick = (uniform * counts).to(torch.int64).minimum(counts - 1)
    total = torch.zeros(draws, admittance.shape[2], dtype=admittance.dtype)
    for station, drawn in zip(admittance, pick.T, strict=True):  # one after another, in little memory
        total += station[drawn]
    return total / len(admittance)


def _deviation(values: Tensor) -> Tensor:
    """Of R and of X over the first axis; nan of a single value, which has none."""
    if len(values) == 1:
        return torch.full_like(values[0], torch.nan)
    return torch.complex(values.real.std(0), values.imag.std(0))


def scatter(segments: Tensor, counts: Tensor) -> Scatter:
    """Of the means of (N, S, F) over the ``counts`` (N,) segments of each station, at least 4: (N, F) each."""
    found = []
    for own, count in zip(segments, counts.tolist(), strict=True):
        ones = torch.ones(count, dtype=torch.float64)
        power, square, lengths = intervals.scatter(intervals.replicates(own[:count], ones)[1 : 1 + count], ones / count)
        found.append((power, square, count / lengths.double()))
    power, square, runs = (torch.stack(parts) for parts in zip(*found, strict=True))
    return power, square, runs


def interval_of(
    value: Tensor, found: Scatter, level: float, conversion: Conversion, bias: Tensor | None = None
) -> Interval:
    """Interval of Z from the scatter of what it is made of, a value (...), and how far that is off in the mean."""
    power, square, runs = found
    quantile = torch.from_numpy(stdtrit((runs - 1).clamp(min=1).numpy(), 0.5 + level / 2))
    parts = value, 0 * value if bias is None else bias, power, square, quantile, runs
    flat = intervals.impedance_interval(*(part.flatten() for part in parts), conversion)
    return flat.map(lambda each: each.reshape(value.shape))
