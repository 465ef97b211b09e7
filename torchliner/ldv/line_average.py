r"""Averages over segments and stations, eqs (5.1) and (5.2), and how far each may be off.

(5.2) draws one segment a station, averages the admittances over the stations and then over the
draws. The mean over all possible draws is the mean over stations of the mean over segments, so that
no draw is needed for it; with the variances :math:`s_n^2` of a station's admittances over its
segments the draws scatter by :math:`\sqrt{\sum s_n^2}/N`. This is neither the spread along the line
nor the uncertainty of the result. For the latter the segments of each station are resampled by the
moving-block bootstrap of ``signals.bootstrap``: runs of two segments or more allow for what
overlapping segments share. Stations are measured one after another, so their variances add.
"""

from __future__ import annotations

import dataclasses

import torch
from torch import Tensor

from torchliner.conversions import (
    admittance_from_reflection,
    impedance_from_admittance,
    impedance_from_reflection,
    mean_impedance,
)
from torchliner.records import ImpedanceLine, Interval, LineAverage
from torchliner.records.impedance_line import mean_over_segments
from torchliner.signals.bootstrap import can_resample
from torchliner.signals.resampling import FROM_ADMITTANCE, ITSELF, Resampling, impedance_interval
from torchliner.velocity.choices import Choices

SEED = 0  # of the Monte Carlo
DRAWN = 1 << 22  # complex values of the Monte Carlo at once, 64 MB


def station_interval(reflection: Tensor, choices: Choices) -> Interval | None:
    """Of the mean of Z over the segments, (F,), from their R, (S, F); None where they are too few.

    The ``bias`` is what the mean is off because Z is not linear in R and each segment is short: the
    mean of Z less Z of the mean R, right to second order.
    """
    count = len(reflection)
    if choices.interval is None or not can_resample(count):
        return None
    values = impedance_from_reflection(reflection)
    middle = values.mean(0)
    bias = middle - impedance_from_reflection(reflection.mean(0))
    resampling = Resampling(_equal_weights(count), choices.interval, ITSELF)
    found = resampling.over_time(values - middle, middle - bias)
    return dataclasses.replace(found, bias=bias)


def average_line(line: ImpedanceLine, choices: Choices, draws: int) -> LineAverage:
    """(5.2) over the stations that count, by ``draws`` of the Monte Carlo, the paper's 5000.

    Raises:
        ValueError: no station counts.
    """
    if not bool(line.used.any()):
        raise ValueError(
            "no station counts: all are flagged; look at them with 'torchliner ldv info', or take "
            "them as they are with flagged='use'"
        )
    admittance, counts = segment_admittances(line), line.segments[line.used]
    mean = mean_over_segments(admittance, counts)
    drawn = monte_carlo(admittance, counts, draws, SEED)
    impedance = line.impedance[line.used]
    several = len(impedance) > 1  # one station has no spread
    return LineAverage(
        impedance=mean_impedance(mean),
        monte_carlo=mean_impedance(drawn),
        monte_carlo_spread=_deviation(impedance_from_admittance(drawn)),
        spatial_spread=_deviation(impedance) if several else torch.full_like(drawn[0], torch.nan),
        interval=_line_interval(line, admittance, counts, choices),
        stations=len(impedance),
    )


def segment_admittances(line: ImpedanceLine) -> Tensor:
    """1/Z of the segments of the stations that count, 0 at walls, (N, S, F)."""
    found = admittance_from_reflection(line.reflection[line.used])
    if line.wall is None:
        return found
    return torch.where(line.wall[line.used][:, None], 0, found)


def monte_carlo(admittance: Tensor, counts: Tensor, draws: int, seed: int) -> Tensor:
    """Mean over the stations of one drawn segment each: (M, F), batched over the draws.

    From admittances (N, S, F), ``counts`` (N,) segments of each station.
    Source: Roncen et al. (2026), eq. (5.2a), before its outer sum.
    """
    stations, _, lines = admittance.shape
    generator = torch.Generator().manual_seed(seed)
    uniform = torch.rand(draws, stations, generator=generator, dtype=torch.float64)
    pick = (uniform * counts).to(torch.int64).minimum(counts - 1)
    place = torch.arange(stations)
    step = max(1, DRAWN // (stations * lines))
    return torch.cat([admittance[place, part].mean(1) for part in pick.split(step)])


def _deviation(values: Tensor) -> Tensor:
    return torch.complex(values.real.std(0), values.imag.std(0))


def _line_interval(line: ImpedanceLine, admittance: Tensor, counts: Tensor, choices: Choices) -> Interval | None:
    """Variances of the stations, added; their degrees of freedom by Welch and Satterthwaite."""
    if choices.interval is None or not can_resample(int(counts.min())):
        return None
    power = torch.zeros(admittance.shape[2], dtype=torch.float64)
    square, share = torch.zeros_like(admittance[0, 0]), torch.zeros_like(power)
    for station, count in zip(admittance, counts.tolist(), strict=True):
        how = Resampling(_equal_weights(count), choices.interval)
        own = how.scatter(station[:count] - station[:count].mean(0))
        power += own.power / len(counts) ** 2
        square += own.square / len(counts) ** 2
        share += (own.power / len(counts) ** 2) ** 2 / (own.runs - 1)
    runs = torch.where(share > 0, 1 + power**2 / share.clamp(min=1e-300), counts.sum() / 2)
    mean = mean_over_segments(admittance, counts)
    bias = mean - admittance_from_reflection(mean_over_segments(line.reflection[line.used], counts))
    if line.wall is not None:
        bias = torch.where(line.wall[line.used], 0, bias)
    value, off = mean.mean(0), bias.mean(0)
    found = impedance_interval(value - off, power, square, runs, choices.interval, FROM_ADMITTANCE)
    moved = impedance_from_admittance(value) - impedance_from_admittance(value - off)
    return dataclasses.replace(found, bias=moved)


def _equal_weights(count: int) -> Tensor:
    return torch.full((count,), 1 / count, dtype=torch.float64)
