r"""Averages over segments and stations, eqs (5.1) and (5.2), and how far each may be off.

(5.2) draws one segment a station, averages the admittances over the stations and then over the draws. The mean over all
possible draws is the mean over stations of the mean over segments, so that no draw is needed for it; with the variances
:math:`s_n^2` of a station's admittances over its segments the draws scatter by :math:`\sqrt{\sum s_n^2}/N`. This is
neither the spread along the line nor the uncertainty of the result.

For the latter runs of segments are left out (``engine.intervals``): two or more, as neighbours share half of their
samples. Stations are measured one after another, so their variances add, with the degrees of freedom of Welch and
Satterthwaite. A mean over segments is also off because each segment is short and Z is not linear in R: by the mean of Z
less Z of the mean R, right to second order.
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
from torchliner.engine.intervals import FEWEST_BLOCKS, Conversion, impedance_interval, jackknife, replicates, scatter
from torchliner.records import ImpedanceLine, Interval, LineAverage
from torchliner.records.impedance_line import mean_over_segments

FROM_ADMITTANCE = Conversion(impedance_from_admittance, lambda y: -1 / y**2, 0)
SEED = 0  # of the Monte Carlo


def station_interval(reflection: Tensor, level: float | None) -> Interval | None:
    """Of the mean of Z over the segments, (F,), from their R, (S, F); None where they are too few, or without a level.

    The bounds are those of Z at the mean R; ``bias`` is how far the mean of Z is off it.
    """
    count = len(reflection)
    if level is None or count < FEWEST_BLOCKS:
        return None
    ones = torch.ones(count, dtype=torch.float64)
    found = jackknife(replicates(reflection, ones), ones / count, level)
    mean = impedance_from_reflection(reflection).mean(0)
    return dataclasses.replace(found, bias=mean - impedance_from_reflection(reflection.mean(0)))


def average_line(line: ImpedanceLine, level: float | None, draws: int) -> LineAverage:
    """(5.2) over the stations that count, by ``draws`` of the Monte Carlo, with an interval of a level.

    Raises:
        ValueError: no station counts.
    """
    used = line.used
    if not bool(used.any()):
        raise ValueError(
            "no station counts: all are flagged; look at them with 'torchliner ldv info', or take them as they are "
            "with flagged='use'"
        )
    admittance, counts = segment_admittances(line), line.segments[used]
    drawn = monte_carlo(admittance, counts, draws, SEED)
    impedance = line.impedance[used]
    return LineAverage(
        impedance=mean_impedance(mean_over_segments(admittance, counts)),
        monte_carlo=mean_impedance(drawn),
        monte_carlo_spread=_deviation(impedance_from_admittance(drawn)),
        spatial_spread=_deviation(impedance),
        interval=_line_interval(line, admittance, counts, level),
        stations=len(impedance),
    )


def segment_admittances(line: ImpedanceLine) -> Tensor:
    """1/Z of the segments of the stations that count, 0 at walls, (N, S, F)."""
    found = admittance_from_reflection(line.reflection[line.used])
    return found if line.wall is None else torch.where(line.wall[line.used][:, None], 0, found)


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


def _line_interval(line: ImpedanceLine, admittance: Tensor, counts: Tensor, level: float | None) -> Interval | None:
    """Of 1/mean(1/Z), from the scatter of the admittances over the segments of each station."""
    if level is None or int(counts.min()) < FEWEST_BLOCKS:
        return None
    found = []
    for station, count in zip(admittance, counts.tolist(), strict=True):
        ones = torch.ones(count, dtype=torch.float64)
        found.append(scatter(replicates(station[:count], ones)[1 : 1 + count], ones / count))
    power, square, lengths = (torch.stack(each) for each in zip(*found, strict=True))
    power, square, own = power / len(counts) ** 2, square / len(counts) ** 2, counts[:, None] / lengths
    whole, share = power.sum(0), (power**2 / (own - 1)).sum(0)
    runs = torch.where(share > 0, 1 + whole**2 / share.clamp(min=1e-300), own.sum(0))
    quantile = torch.from_numpy(stdtrit((runs - 1).clamp(min=1).numpy(), 0.5 + level / 2))
    mean = mean_over_segments(admittance, counts)
    bias = mean - admittance_from_reflection(mean_over_segments(line.reflection[line.used], counts))
    if line.wall is not None:
        bias = torch.where(line.wall[line.used], 0, bias)
    return impedance_interval(mean.mean(0), bias.mean(0), whole, square.sum(0), quantile, runs, FROM_ADMITTANCE)
