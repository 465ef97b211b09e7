r"""Averages over segments and stations, eqs (5.1) and (5.2), and how far each may be off.

(5.2) draws one segment a station, averages the admittances over the stations and then over the
draws. The mean over all possible draws is the mean over stations of the mean over segments, so that
no draw is needed for it; with the variances :math:`s_n^2` of a station's admittances over its
segments the draws scatter by :math:`\sqrt{\sum s_n^2}/N`. This is neither the spread along the line
nor the uncertainty of the result. For the latter the segments of each station are resampled by the
moving-block bootstrap of ``signals.bootstrap``: runs of two segments or more allow for what
overlapping segments share. Stations are measured one after another, so their draws are independent.
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
from torchliner.signals.bootstrap import can_resample, deviations, mean_factor, run_lengths
from torchliner.signals.resampling import Resampling
from torchliner.tdibc.choices import Choices

DRAWN = 1 << 22  # complex values of the Monte Carlo at once, 64 MB


def station_interval(reflection: Tensor, chosen: Choices) -> Interval | None:
    """Of the mean of Z over the segments, (F,); None where segments are too few to resample.

    Args:
        reflection: R of the segments, (S, F).
        chosen: level, draws, seed.
    The ``bias`` is what the mean is off because Z is not linear in R and each segment is short: the
    mean of Z less Z of the mean R, right to second order.
    """
    count = len(reflection)
    if chosen.interval is None or not can_resample(count):
        return None
    values = impedance_from_reflection(reflection)
    middle = values.mean(0)
    bias = middle - impedance_from_reflection(reflection.mean(0))
    how = Resampling(
        torch.full((count,), 1 / count, dtype=torch.float64), chosen.interval, chosen.draws,
        chosen.seed, convert=_as_it_is,
    )  # fmt: skip
    found = how.over_time(values - middle, middle - bias)
    return dataclasses.replace(found, bias=bias)


def _as_it_is(values: Tensor) -> Tensor:
    return values


def average_line(line: ImpedanceLine, chosen: Choices, draws: int) -> LineAverage:
    """(5.2) over the stations that count.

    Args:
        line: stations.
        chosen: level, draws and seed of the interval; the seed serves the Monte Carlo too.
        draws: of the Monte Carlo, the paper's 5000.
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
    drawn = monte_carlo(admittance, counts, draws, chosen.seed)
    spread = line.impedance[line.used]
    several = len(spread) > 1
    return LineAverage(
        impedance=mean_impedance(mean),
        monte_carlo=mean_impedance(drawn),
        monte_carlo_spread=_deviation(impedance_from_admittance(drawn)),
        # One station has no spread.
        spatial_spread=_deviation(spread) if several else torch.full_like(spread[0], torch.nan),
        interval=_line_interval(line, admittance, counts, chosen),
        stations=int(line.used.sum()),
    )


def segment_admittances(line: ImpedanceLine) -> Tensor:
    """1/Z of the segments of the stations that count, 0 at walls, (N, S, F)."""
    found = admittance_from_reflection(line.reflection[line.used])
    if line.wall is None:
        return found
    return torch.where(line.wall[line.used][:, None], 0, found)


def monte_carlo(admittance: Tensor, counts: Tensor, draws: int, seed: int) -> Tensor:
    """Mean over the stations of one drawn segment each: (M, F), batched over the draws.

    Args:
        admittance: (N, S, F).
        counts: segments of each station, (N,).
        draws: M.
        seed: of the generator.
    Source: Roncen et al. (2026), eq. (5.2a), before its outer sum.
    """
    stations, _, lines = admittance.shape
    generator = torch.Generator().manual_seed(seed)
    uniform = torch.rand(draws, stations, generator=generator, dtype=torch.float64)
    pick = (uniform * counts).to(torch.int64).minimum(counts - 1)
    place = torch.arange(stations)
    step = max(1, DRAWN // (stations * lines))
    return torch.cat([admittance[place, part].mean(1) for part in pick.split(step)])


def monte_carlo_deviation(admittance: Tensor, counts: Tensor) -> Tensor:
    """Standard deviation of real and imaginary part of ``monte_carlo``, in closed form, (F,)."""
    there = (torch.arange(admittance.shape[1]) < counts[:, None])[..., None]
    away = torch.where(there, admittance - mean_over_segments(admittance, counts)[:, None], 0)
    parts = [
        ((part.square().sum(1) / counts[:, None]).sum(0)).sqrt() / len(counts)
        for part in (away.real, away.imag)
    ]
    return torch.complex(*parts)


def _deviation(values: Tensor) -> Tensor:
    return torch.complex(values.real.std(0), values.imag.std(0))


def _line_interval(
    line: ImpedanceLine, admittance: Tensor, counts: Tensor, chosen: Choices
) -> Interval | None:
    """Independent draws of each station, added; Student's factor by Welch and Satterthwaite."""
    if chosen.interval is None or not can_resample(int(counts.min())):
        return None
    stations = len(counts)
    total = torch.zeros(chosen.draws, admittance.shape[2], dtype=torch.complex128)
    power = torch.zeros(admittance.shape[2], dtype=torch.float64)
    share = torch.zeros_like(power)
    bias = torch.zeros(admittance.shape[2], dtype=torch.complex128)
    reflection = line.reflection[line.used]
    for n, count in enumerate(counts.tolist()):
        own, mean = admittance[n, :count], admittance[n, :count].mean(0)
        # One length for all frequencies, so that their draws go together.
        length = int(run_lengths(own).max())
        weights = torch.full((count,), 1 / count, dtype=torch.float64)
        matrix = deviations(weights, length, chosen.draws, chosen.seed + 1 + n)
        draws = matrix.to(own) @ (own - mean) * mean_factor(count, length) / stations
        variance = draws.abs().square().mean(0)
        total += draws
        power += variance
        share += variance**2 / (count / length - 1)
        silent = line.wall is not None and line.wall[line.used][n]
        whole = admittance_from_reflection(reflection[n, :count].mean(0))
        bias += torch.where(torch.as_tensor(silent), 0, mean - whole) / stations
    runs = torch.where(share > 0, 1 + power**2 / share.clamp(min=1e-300), counts.sum() / 2)
    how = Resampling(
        weights, chosen.interval, chosen.draws, chosen.seed, convert=impedance_from_admittance
    )
    value = mean_over_segments(admittance, counts).mean(0)
    parts = [
        how.bounds(total[:, f : f + 1].T, (value - bias)[f : f + 1], float(runs[f]))
        for f in range(len(value))
    ]
    low, high, error = (torch.cat(each) for each in zip(*parts, strict=True))
    off = impedance_from_admittance(value) - impedance_from_admittance(value - bias)
    return Interval(low, high, error, runs, off)
