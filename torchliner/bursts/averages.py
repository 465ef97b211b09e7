r"""Averages over segments and stations, eqs (5.1) and (5.2), and how far each may be off.

(5.2) draws one segment a station, averages the admittances over the stations and then over the draws. The mean over all
possible draws is the mean over stations of the mean over segments, so that no draw is needed for it; with the variances
:math:`s_n^2` of a station's admittances over its segments the draws scatter by :math:`\sqrt{\sum s_n^2}/N`.

For intervals results are computed without each segment of each station in turn (``engine.intervals``). Variances of
stations add, with the degrees of freedom of Welch and Satterthwaite. As segments are short and Z is not linear in R, a
mean over them is off by the mean of Z less Z of the mean R, right to second order. The bounds are without that bias.
"""

import dataclasses

import torch
from scipy.special import stdtrit
from torch import Tensor

from torchliner.conversions import admittance_from_reflection, impedance_from_admittance, impedance_from_reflection
from torchliner.engine.intervals import (
    FEWEST_BLOCKS,
    FROM_ADMITTANCE,
    FROM_REFLECTION,
    Conversion,
    impedance_interval,
    replicates,
    scatter,
)
from torchliner.records import ImpedanceLine, Interval, LineAverage
from torchliner.records.impedance_line import mean_over_segments
from torchliner.records.wall_eduction import deviation


def average_line(line: ImpedanceLine, level: float | None, draws: int) -> ImpedanceLine:
    """A line with (5.2) over the stations that count, by ``draws`` of the Monte Carlo, and intervals of a level."""
    used, counts, each = line.used, line.segments, admittance_from_reflection(line.reflection)
    if not bool(used.any()):
        raise ValueError("no station counts: all are flagged ('torchliner ldv info'); flagged='use' takes them")
    drawn, mean = monte_carlo(each[used], counts[used], draws), line.admittance[used].mean(0)
    average = LineAverage(
        impedance=impedance_from_admittance(line.admittance[used].mean(0)),
        monte_carlo=impedance_from_admittance(drawn.mean(0)),
        monte_carlo_spread=deviation(impedance_from_admittance(drawn)),
        spatial_spread=deviation(line.impedance[used]),
        interval=None,
        stations=int(used.sum()),
    )
    if level is None or int(counts.min()) < FEWEST_BLOCKS:
        return dataclasses.replace(line, average=average)
    bias = mean - admittance_from_reflection(mean_over_segments(line.reflection, line.segments))[used].mean(0)
    power, square, runs = scatter_of(each[used] / average.stations, counts[used])
    # Of what all stations contribute to, as they are independent.
    whole, share = power.sum(0), (power**2 / (runs - 1)).sum(0)
    runs = torch.where(share > 0, 1 + whole**2 / share.clamp(min=1e-300), runs.sum(0))
    own = _interval(mean, bias, (whole, square.sum(0), runs), level, FROM_ADMITTANCE)
    stations = station_intervals(line.reflection, counts, level)
    return dataclasses.replace(line, average=dataclasses.replace(average, interval=own), interval=stations)


def station_intervals(reflection: Tensor, counts: Tensor, level: float) -> Interval:
    """Of the means of Z over the segments, (5.1), (N, F): bounds of Z at the mean R, and how far (5.1) is off it."""
    mean = mean_over_segments(reflection, counts)
    found = _interval(mean, torch.zeros_like(mean), scatter_of(reflection, counts), level, FROM_REFLECTION)
    average = mean_over_segments(impedance_from_reflection(reflection), counts)
    return dataclasses.replace(found, bias=average - impedance_from_reflection(mean))


def _interval(value: Tensor, bias: Tensor, found: tuple[Tensor, ...], level: float, conversion: Conversion) -> Interval:
    power, square, runs = found
    quantile = torch.from_numpy(stdtrit((runs - 1).clamp(min=1).numpy(), 0.5 + level / 2))
    return impedance_interval(value, bias, power, square, quantile, runs, conversion)


def scatter_of(segments: Tensor, counts: Tensor) -> tuple[Tensor, ...]:
    """Of the means of (N, S, F) over the ``counts`` (N,) segments of each station: E|d|^2 and E[d^2] of their deviation
    d, and the independent runs behind them, (N, F) each."""
    found = []
    for own, count in zip(segments, counts.tolist(), strict=True):
        ones = torch.ones(count, dtype=torch.float64)
        power, square, lengths = scatter(replicates(own[:count], ones)[1 : 1 + count], ones / count)
        found.append((power, square, count / lengths.double()))
    return tuple(map(torch.stack, zip(*found, strict=True)))


def monte_carlo(admittance: Tensor, counts: Tensor, draws: int, seed: int = 0) -> Tensor:
    """Mean over the stations of one drawn segment each, (M, F), of admittances (N, S, F): Roncen et al. (2026), eq.
    (5.2a), before its outer sum."""
    generator = torch.Generator().manual_seed(seed)
    uniform = torch.rand(draws, len(admittance), generator=generator, dtype=torch.float64)
    pick = (uniform * counts).to(torch.int64).minimum(counts - 1)
    return admittance[torch.arange(len(admittance)), pick].mean(1)
