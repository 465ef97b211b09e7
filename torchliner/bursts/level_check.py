r"""Level check of a line of stations: that of planes (``velocity.level_check``), where a station is a cell of its own.

The stations were measured one after another, so that Z and V of a station share no blocks of time: the interval adds
their standard errors as independent ones. V errs by :math:`\sqrt{(1-\gamma^2)/(2 n \gamma^2)}` of itself, from its
coherence over n blocks.

V of the line is a mean of phasors: with a reference channel they are relative to it, without one the times of all
stations must count from one instant of the generator. If they do not, the mean of V is less than its mean size by more
than noise and ``level_limit`` allow. Sound along the line then has the mean size, which needs no clock; at normal
incidence nothing is compared.
"""

from __future__ import annotations

import math

import torch
from scipy.special import chdtri, ndtri
from torch import Tensor

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.records import Gap, ImpedanceLine, LevelCheck
from torchliner.records.level_check import gap_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.known_pressure import INCIDENT, stated_pressure
from torchliner.velocity.level_check import implied_pressure, turned_back

CHANCE = 1e-3  # of stations on one clock whose phases noise alone sets as far apart


def line_level_check(line: ImpedanceLine, choices: Choices) -> LevelCheck | str:
    """Of the average, and of each station, against the stated level; or why there is none."""
    known = stated_pressure(line, line.frequency, line.choices["tone"])
    if isinstance(known, str) or line.average is None:
        return known if isinstance(known, str) else "not checked: the line has no average"
    kind, words, pressure = known
    used, own, error = line.used, line.velocity_amplitude, _velocity_error(line)
    turns = torch.ones_like(own)
    if kind != INCIDENT:
        turns = turned_back(line.x, torch.where(used[:, None], own, 0), line.frequency, float(line.fluid.sound_speed))
    size, count = own[used].abs(), line.average.stations
    mean, spread = (turns * own)[used].mean(0), (size * error[used]).square().sum(0).sqrt() / count
    # The mean of V in shares of its mean size, and the least of it that noise leaves on one clock.
    share = mean.abs() / size.mean(0)
    noise = (size * error[used].clamp(max=1).square()).mean(0) / 2 / size.mean(0)
    least = (1 - noise * float(chdtri(max(1, count - 1), CHANCE)) / count) / 10 ** (choices.level_limit / 20)
    apart = (share < least) & ~pressure.isnan() & (not line.choices["referred"])
    if bool(apart.any()):
        if kind == INCIDENT:
            return (
                "not checked: without a reference channel the phases of V at the stations disagree, its mean is "
                f"{float(share[apart]):.2f} of its mean size (on one clock {float(least[apart]):.2f} at least). Give a "
                "reference channel, or count the times of all stations from one instant of the generator"
            )
        words = f"{words}, mean size of V, as the phases of the stations disagree"
        mean = torch.where(apart, size.mean(0), mean)
    # The whole line first, then its stations.
    z, velocity = torch.cat([line.average.impedance[None], line.impedance]), torch.cat([mean[None], own])
    height = torch.cat([line.y[used].nanmean()[None], line.y]).nan_to_num()[:, None] * (kind == INCIDENT)
    ratio = implied_pressure(kind, line.fluid, line.frequency, height, z, velocity) / pressure
    ends, intervals = None, (line.average.interval, line.interval)
    if choices.interval is not None and intervals[0] is not None and intervals[1] is not None:
        of_z = torch.cat([intervals[0].standard_error[None], intervals[1].standard_error])
        value = z + velocity[:1] / velocity if kind == INCIDENT else z
        of_value = torch.hypot(value.real * of_z.real, value.imag * of_z.imag) / value.abs() ** 2
        of_size = torch.hypot(of_value, torch.cat([(spread / mean.abs())[None], error]))
        reach = float(ndtri(0.5 + choices.interval / 2)) * torch.complex(of_size, torch.zeros_like(of_size))[None]
        ends = -reach, reach
    gap = vars(gap_of(ratio[None], ends, False)).values()
    return LevelCheck(
        averagings=("stations",),
        averaging="stations",
        known=words,
        kind=kind,
        pressure_level=spl_from_pressure_amplitude(pressure),
        limit=choices.level_limit + choices.level_uncertainty,
        uncertainty=choices.level_uncertainty,
        confidence=choices.interval if ends else None,
        liner=Gap(*(value[:, 0] for value in gap)),
        cells=Gap(*(value[:, 1:] for value in gap)),
    )


def _velocity_error(line: ImpedanceLine) -> Tensor:
    """Standard error of the size of V over itself, (N, F)."""
    start, segment = line.segment_start, float(line.choices["segment"])
    length = torch.nan_to_num(start, nan=-math.inf).amax(1, keepdim=True) - start[:, :1] + segment
    pieces = (length / segment * line.choices["blocks"]).clamp(min=1)
    coherence = line.coherence.clamp(min=1e-12, max=1.0)
    return ((1 - coherence) / (2 * pieces * coherence)).sqrt()
