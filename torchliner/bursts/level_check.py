r"""Level check of a line of stations: see ``velocity.level_check``; a station is a cell of its own.

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
from torchliner.pressure.known_pressure import INCIDENT, stated_pressure
from torchliner.records import Gap, ImpedanceLine, Interval, LevelCheck
from torchliner.records.level_check import gap_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.level_check import turned_back

CHANCE = 1e-3  # of stations on one clock whose phases noise alone sets as far apart


def line_level_check(line: ImpedanceLine, choices: Choices) -> LevelCheck | str:
    """Of the average, and of each station, against the stated level; or why there is none."""
    known = stated_pressure(line, line.frequency, line.choices["tone"])
    if isinstance(known, str) or line.average is None:
        return known if isinstance(known, str) else "not checked: the line has no average"
    kind, words, pressure = known
    used, own, error = line.used, line.velocity_amplitude, _velocity_error(line)
    speed, turns = float(line.fluid.sound_speed), torch.ones_like(own)
    if kind != INCIDENT:
        turns = turned_back(line.x, torch.where(used[:, None], own, 0), line.frequency, speed)
    # The mean of V in shares of its mean size, and the least of it that noise leaves on one clock.
    size = own[used].abs()
    share = (turns * own)[used].mean(0).abs() / size.mean(0)
    noise = (size * error[used].clamp(max=1).square()).mean(0) / 2 / size.mean(0)
    noise = noise * float(chdtri(max(1, len(size) - 1), CHANCE)) / len(size)
    least = (1 - noise) / 10 ** (choices.level_limit / 20)
    apart = (share < least) & ~pressure.isnan() & (not line.choices["referred"])
    if bool(apart.any()):
        if kind == INCIDENT:
            return (
                "not checked: without a reference channel the phases of V at the stations disagree, its mean is "
                f"{float(share[apart]):.2f} of its mean size (on one clock {float(least[apart]):.2f} at least). Give a "
                "reference channel, or count the times of all stations from one instant of the generator"
            )
        words = f"{words}, mean size of V, as the phases of the stations disagree"
        turns = torch.where(apart, own.conj() / own.abs().clamp(min=1e-300), turns)
    mean = (turns * own)[used].mean(0)
    spread = (size * error[used]).square().sum(0).sqrt() / len(size)

    def gap(z: Tensor, velocity: Tensor, of_velocity: Tensor, interval: Interval | None, y: Tensor) -> Gap:
        """Implied over stated pressure, of values (N, F) at heights (N,)."""
        implied, value = z * velocity, z
        if kind == INCIDENT:
            angle = 2 * torch.pi / speed * torch.nan_to_num(y)[:, None] * line.frequency
            value = z + mean / velocity
            implied = velocity / (angle.cos() + 1j * angle.sin() * z) * value / 2
        ratio = float(line.fluid.characteristic_impedance) * implied / pressure
        return gap_of(ratio[None], _ends(value, of_velocity, interval, choices), False)

    average = line.average
    middle = line.y[used].nanmean()[None]
    whole = gap(average.impedance[None], mean[None], (spread / mean.abs())[None], average.interval, middle)
    return LevelCheck(
        averagings=("stations",),
        averaging="stations",
        known=words,
        kind=kind,
        pressure_level=spl_from_pressure_amplitude(pressure),
        limit=choices.level_limit + choices.level_uncertainty,
        uncertainty=choices.level_uncertainty,
        confidence=None if line.interval is None else choices.interval,
        liner=Gap(*(value[:, 0] for value in vars(whole).values())),
        cells=gap(line.impedance, own, error, line.interval, line.y),
    )


def _velocity_error(line: ImpedanceLine) -> Tensor:
    """Standard error of the size of V over itself, (N, F)."""
    start, segment = line.segment_start, float(line.choices["segment"])
    length = torch.nan_to_num(start, nan=-math.inf).amax(1, keepdim=True) - start[:, :1] + segment
    pieces = (length / segment * line.choices["blocks"]).clamp(min=1)
    coherence = line.coherence.clamp(min=1e-12, max=1.0)
    return ((1 - coherence) / (2 * pieces * coherence)).sqrt()


def _ends(
    value: Tensor, of_velocity: Tensor, interval: Interval | None, choices: Choices
) -> tuple[Tensor, Tensor] | None:
    """Of the logarithm of |value V|, whose value has the standard errors of an interval of Z."""
    if interval is None or choices.interval is None:
        return None
    error = interval.standard_error.reshape(value.shape)
    of_size = torch.hypot(value.real * error.real, value.imag * error.imag) / value.abs() ** 2
    reach = float(ndtri(0.5 + choices.interval / 2)) * torch.hypot(of_size, of_velocity)
    reach = torch.complex(reach, torch.zeros_like(reach))[None]
    return -reach, reach
