r"""Level check: does the educed impedance, with the measured velocity, give the pressure that is known?

With the level of the sound known and the velocity measured, Z is over-determined. V is the phase-locked velocity into
the liner at the tone, averaged over the cell, or over all cells for the whole plane. At normal incidence the waves are
plane, so V is moved from the height y of the data to the wall, :math:`V_0 = V/(\cos ky + j Z \sin ky)`, and then

.. math:: |p_i| = \rho c |Z + 1| |V_0|/2, \qquad p = \rho c Z V_0

for the incident wave and for the pressure at the wall; one cell among unlike ones has the pressure of all of them above
it, :math:`|p_i| = \rho c |Z V_0 + \langle V_0 \rangle|/2`. At grazing incidence the wave's field above the wall is not
known beforehand: V stays as measured, and what is stated is the pressure at the wall. V of several cells along a
grazing wave is averaged after its phase was turned back by that wavenumber along x which makes the mean largest.

The ratio of implied to known pressure is computed without each block in turn, like everything else.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import impedance_from_reflection, spl_from_pressure_amplitude
from torchliner.engine.intervals import ITSELF, jackknife, replicates
from torchliner.fluid import Fluid
from torchliner.records.level_check import Gap, LevelCheck, gap_of
from torchliner.velocity.averages import Averages
from torchliner.velocity.choices import Choices
from torchliner.velocity.known_pressure import INCIDENT, KnownPressure

NO_TONE = 1e-9  # of the rms velocity: a tone below it is rounding
WAVENUMBERS = 241  # tried along x, up to three times that of sound


def check_level(known: KnownPressure, found: dict[str, Averages], chosen: Choices, averaging: str) -> LevelCheck:
    """Of all averagings, with intervals where these have them; ``averaging``: of the answer."""
    velocity, ratios, bounds = cell_velocity(known), [], []
    lengths, fluid = known.moments.survey.blocks.lengths, known.moments.plane.fluid
    places = torch.cat([known.liner[None], known.cells.expand(known.moments.cells.count, -1)])
    for each in found.values():
        z = impedance_from_reflection(each.replicates.detach()).cpu()
        own, height = velocity[: len(z)], known.height or 0.0
        ratio = implied_pressure(known.kind, fluid, known.frequency, height, z, own) / places
        ratios.append(ratio[0])
        if each.liner.interval is not None and chosen.interval is not None:
            change = ratio / ratio[:1]
            change = change if known.replicates is None else change / known.replicates
            unknown = ~torch.isfinite(change.sum(0))
            logarithm = torch.where(unknown, 0, torch.log(torch.where(unknown, 1, change)))
            interval = jackknife(logarithm, lengths / lengths.sum(), chosen.interval, ITSELF)
            bounds.append([torch.where(unknown, torch.nan, end) for end in (interval.low, interval.high)])
    ends = None
    if len(bounds) == len(ratios):
        low, high = zip(*bounds, strict=True)
        ends = torch.stack(low), torch.stack(high)
    gap = vars(gap_of(torch.stack(ratios), ends, known.has_phase)).values()
    return LevelCheck(
        averagings=tuple(found),
        averaging=averaging,
        known=known.words,
        kind=known.kind,
        pressure_level=spl_from_pressure_amplitude(known.liner),
        limit=chosen.level_limit + chosen.level_uncertainty,
        uncertainty=chosen.level_uncertainty,
        confidence=chosen.interval if ends else None,
        liner=Gap(*(value[:, 0] for value in gap)),
        cells=Gap(*(value[:, 1:] for value in gap)),
    )


def change_that_passes(known: KnownPressure, z: Tensor, gap: Gap) -> Tensor:
    r"""Z' - Z of the whole plane, complex, (F,): Z' gives the known pressure with the velocity as it is.

    The implied pressure goes as :math:`w = (Z + e)/(\cos ky + j Z \sin ky)`, with e = 1 for the incident wave and 0 for
    the pressure at the wall; it is q times the known one, so that Z' has w/q. Without a known phase that of w is kept.

    Args:
        z: of the whole plane, (F,).
        gap: implied over known pressure there, (F,).
    """
    angle = 2 * torch.pi * known.frequency / float(known.moments.plane.fluid.sound_speed) * (known.height or 0.0)
    cosine, sine, end = angle.cos(), angle.sin(), float(known.kind == INCIDENT)
    q = torch.polar(10 ** (gap.level / 20), torch.deg2rad(gap.phase.nan_to_num(0)))
    wanted = (z + end) / (cosine + 1j * z * sine) / q
    return (wanted * cosine - end) / (1 - 1j * wanted * sine) - z


def ratio_of_pressures(known: KnownPressure, *, every: bool = False) -> Callable[[Tensor], Tensor]:
    """Implied over known pressure of the whole plane, complex, as a function of its Z, (..., F); with ``every`` of Z of
    all blocks and without each of them, (B, F). Its phase means something where ``known.has_phase``."""
    velocity, height, fluid = cell_velocity(known)[:, :1], known.height or 0.0, known.moments.plane.fluid

    def ratio(z: Tensor) -> Tensor:
        own = velocity[: len(z)] if every else velocity[0]
        z = z[:, None] if every else z[None]
        pressure = implied_pressure(known.kind, fluid, known.frequency, height, z, own)
        found = (pressure[:, 0] if every else pressure[0]) / known.liner
        return found / known.replicates[: len(z), 0] if every and known.replicates is not None else found

    return ratio


def cell_velocity(known: KnownPressure) -> Tensor:
    """Complex peak amplitude of v into the liner, m/s, (B, 1 + C, F): the whole plane first; nan without a tone."""
    moments, seen, members = known.moments, known.moments.survey, known.moments.membership
    probes = seen.tone(known.frequency, lambda sums: replicates(sums, seen.lengths))
    cells = -members.mean(probes.transpose(1, 2)).transpose(1, 2).cpu()
    scale = members.mean(seen.mean_square).sqrt().cpu()
    cells = torch.where(cells.abs() <= NO_TONE * scale[:, None], torch.nan, cells)
    share = moments.cells.weight
    share = torch.ones(moments.cells.count, dtype=torch.float64) if share is None else share
    weights = (share / share.sum())[:, None].to(torch.complex128)
    if known.height is None:
        speed = float(moments.plane.fluid.sound_speed)
        weights = weights * turned_back(moments.cells.x, torch.nan_to_num(cells[0]), known.frequency, speed)
    return torch.cat([(weights * cells).sum(1, keepdim=True), cells], 1)


def turned_back(x: Tensor, velocity: Tensor, frequency: Tensor, sound_speed: float) -> Tensor:
    """Unit factors that undo the phase of a wave along x (m, (C,), nan where unknown) of velocities (C, F)."""
    away = torch.nan_to_num(x - x.nanmean())[:, None]
    steps = torch.linspace(-3, 3, WAVENUMBERS, dtype=torch.float64)
    turns = torch.exp(2j * torch.pi / sound_speed * steps[:, None, None] * away * frequency)
    best = (turns * velocity).sum(1).abs().argmax(0)
    return turns.gather(0, best.expand(1, len(x), -1))[0]


def implied_pressure(kind: str, fluid: Fluid, frequency: Tensor, height: Any, z: Tensor, velocity: Tensor) -> Tensor:
    """Pressure that impedances and velocities imply, Pa, (..., 1 + C, F), the whole plane first.

    Args:
        kind: ``incident`` or ``wall``.  fluid: of the data.  frequency: Hz, (F,).
        height: from which the velocity is moved to the wall, m, a number or (1 + C, 1).
        z, velocity: impedance, and v into the liner, m/s, (..., 1 + C, F).
    """
    angle = 2 * torch.pi * frequency / float(fluid.sound_speed) * height
    at_wall = velocity / (angle.cos() + 1j * angle.sin() * z)
    pressure = z * at_wall
    if kind == INCIDENT:
        pressure = (pressure + at_wall[..., :1, :]) / 2
    return float(fluid.characteristic_impedance) * pressure
