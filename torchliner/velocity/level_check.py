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
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.conversions import impedance_from_reflection, pressure_amplitude_from_spl, spl_from_pressure_amplitude
from torchliner.engine.drives import phase_locked
from torchliner.engine.intervals import ITSELF, jackknife
from torchliner.engine.moments import Moments
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
STEP = 0.02  # in the logarithm of the share, for slopes
NOTHING = complex(math.nan, math.nan)
PER_NEPER = 20 / math.log(10)
NO_SIDE = "not checked, state source_side: with normal, incident_level is that of the wave, else that at the wall"
NO_SOUND = "not checked, since source_side states that there is no sound"
OTHER_TONE = "not checked, since nothing is known at the frequencies asked for"


@dataclass(frozen=True, eq=False)
class KnownPressure:
    """Complex peak amplitudes at y = 0, Pa, nan at frequencies where nothing is known, beside those of the velocity."""

    moments: Moments
    frequency: Tensor  # Hz, (F,)
    kind: str  # ``incident`` (of the incident wave) or ``wall`` (of the pressure itself)
    words: str  # what it is compared with
    pressure: Tensor  # of the whole plane and of each cell, (1 + C, F)
    has_phase: bool = False  # whether the phase is on the clock of the velocity
    height: float | None = None  # from which the velocity is moved to the wall, m; None: no plane waves

    @cached_property
    def velocity(self) -> Tensor:
        """Into the liner, m/s, as of ``replicates``, (B, 1 + C, F), the whole plane first; nan without a tone. Where
        waves run along x it is averaged over cells with that wavenumber turned back which makes the mean largest."""
        seen, members, cells = self.moments.survey, self.moments.membership, self.moments.cells
        found = -members.mean(seen.tone(self.frequency, every=True).transpose(1, 2)).transpose(1, 2).cpu()
        scale = members.mean(seen.mean_square).sqrt().cpu()
        found = torch.where(found.abs() <= NO_TONE * scale[:, None], torch.nan, found)
        weights = torch.ones_like(cells.x) if cells.weight is None else cells.weight
        weights = (weights / weights.sum())[:, None].to(found)
        if self.height is None:
            x = torch.nan_to_num(cells.x - cells.x.nanmean())[:, None]
            steps = torch.linspace(-3, 3, WAVENUMBERS, dtype=torch.float64)[:, None, None]
            turns = torch.exp(2j * torch.pi / float(self.moments.plane.fluid.sound_speed) * steps * x * self.frequency)
            best = (turns * torch.nan_to_num(found[0])).sum(1).abs().argmax(0)
            weights = weights * turns.gather(0, best.expand(1, len(x), -1))[0]
        return torch.cat([(weights * found).sum(1, keepdim=True), found], 1)

    def ratio(self, z: Tensor) -> Tensor:
        """Implied over known pressure at impedances of the whole plane and of each cell, or of the whole alone, of all
        blocks and without each, or of all alone: (B or 1, 1 + C or 1, F)."""
        fluid, velocity = self.moments.plane.fluid, self.velocity[: len(z), : z.shape[1]]
        angle = 2 * torch.pi * self.frequency / float(fluid.sound_speed) * (self.height or 0.0)
        at_wall = velocity / (angle.cos() + 1j * angle.sin() * z)
        implied = z * at_wall
        if self.kind == INCIDENT:
            implied = (implied + at_wall[:, :1]) / 2
        return float(fluid.characteristic_impedance) * implied / self.pressure[: z.shape[1]]


def known_pressure(moments: Moments, frequency: Tensor, given: Any = None) -> KnownPressure | str:
    """What is known of a plane's sound at frequencies in Hz, (F,), or why nothing is compared.

    ``given``: ``PressureRecord`` of the same run with a facesheet; None: the level that the plane states.
    """
    plane, level, side = moments.plane, moments.plane.incident_level, moments.plane.source_side
    if given is not None:
        return _of_record(moments, frequency, given)
    if side == "none" or level is None or side == "unknown":
        return NO_SOUND if side == "none" else UNKNOWN if level is None else NO_SIDE
    tone = plane.frequency or (float(frequency[0]) if len(frequency) == 1 else math.nan)
    same = (frequency / tone - 1).abs() < SAME_FREQUENCY
    if not bool(same.any()):
        return OTHER_TONE
    pressure = torch.where(same, pressure_amplitude_from_spl(float(level)), torch.nan).to(torch.complex128)[None]
    if side == "normal":
        words = f"the stated {level:.4g} dB of the incident wave (normal incidence, rho c |Z + 1| |V|/2)"
        return KnownPressure(moments, frequency, INCIDENT, words, pressure, height=plane.height or 0.0)
    words = f"the stated {level:.4g} dB at the wall (grazing incidence, rho c |Z| |V|)"
    return KnownPressure(moments, frequency, WALL, words, pressure)


def _of_record(moments: Moments, frequency: Tensor, record: Any) -> KnownPressure:
    """The pressure of the facesheet."""
    if not isinstance(record, PressureRecord) or record.facesheet is None:
        raise TypeError(f"pressure is {type(record).__name__}; a PressureRecord with a facesheet is needed")
    plane, cells, pitch = moments.plane, moments.cells, moments.cell_pitch
    require_same_run(plane, record)
    face, own = record.facesheet.reshape(record.probes, -1).to(torch.float64), sort_into_cells(record, pitch)
    signals, near, places = face.mean(0, keepdim=True), 0.1 * (pitch or 0.0), ((own.x, cells.x), (own.z, cells.z))
    if own.count == cells.count and all(bool(torch.nan_to_num(a - b).abs().max() <= near) for a, b in places):
        signals = torch.cat([signals, own.average(face, own.labels >= 0)])  # else the mean stands for each cell
    after = plane.start - record.start
    same_times = abs(record.duration / plane.duration - 1) < SAME_TIMES and abs(after) < plane.duration
    # A phasor of the record becomes one of the plane.
    turn = 2 * torch.exp(2j * torch.pi * frequency * (after if same_times else 0.0))
    peaks = turn * segment_amplitudes(signals, frequency, record.sampling_rate)[0]
    words = f"the facesheet's pressure (rho c Z V, {'with' if same_times else 'without'} phase)"
    moved = plane.height or 0.0 if plane.source_side == "normal" else None
    return KnownPressure(moments, frequency, WALL, words, peaks, same_times, moved)


def check_level(
    moments: Moments, frequency: Tensor, found: Mapping[str, Averages], chosen: Choices, averaging: str, pressure: Any
) -> tuple[LevelCheck | None, str, list[Note]]:
    """Of all averagings, with intervals where these have them, None where nothing is known; ``checked``, or why nothing
    is; a note for each frequency at which the answer, of ``averaging``, does not pass."""
    known, lengths = known_pressure(moments, frequency, pressure), moments.survey.lengths.cpu()
    if isinstance(known, str):
        return None, known, []
    every = (known.ratio(impedance_from_reflection(each.replicates.detach()).cpu()) for each in found.values())
    ratio = torch.stack(list(every), 1)  # (B, A, 1 + C, F)
    gap, level = ratio[:1].log(), chosen.interval if len(ratio) > 1 else None
    gap = torch.cat([gap, torch.full_like(gap.repeat(2, 1, 1, 1), NOTHING)])
    if level is not None:
        interval = jackknife((ratio / ratio[:1]).log(), lengths / lengths.sum(), level, ITSELF)
        gap[1:] = gap[:1] + torch.stack([interval.low, interval.high])
    decibels, degrees = PER_NEPER * gap.real, torch.rad2deg(gap.imag) + (0.0 if known.has_phase else math.nan)
    check = LevelCheck(
        averagings=tuple(found),
        averaging=averaging,
        known=known.words,
        kind=known.kind,
        pressure_level=spl_from_pressure_amplitude(known.pressure[0]),
        limit=chosen.level_limit + chosen.level_uncertainty,
        uncertainty=chosen.level_uncertainty,
        confidence=level,
        liner=Gap(*decibels[:, :, 0], *degrees[:, :, 0]),
        cells=Gap(*decibels[:, :, 1:], *degrees[:, :, 1:]),
    )
    texts = [check.sentence(averaging, f, i) for i, f in enumerate(frequency.tolist())]
    return check, "checked", [Note("level-check", f"{moments.plane.name}: {text}") for text in texts if text]


def match_level(
    reading: Reading, known: Moments, liner: LinerModel, pressure: object = None, reference_phase: object = None
) -> tuple[LevelMatched | None, list[Note]]:
    """Z at each frequency at which a pressure is known, and why there is none.

    ``reading`` is of a plane that still has its samples: each share that is tried reads them again; ``known`` is what
    it gave, ``liner``, ``pressure`` and ``reference_phase`` as of ``educe``.
    """
    from scipy.optimize import brentq  # takes a quarter of a second to import

    if known.locked is None:
        raise ValueError("level_matched scales what phase-locked averaging leaves; choose averaging='phase-locked'")
    chosen, frequency, lengths, notes = reading.chosen, reading.frequency, known.survey.lengths.cpu(), list[Note]()
    there, none = known_pressure(known, frequency, pressure), f"{known.plane.name}: no level-matched answer"
    if isinstance(there, str):
        return None, [Note("level-matched", f"{none}: {there}")]
    scale = torch.ones_like(known.survey.mean) if known.locked.scale is None else known.locked.scale
    fields = torch.full((3, 2, len(frequency)), NOTHING, dtype=torch.complex128)
    rates = fields[0, 0].real.clone()

    @cache
    def at(place: float) -> tuple[Tensor, Tensor]:
        """Z of the liner and level check, dB, of all blocks and without each, (B, F), by the share's logarithm."""
        drive = phase_locked(known.survey, known.membership, math.exp(place) * scale)
        moments = reading.with_drive(known, drive) if place else known
        found = average(moments, liner, frequency, chosen, "phase-locked", reference_phase)
        z = impedance_from_reflection(found.replicates[:, :1].detach()).cpu()
        return z[:, 0], PER_NEPER * there.ratio(z)[:, 0].abs().log()

    for i, f in enumerate(frequency.tolist()):

        def gap(place: float, i: int = i) -> float:
            return float(at(place)[1][0, i])

        if math.isnan(gap(0.0)):  # no pressure is known there
            continue
        end = math.log(RANGE[int(gap(0.0) < 0)])
        within = gap(0.0) * gap(end) <= 0
        place = float(brentq(gap, min(0.0, end), max(0.0, end), xtol=1e-5)) if within else 0.0
        rate = (gap(place + STEP) - gap(place)) / STEP  # dB by a factor e
        if rate < LEAST or not within:
            why = f"changes by {rate:.2g} dB by a factor e in the incoherent rms (limit {LEAST:g})"
            if rate >= LEAST:
                why = f"is still {gap(end):+.2f} dB with {math.exp(end):g} times that rms: the model or level is wrong"
            notes.append(Note("level-matched", f"{none} at {f:g} Hz: the level check {why}"))
            continue
        (z, level), beside = (each[:, i] for each in at(place)), at(place + STEP)[0][:, i]
        by, moved = (beside[0] - z[0]) / STEP, (level[0] - level) / rate  # the logarithm of each replicate's own share
        values = torch.stack([z + by * moved, place + moved.to(z)], 1)
        fields[0, :, i], rates[i] = values[0], rate
        if chosen.interval is not None and len(z) > 1:
            interval = jackknife(values, lengths / lengths.sum(), chosen.interval, ITSELF)
            away = torch.stack([by, torch.ones_like(by)]) * chosen.level_uncertainty / rate
            ends = torch.stack([interval.low, interval.high])
            # The two errors are independent: their squares add, of R, X and the share each.
            value, away, ends = map(torch.view_as_real, (values[0], away, ends))
            further = torch.copysign(torch.hypot(ends - value, away), ends - value)
            fields[1:, :, i] = torch.view_as_complex(value + further)
    (z, low, high), (share, least, most) = fields[:, 0], fields[:, 1].real.exp()
    return LevelMatched(z, low, high, share, least, most, rates, chosen.level_uncertainty), notes
