r"""Closure: does the educed impedance, with the measured velocity, give the pressure that is known?

With the level of the sound known and the velocity measured, Z is over-determined. V is the coherent
velocity into the liner at the tone, averaged over the cell, or over all cells for the whole plane.
At normal incidence the waves are plane, so V is moved from the height y of the data to the wall,
:math:`V_0 = V/(\cos ky + j Z \sin ky)`, and then

.. math:: |p_i| = \rho c |Z + 1| |V_0|/2, \qquad p = \rho c Z V_0

for the incident wave and for the pressure at the wall; one cell among unlike ones has the pressure
of all of them above it, :math:`|p_i| = \rho c |Z V_0 + \langle V_0 \rangle|/2`. At grazing
incidence the wave's field above the wall is not known beforehand: V stays as measured, and what is
stated is the pressure at the wall. V of several cells along a grazing wave is averaged after its
phase was turned back by that wavenumber along x which makes the mean largest.

The ratio of implied to known pressure is resampled with the same blocks of time for Z, V and p.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import reflection_from_impedance, spl_from_pressure_amplitude
from torchliner.records import Closure, ImpedanceMap
from torchliner.records.closure import Gap, gap_of
from torchliner.signals.resampling import ITSELF
from torchliner.signals.tones import line_sums
from torchliner.tdibc.intervals import Series, resampling_of
from torchliner.tdibc.known_pressure import INCIDENT, KnownPressure, known_pressure
from torchliner.tdibc.prepared import Prepared

NO_TONE = 1e-9  # of the rms velocity: a tone below it is rounding
WAVENUMBERS = 241  # tried along x, up to three times that of sound


def with_closure(prepared: Prepared, found: ImpedanceMap, series: Series, pressure: Any = None) -> ImpedanceMap:
    """The map with its closure, and a warning where the answer's order of averaging fails.

    Args:
        prepared: prepared plane.
        found: its map.
        series: of ``uncertainty_of``; empty without intervals.
        pressure: see ``known_pressure``.
    """
    known = known_pressure(prepared, pressure)
    if isinstance(known, str):
        return dataclasses.replace(found, choices={**found.choices, "closure": known})
    closure = closure_of(prepared, found, series, known)
    sentences = [closure.sentence(found.order, f, i) for i, f in enumerate(prepared.frequency.tolist())]
    notes = [f"{prepared.plane.name}: {text}" for text in sentences if text]
    choices = {**found.choices, "closure": "checked"}
    return dataclasses.replace(found, closure=closure, notes=(*found.notes, *notes), choices=choices)


def closure_of(prepared: Prepared, found: ImpedanceMap, series: Series, known: KnownPressure) -> Closure:
    """Of all orders of averaging that a map has."""
    chosen, moving = prepared.chosen, Coherent.of(prepared, known)
    pressure = torch.cat([known.liner[None], known.cells])
    ratios, bounds = [], []
    for order in found.orders:
        z = torch.cat([found.of_liner(order)[None], found.of_cells(order)]).cpu()
        ratios.append(_implied(prepared, known, z, moving.velocity) / pressure)
        if order in series and moving.away is not None:
            liner, cells = series[order]
            bounds.append(_ends(prepared, known, z, torch.cat([liner[:, None], cells], 1).cpu(), moving))
    ends = None
    if len(bounds) == len(ratios):
        low, high = zip(*bounds, strict=True)
        ends = torch.stack(low), torch.stack(high)
    gap = gap_of(torch.stack(ratios), ends, known.has_phase)
    return Closure(
        orders=found.orders,
        order=found.order,
        known=known.words,
        kind=known.kind,
        pressure_level=spl_from_pressure_amplitude(known.liner),
        limit=chosen.closure_limit + chosen.level_doubt,
        doubt=chosen.level_doubt,
        confidence=chosen.interval if ends else None,
        liner=Gap(*(value[:, 0] for value in vars(gap).values())),
        cells=Gap(*(value[:, 1:] for value in vars(gap).values())),
    )


def closure_ratio(prepared: Prepared, known: KnownPressure) -> Callable[[Tensor], Tensor]:
    """Implied over known pressure of the whole plane as a function of its Z, (..., F), complex.

    The phase of the ratio means something where ``known.has_phase``.
    """
    velocity = Coherent.of(prepared, known).velocity[:1]

    def ratio(impedance: Tensor) -> Tensor:
        return _implied(prepared, known, impedance[None], velocity)[0] / known.liner

    return ratio


@dataclass(frozen=True, eq=False)
class Coherent:
    """Coherent velocity into the liner, the whole plane first, then its cells.

    Args:
        velocity: complex peak amplitude, m/s, (1 + C, F); nan without a tone.
        away: relative deviation in each block, (S, 1 + C, F); None without blocks.
    """

    velocity: Tensor
    away: Tensor | None

    @classmethod
    def of(cls, prepared: Prepared, known: KnownPressure) -> Coherent:
        """From the survey of a plane."""
        seen, columns = prepared.survey, prepared.averaged
        cells = 2 * prepared.velocity_amplitude[columns].cpu()
        quiet = cells.abs() <= NO_TONE * seen.mean_square[columns, None].sqrt().cpu()
        cells = torch.where(quiet, torch.nan, cells)
        count, share = prepared.cells.count, prepared.cells.weight
        share = torch.ones(count, dtype=torch.float64) if share is None else share
        weights = (share / share.sum())[:, None].to(torch.complex128)
        if not known.moved:
            speed = float(prepared.plane.fluid.sound_speed)
            known_cells = torch.nan_to_num(cells)
            weights = weights * turned_back(prepared.cells.x, known_cells, prepared.frequency, speed)
        liner = (weights * cells).sum(0)
        velocity = torch.cat([liner[None], cells])
        if seen.cell_blocks is None or prepared.blocks is None:
            return cls(velocity, None)
        lines = -2 * (seen.cell_blocks.line.cpu() - _mean_lines(prepared))
        away = lines - lines.mean(0)
        whole = (weights * away).sum(1, keepdim=True)
        return cls(velocity, torch.cat([whole, away], 1) / velocity)


def _mean_lines(prepared: Prepared) -> Tensor:
    """What the mean velocity leaves in the lines of blocks of not quite whole periods."""
    blocks, rate = prepared.blocks, prepared.plane.sampling_rate
    assert blocks is not None
    lines = torch.stack([
        line_sums(torch.ones(end - begin), prepared.frequency, rate, begin) / (end - begin)
        for begin, end in zip(blocks.borders[:-1], blocks.borders[1:], strict=True)
    ])  # fmt: skip
    mean = prepared.survey.mean[prepared.averaged].cpu()
    return lines[:, None] * mean[:, None]


def turned_back(x: Tensor, velocity: Tensor, frequency: Tensor, sound_speed: float) -> Tensor:
    """Unit factors that undo the phase of a wave along x.

    Args:
        x: m, (C,); nan where unknown.
        velocity: complex, (C, F).
        frequency: Hz, (F,).
        sound_speed: m/s.
    """
    away = torch.nan_to_num(x - x.nanmean())[:, None]
    steps = torch.linspace(-3, 3, WAVENUMBERS, dtype=torch.float64)
    turns = torch.exp(2j * torch.pi / sound_speed * steps[:, None, None] * away * frequency)
    best = (turns * velocity).sum(1).abs().argmax(0)
    return turns.gather(0, best.expand(1, len(x), -1))[0]


def _motion(prepared: Prepared, known: KnownPressure) -> tuple[Tensor, Tensor]:
    """cos ky and j sin ky, (F,); 1 and 0 where V stays as measured."""
    plane = prepared.plane
    height = plane.height if known.moved and plane.height is not None else 0.0
    angle = 2 * torch.pi * prepared.frequency / float(plane.fluid.sound_speed) * height
    return angle.cos(), 1j * angle.sin()


def _divisor(prepared: Prepared, known: KnownPressure, z: Tensor) -> Tensor:
    """V at the plane's height over V at the wall."""
    along, across = _motion(prepared, known)
    return along + across * z


def _implied(prepared: Prepared, known: KnownPressure, z: Tensor, velocity: Tensor) -> Tensor:
    """Pressure that impedances and velocities imply, Pa, (1 + C, F), the whole plane first."""
    at_wall = velocity / _divisor(prepared, known, z)
    pressure = z * at_wall
    if known.kind == INCIDENT:
        pressure = (pressure + at_wall[:1]) / 2
    return float(prepared.plane.fluid.characteristic_impedance) * pressure


def _ends(
    prepared: Prepared, known: KnownPressure, z: Tensor, of_reflection: Tensor, moving: Coherent
) -> tuple[Tensor, Tensor]:
    """Of the logarithm of the ratio, less its value, (1 + C, F) each.

    Args:
        prepared, known: as above.
        z: (1 + C, F).
        of_reflection: deviation of R in each block, (S, 1 + C, F).
        moving: velocity, with its deviations.
    """
    assert moving.away is not None
    divisor = _divisor(prepared, known, z)
    of_z = 2 / (1 - reflection_from_impedance(z)) ** 2 * of_reflection
    of_velocity = moving.away - _motion(prepared, known)[1] / divisor * of_z
    away = of_velocity + of_z / z  # of the pressure, relative
    if known.kind == INCIDENT:
        at_wall = moving.velocity / divisor
        whole = (at_wall * of_velocity)[:, :1]
        away = (z * at_wall * away + whole) / (z * at_wall + at_wall[:1])
    if known.away is not None:
        away = away - known.away
    how = dataclasses.replace(resampling_of(prepared), conversion=ITSELF)
    found = how.over_time(torch.nan_to_num(away), torch.zeros_like(z))
    unknown = ~torch.isfinite(away.sum(0))
    return torch.where(unknown, torch.nan, found.low), torch.where(unknown, torch.nan, found.high)
