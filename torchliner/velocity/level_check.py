r"""Level check: does the educed impedance, with the measured velocity, give the pressure that is known?

V is the phase-locked velocity into the liner at the tone, averaged over a cell or over all. At normal incidence the
waves are plane, so V is moved from the height y of the data to the wall, :math:`V_0 = V/(\cos ky + j Z \sin ky)`, and

.. math:: |p_i| = \rho c |Z + 1| |V_0|/2, \qquad p = \rho c Z V_0

are the incident wave and the pressure at the wall; one cell among unlike ones has the pressure of all of them above it,
:math:`|p_i| = \rho c |Z V_0 + \langle V_0 \rangle|/2`. At grazing incidence the field above the wall is not known
beforehand: V stays as measured, the pressure is that at the wall, and V of several cells is averaged after its phase
was turned back by that wavenumber along x which makes the mean largest.

How much of the incoherent velocity acts where jets pass the plane is not known (docs/background.md). Where the level is
known it follows: the incoherent velocity is scaled until the level check is 0, which gives the level-matched Z. Each
block is left out in turn and the share found again to first order, so that the interval holds the scatter of Z and of
the velocity together; a level that is off by its stated uncertainty moves Z along the same path.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.conversions import impedance_from_reflection, pressure_amplitude_from_spl, spl_from_pressure_amplitude
from torchliner.engine.drives import phase_locked
from torchliner.engine.intervals import FEWEST_BLOCKS, ITSELF, jackknife
from torchliner.engine.moments import Moments
from torchliner.fluid import Fluid
from torchliner.liners.model import LinerModel
from torchliner.pressure.spectra import segment_amplitudes
from torchliner.records import Gap, PressureRecord
from torchliner.records.case import require_same_run
from torchliner.records.cells import sort_into_cells
from torchliner.records.level_check import UNKNOWN, LevelCheck, LevelMatched
from torchliner.records.notes import Note
from torchliner.velocity.averages import Averages, average
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import Reading

INCIDENT, WALL = "incident", "wall"
SAME_TIMES = 0.01  # of the duration: beyond, phases belong to different times
NO_TONE = 1e-9  # of the rms velocity: a tone below it is rounding
WAVENUMBERS = 241  # tried along x, up to three times that of sound
RANGE = (0.1, 4.0)  # of the share: beyond, it is not the share of the turbulence that is wrong
LEAST = 0.5  # dB by a factor e in the incoherent velocity: below, the level does not tell the share
CLOSE = 1e-9  # dB: such a level check is 0
STEP = 0.02  # in the logarithm of the share, for slopes
PER_NEPER = 20 / math.log(10)
NO_SIDE = (
    "not checked, state source_side: normal makes incident_level that of the incident wave, "
    "upstream or downstream that of the pressure at the wall"
)
NO_SOUND = "not checked, since source_side states that there is no sound"
OTHER_TONE = "not checked, since nothing is known at the frequencies asked for"


@dataclass(frozen=True, eq=False)
class KnownPressure:
    """Complex peak amplitudes at y = 0, Pa; nan at frequencies where nothing is known."""

    fluid: Fluid
    frequency: Tensor  # Hz, (F,)
    kind: str  # ``incident`` (of the incident wave) or ``wall`` (of the pressure itself)
    words: str  # what it is compared with
    pressure: Tensor  # of the whole plane and of each cell, (1 + C, F)
    has_phase: bool = False  # whether the phase is on the clock of the velocity
    height: float | None = None  # from which the velocity is moved to the wall, m; None: no plane waves

    def ratio(self, z: Tensor, velocity: Tensor) -> Tensor:
        """Implied over known pressure, (..., 1 + C, F), the whole plane first, or of that alone, (..., 1, F): of
        impedances and of velocities into the liner (m/s) of this shape."""
        angle = 2 * torch.pi * self.frequency / float(self.fluid.sound_speed) * (self.height or 0.0)
        at_wall = velocity / (angle.cos() + 1j * angle.sin() * z)
        implied = z * at_wall
        if self.kind == INCIDENT:
            implied = (implied + at_wall[..., :1, :]) / 2
        return float(self.fluid.characteristic_impedance) * implied / self.pressure[: z.shape[-2]]


def check_level(
    moments: Moments,
    frequency: Tensor,
    found: Mapping[str, Averages],
    chosen: Choices,
    averaging: str,
    pressure: Any = None,
) -> tuple[LevelCheck | None, str, list[Note]]:
    """Of all averagings, with intervals where these have them, None where nothing is known; ``checked``, or why nothing
    is; a note for each frequency at which the answer, of ``averaging``, does not pass."""
    known = known_pressure(moments, frequency, pressure)
    if isinstance(known, str):
        return None, known, []
    velocity, ratios, bounds, name = cell_velocity(moments, known), [], [], moments.plane.name
    for each in found.values():
        z = impedance_from_reflection(each.replicates.detach()).cpu()
        ratio = known.ratio(z, velocity[: len(z)])
        ratios.append(ratio[0])
        if each.liner.interval is not None and chosen.interval is not None:
            change = ratio / ratio[:1]
            unknown, lengths = ~torch.isfinite(change.sum(0)), moments.survey.lengths.cpu()
            logarithm = torch.where(unknown, 0, torch.log(torch.where(unknown, 1, change)))
            interval = jackknife(logarithm, lengths / lengths.sum(), chosen.interval, ITSELF)
            bounds.append(torch.stack([interval.low, interval.high]).masked_fill(unknown, torch.nan))
    ratio = torch.stack(ratios)  # (A, 1 + C, F)
    has_bounds, unknown_ends = len(bounds) == len(ratios), torch.full_like(ratio, complex(math.nan, math.nan))
    low, high = torch.stack(bounds, 1) if has_bounds else torch.stack([unknown_ends, unknown_ends])
    level, phase = 20 * torch.log10(ratio.abs()), torch.rad2deg(ratio.angle() if known.has_phase else unknown_ends.imag)
    gap = [level, level + PER_NEPER * low.real, level + PER_NEPER * high.real]
    gap += [phase, phase + torch.rad2deg(low.imag), phase + torch.rad2deg(high.imag)]
    check = LevelCheck(
        averagings=tuple(found),
        averaging=averaging,
        known=known.words,
        kind=known.kind,
        pressure_level=spl_from_pressure_amplitude(known.pressure[0]),
        limit=chosen.level_limit + chosen.level_uncertainty,
        uncertainty=chosen.level_uncertainty,
        confidence=chosen.interval if has_bounds else None,
        liner=Gap(*(value[:, 0] for value in gap)),
        cells=Gap(*(value[:, 1:] for value in gap)),
    )
    texts = [check.sentence(averaging, f, i) for i, f in enumerate(frequency.tolist())]
    return check, "checked", [Note("level-check", f"{name}: {text}") for text in texts if text]


def ratio_of_pressures(moments: Moments, known: KnownPressure, *, every: bool = False) -> Callable[[Tensor], Tensor]:
    """Implied over known pressure of the whole plane, complex, as a function of its Z, (..., F); with ``every`` of Z of
    all blocks and without each of them, (B, F). Its phase means something where ``known.has_phase``."""
    velocity = cell_velocity(moments, known)[:, :1]
    return lambda z: known.ratio(z[..., None, :], velocity[: len(z)] if every else velocity[0])[..., 0, :]


def cell_velocity(moments: Moments, known: KnownPressure) -> Tensor:
    """Complex peak amplitude of v into the liner, m/s, (B, 1 + C, F): the whole plane first; nan without a tone."""
    seen, members = moments.survey, moments.membership
    probes = seen.tone(known.frequency, every=True)
    cells = -members.mean(probes.transpose(1, 2)).transpose(1, 2).cpu()
    scale = members.mean(seen.mean_square).sqrt().cpu()
    cells = torch.where(cells.abs() <= NO_TONE * scale[:, None], torch.nan, cells)
    share = moments.cells.weight
    share = torch.ones(members.count, dtype=torch.float64) if share is None else share
    weights = (share / share.sum())[:, None].to(torch.complex128)
    if known.height is None:
        speed = float(known.fluid.sound_speed)
        weights = weights * turned_back(moments.cells.x, torch.nan_to_num(cells[0]), known.frequency, speed)
    return torch.cat([(weights * cells).sum(1, keepdim=True), cells], 1)


def turned_back(x: Tensor, velocity: Tensor, frequency: Tensor, sound_speed: float) -> Tensor:
    """Unit factors that undo the phase of a wave along x (m, (C,), nan where unknown) of velocities (C, F)."""
    away = torch.nan_to_num(x - x.nanmean())[:, None]
    steps = torch.linspace(-3, 3, WAVENUMBERS, dtype=torch.float64)
    turns = torch.exp(2j * torch.pi / sound_speed * steps[:, None, None] * away * frequency)
    best = (turns * velocity).sum(1).abs().argmax(0)
    return turns.gather(0, best.expand(1, len(x), -1))[0]


def known_pressure(moments: Moments, frequency: Tensor, given: Any = None) -> KnownPressure | str:
    """What is known of a plane's sound at frequencies in Hz, (F,), or why nothing is compared.

    ``given``: ``PressureRecord`` of the same run with a facesheet; None: the level that the plane states.
    """
    plane, count = moments.plane, moments.membership.count
    level, side, tone = plane.incident_level, plane.source_side, plane.frequency
    if given is not None:
        if not isinstance(given, PressureRecord) or given.facesheet is None:
            raise TypeError(f"pressure is {type(given).__name__}; a PressureRecord with a facesheet is needed")
        require_same_run(plane, given)
        return _of_record(moments, frequency, given)
    if side == "none" or level is None or side == "unknown":
        return NO_SOUND if side == "none" else UNKNOWN if level is None else NO_SIDE
    same = (frequency / (tone or (float(frequency[0]) if len(frequency) == 1 else math.nan)) - 1).abs() < SAME_FREQUENCY
    if not bool(same.any()):
        return OTHER_TONE
    pressure = torch.where(same, pressure_amplitude_from_spl(float(level)), torch.nan).to(torch.complex128)
    every = pressure.expand(1 + count, -1)
    if side == "normal":
        words = f"the stated {level:.4g} dB of the incident wave (normal incidence, rho c |Z + 1| |V|/2)"
        return KnownPressure(plane.fluid, frequency, INCIDENT, words, every, height=plane.height or 0.0)
    words = f"the stated {level:.4g} dB at the wall (grazing incidence, rho c |Z| |V|)"
    return KnownPressure(plane.fluid, frequency, WALL, words, every)


def _of_record(moments: Moments, frequency: Tensor, record: PressureRecord) -> KnownPressure:
    """The pressure of the facesheet."""
    plane, cells = moments.plane, moments.cells
    assert record.facesheet is not None
    after = plane.start - record.start
    same_times = abs(record.duration / plane.duration - 1) < SAME_TIMES and abs(after) < plane.duration
    # A phasor of the record becomes one of the plane.
    turn = 2 * torch.exp(2j * torch.pi * frequency * (after if same_times else 0.0))
    face = record.facesheet.reshape(record.probes, -1).to(torch.float64)
    mean, own = face.mean(0, keepdim=True), sort_into_cells(record, moments.cell_pitch)
    near, places = 0.1 * (moments.cell_pitch or 0.0), ((own.x, cells.x), (own.z, cells.z))
    same = own.count == cells.count and all(bool(torch.nan_to_num(a - b).abs().max() <= near) for a, b in places)
    # Where the record's cells are not the plane's, the mean stands for each.
    signals = torch.cat([mean, own.average(face, own.labels >= 0) if same else mean])
    peak = turn * segment_amplitudes(signals, frequency, record.sampling_rate)[0]
    words = f"the facesheet's pressure (rho c Z V, {'with' if same_times else 'without'} phase)"
    peaks = torch.cat([peak[:1], peak[1:].expand(cells.count, -1)])
    moved = plane.height or 0.0 if plane.source_side == "normal" else None
    return KnownPressure(plane.fluid, frequency, WALL, words, peaks, same_times, moved)


def match_level(
    reading: Reading, known: Moments, liner: LinerModel, pressure: object = None, reference_phase: object = None
) -> tuple[LevelMatched | None, list[Note]]:
    """Z at each frequency at which a pressure is known, and why there is none.

    ``reading`` is of a plane that still has its samples: each share that is tried reads them again; ``known`` is what
    it gave, ``liner``, ``pressure`` and ``reference_phase`` as of ``educe``.
    """
    from scipy.optimize import brentq  # takes a quarter of a second to import

    chosen, frequency, name = reading.chosen, reading.frequency, known.plane.name
    if known.locked is None:
        raise ValueError("level_matched scales what phase-locked averaging leaves; choose averaging='phase-locked'")
    pressures = known_pressure(known, frequency, pressure)
    if isinstance(pressures, str):
        return None, [Note("level-matched", f"{name}: no level-matched answer: {pressures}")]
    scale = torch.ones_like(known.survey.mean) if known.locked.scale is None else known.locked.scale
    seen, ratio = dict[float, tuple[Tensor, Tensor]](), ratio_of_pressures(known, pressures, every=True)
    lengths, notes = known.survey.lengths.cpu(), []

    def at(place: float) -> tuple[Tensor, Tensor]:
        """Z of the liner and level check, nepers, of all blocks and without each, (B, F), by the share's logarithm."""
        if place not in seen:
            drive = phase_locked(known.survey, known.membership, math.exp(place) * scale)
            moments = known if place == 0 else reading.with_drive(known, drive)
            found = average(moments, liner, frequency, chosen, "phase-locked", reference_phase)
            z = impedance_from_reflection(found.replicates[:, 0].detach()).cpu()
            seen[place] = z, ratio(z).log()
        return seen[place]

    def matched(i: int) -> list[complex] | str:
        """The fields of the record at one frequency, or why there are none."""

        def gap(place: float) -> float:
            """dB."""
            return PER_NEPER * float(at(place)[1][0, i].real)

        place, end = 0.0, math.log(RANGE[int(gap(0.0) < 0)])
        beyond = abs(gap(0.0)) > CLOSE and gap(0.0) * gap(end) > 0
        if abs(gap(0.0)) > CLOSE and not beyond:
            place = float(brentq(gap, min(end, 0.0), max(end, 0.0), xtol=1e-5))
        rate = (gap(place + STEP) - gap(place)) / STEP  # dB by a factor e
        if rate < LEAST:
            return f"the level check changes by {rate:.2g} dB by a factor e in the incoherent rms (limit {LEAST:g})"
        if beyond:
            still = f"still {gap(end):+.2f} dB with {math.exp(end):g} times the incoherent velocity"
            return f"the level check is {still}: model, level or phase-locked velocity are wrong"
        share, away = math.exp(place), chosen.level_uncertainty / rate
        (z, ratio), (beside, _) = ([each[:, i] for each in at(where)] for where in (place, place + STEP))
        by, bounds = complex((beside[0] - z[0]) / STEP), [complex(math.nan, math.nan)] * 4
        if chosen.interval is not None and len(lengths) >= FEWEST_BLOCKS:
            moved = -(ratio - ratio[:1]).real * PER_NEPER / rate  # the logarithm of each replicate's own share
            values = torch.stack([z + by * moved, moved.to(z)], 1)
            interval = jackknife(values, lengths / lengths.sum(), chosen.interval, ITSELF)
            for k, (value, more) in enumerate(((complex(z[0]), by * away), (0j, complex(away)))):
                bounds[2 * k : 2 * k + 2] = (farther(value, each, more) for each in interval.bounds(k))
        low, high = (share * math.exp(each.real) for each in bounds[2:])
        return [complex(z[0]), *bounds[:2], share, low, high, rate]

    every = torch.full((7, len(frequency)), complex(math.nan, math.nan), dtype=torch.complex128)
    for i, f in enumerate(frequency.tolist()):
        if bool(torch.isfinite(pressures.pressure[0, i].abs())):
            found = matched(i)
            if isinstance(found, str):
                notes.append(Note("level-matched", f"{name}: no level-matched answer at {f:g} Hz: {found}"))
            else:
                every[:, i] = torch.tensor(found, dtype=torch.complex128)
    (z, low, high), (share, least, most, rate) = every[:3], every[3:].real
    return LevelMatched(z, low, high, share, least, most, rate, chosen.level_uncertainty), notes


def farther(value: complex, bound: complex, more: complex) -> complex:
    """A bound moved out by another error, R and X apart: the root of the sum of squares."""
    pairs = zip((value.real, value.imag), (bound.real, bound.imag), (more.real, more.imag), strict=True)
    return complex(*(own + math.copysign(math.hypot(end - own, away), end - own) for own, end, away in pairs))
