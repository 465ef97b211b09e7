r"""Averages over segments and stations, eqs (5.1) and (5.2), how far each may be off, and their level check.

(5.2) draws one segment a station, averages the admittances over the stations and then over the draws. The mean over all
possible draws is the mean over stations of the mean over segments, so that no draw is needed for it; with the variances
:math:`s_n^2` of a station's admittances over its segments the draws scatter by :math:`\sqrt{\sum s_n^2}/N`. This is
neither the spread along the line nor the uncertainty of the result.

For the latter results are computed without each segment of each station in turn (``engine.intervals``). Variances of
stations add, with the degrees of freedom of Welch and Satterthwaite. As segments are short and Z is not linear in R, a
mean over them is off by the mean of Z less Z of the mean R, right to second order. The bounds are without that bias.

The level check is that of planes (``velocity.level_check``), where a station is a cell of its own; the standard errors
of Z and of V, :math:`\sqrt{(1-\gamma^2)/(2 n \gamma^2)}` of itself from its coherence over n blocks, add as independent
ones. V of the line is a mean of phasors, for which the stations need a common reference channel. Without one the sound
along a line has the mean size of V, which needs no clock, and several stations at normal incidence are not compared.
"""

import dataclasses
import math

import torch
from scipy.special import ndtri, stdtrit
from torch import Tensor

from torchliner.conversions import (
    admittance_from_reflection,
    impedance_from_admittance,
    impedance_from_reflection,
    mean_impedance,
)
from torchliner.engine import intervals
from torchliner.engine.intervals import FEWEST_BLOCKS, FROM_REFLECTION, Conversion
from torchliner.records import ImpedanceLine, Interval, LevelCheck, LineAverage
from torchliner.records.impedance_line import mean_over_segments
from torchliner.records.level_check import level_check_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.level_check import INCIDENT, KnownPressure, stated_pressure, turned_back

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
        raise ValueError("no station counts: all are flagged ('torchliner ldv info'); flagged='use' takes them")
    drawn, admittance = monte_carlo(each[used], counts[used], draws, SEED), line.over_segments(each)
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
    found = interval_of(mean, scatter(reflection, counts), level, FROM_REFLECTION, torch.zeros_like(mean))
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
    power, square, runs = map(torch.stack, zip(*found, strict=True))
    return power, square, runs


def interval_of(value: Tensor, found: Scatter, level: float, conversion: Conversion, bias: Tensor) -> Interval:
    """Interval of Z from the scatter of what it is made of, a value (...), and how far that is off in the mean."""
    power, square, runs = found
    quantile = torch.from_numpy(stdtrit((runs - 1).clamp(min=1).numpy(), 0.5 + level / 2))
    return intervals.impedance_interval(value, bias, power, square, quantile, runs, conversion)


def line_level_check(line: ImpedanceLine, choices: Choices) -> LevelCheck | str:
    """Of the average, and of each station, against the stated level; or why there is none."""
    stated = stated_pressure(line, line.frequency, line.choices["tone"])
    if isinstance(stated, str) or line.average is None:
        return stated if isinstance(stated, str) else "not checked: the line has no average"
    kind, words, pressure = stated
    used, own, count = line.used, line.velocity_amplitude, line.average.stations
    # The standard error of the size of V over itself, from its coherence over so many pieces.
    start, segment = line.segment_start, float(line.choices["segment"])
    length = torch.nan_to_num(start, nan=-math.inf).amax(1, keepdim=True) - start[:, :1] + segment
    pieces, coherence = (length / segment * line.choices["blocks"]).clamp(min=1), line.coherence.clamp(1e-12, 1.0)
    size, error = own[used].abs(), ((1 - coherence) / (2 * pieces * coherence)).sqrt()
    turns = torch.ones_like(own)
    if kind != INCIDENT:
        turns = turned_back(line.x, torch.where(used[:, None], own, 0), line.frequency, float(line.fluid.sound_speed))
    mean, spread = (turns * own)[used].mean(0), (size * error[used]).square().sum(0).sqrt() / count
    if count > 1 and not line.choices["referred"]:
        if kind == INCIDENT:
            return "not checked: the stations share no reference channel, without which V has no mean; give one"
        words, mean = f"{words}, mean size of V, without a reference channel", size.mean(0).to(own.dtype)
    # The whole line first, then its stations.
    z, velocity = torch.cat([line.average.impedance[None], line.impedance]), torch.cat([mean[None], own])
    height = torch.cat([line.y[used].nanmean()[None], line.y]).nan_to_num()[:, None] * (kind == INCIDENT)
    known = KnownPressure(line.fluid, line.frequency, kind, words, pressure.expand(len(z), -1), height=height)
    ratio = known.ratio(z, velocity)
    ends, bounds = None, (line.average.interval, line.interval)
    if choices.interval is not None and bounds[0] is not None and bounds[1] is not None:
        of_z = torch.cat([bounds[0].standard_error[None], bounds[1].standard_error])
        value = z + velocity[:1] / velocity if kind == INCIDENT else z
        of_value = torch.hypot(value.real * of_z.real, value.imag * of_z.imag) / value.abs() ** 2
        of_size = torch.hypot(of_value, torch.cat([(spread / mean.abs())[None], error]))
        reach = float(ndtri(0.5 + choices.interval / 2)) * torch.complex(of_size, torch.zeros_like(of_size))[None]
        ends = torch.stack([-reach, reach])
    about = {"averagings": ("stations",), "averaging": "stations", "known": words, "kind": kind}
    return level_check_of(ratio[None], ends, False, pressure, choices, **about)
