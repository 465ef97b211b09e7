r"""Level check: does the educed impedance, with the measured velocity, give the pressure that is known?

V is the phase-locked velocity into the liner at the tone, averaged over a cell or over all. At normal incidence the
waves are plane, so V is moved from the height y of the data to the wall, :math:`V_0 = V/(\cos ky + j Z \sin ky)`, and

.. math:: |p_i| = \rho c |Z + 1| |V_0|/2, \qquad p = \rho c Z V_0

are the incident wave and the pressure at the wall; one cell among unlike ones has the pressure of all of them above it,
:math:`|p_i| = \rho c |Z V_0 + \langle V_0 \rangle|/2`. At grazing incidence the field above the wall is not known
beforehand: V stays as measured, the pressure is that at the wall, and V of several cells is averaged after its phase
was turned back by that wavenumber along x which makes the mean largest.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, index_of_frequency
from torchliner.conversions import impedance_from_reflection, pressure_amplitude_from_spl
from torchliner.engine.intervals import ITSELF, jackknife
from torchliner.engine.moments import Moments
from torchliner.engine.tones import segment_amplitudes
from torchliner.fluid import Fluid
from torchliner.records import MicrophoneLine, PressureRecord
from torchliner.records.case import require_same_run
from torchliner.records.cells import sort_into_cells
from torchliner.records.level_check import UNKNOWN, LevelCheck, level_check_of
from torchliner.records.notes import Note
from torchliner.velocity.averages import Averages
from torchliner.velocity.choices import Choices

INCIDENT, WALL = "incident", "wall"
SAME_TIMES = 0.01  # of the duration: beyond, phases belong to different times
NO_TONE = 1e-9  # of the rms velocity: a tone below it is rounding
WAVENUMBERS = 241  # tried along x, up to three times that of sound
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
    height: Any = None  # from which the velocity is moved to the wall, m, a number or (1 + C, 1); None: no plane waves

    def ratio(self, z: Tensor, velocity: Tensor) -> Tensor:
        """Implied over known pressure, (..., 1 + C, F), the whole plane first, or of that alone, (..., 1, F): of
        impedances and of velocities into the liner (m/s) of this shape."""
        height = 0.0 if self.height is None else self.height
        angle = 2 * torch.pi * self.frequency / float(self.fluid.sound_speed) * height
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
    ends = torch.stack(bounds, 1) if len(bounds) == len(ratios) else None
    about = {"averagings": tuple(found), "averaging": averaging, "known": known.words, "kind": known.kind}
    check = level_check_of(torch.stack(ratios), ends, known.has_phase, known.pressure[0], chosen, **about)
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

    ``given``: ``PressureRecord`` of the same run with a facesheet, or ``MicrophoneLine`` along the wall; None: the
    level that the plane states.
    """
    plane, height = moments.plane, moments.plane.height or 0.0
    if isinstance(given, PressureRecord):
        require_same_run(plane, given)
        return _of_record(moments, frequency, given)
    if given is None:
        found = stated_pressure(plane, frequency, plane.frequency)
        if isinstance(found, str):
            return found
        kind, words, pressure = found
        moved = height if kind == INCIDENT else None
        every = pressure.expand(1 + moments.membership.count, -1)
        return KnownPressure(plane.fluid, frequency, kind, words, every, height=moved)
    if not isinstance(given, MicrophoneLine):
        raise TypeError(f"pressure is {type(given).__name__}; a PressureRecord or a MicrophoneLine is needed")
    # The logarithm of the level along the wall, interpolated to the middle of each cell.
    x = moments.cells.x
    if not bool(torch.isfinite(x).all()):
        raise ValueError(f"{plane.name} states no x; {given.name} cannot be put beside it")
    logarithm = torch.full((len(x), len(frequency)), torch.nan, dtype=torch.float64)
    for f, hertz in enumerate(frequency.tolist()):
        if (index := index_of_frequency(given.frequency, hertz)) is not None:
            level = given.pressure[..., index].abs().log().numpy()
            places = np.interp(x.numpy(), given.x.numpy(), level, left=np.nan, right=np.nan)
            logarithm[:, f] = torch.from_numpy(places)
    if not bool(torch.isfinite(logarithm).any()):
        return OTHER_TONE
    levels = torch.cat([logarithm.mean(0, keepdim=True), logarithm]).exp().to(torch.complex128)
    moved, words = height if plane.source_side == "normal" else None, "microphones along the wall (rho c |Z| |V|)"
    return KnownPressure(plane.fluid, frequency, WALL, words, levels, height=moved)


def stated_pressure(record: Any, frequency: Tensor, tone: float | None) -> tuple[str, str, Tensor] | str:
    """Kind, words and peak amplitude (Pa, nan off the tone) of a record's ``incident_level``, or why there is none.

    ``tone``: of the level, Hz; None: the frequency itself, if it is one.
    """
    level, side = record.incident_level, record.source_side
    if side == "none" or level is None or side == "unknown":
        return NO_SOUND if side == "none" else UNKNOWN if level is None else NO_SIDE
    tone = tone or (float(frequency[0]) if len(frequency) == 1 else math.nan)
    same = (frequency / tone - 1).abs() < SAME_FREQUENCY
    if not bool(same.any()):
        return OTHER_TONE
    pressure = torch.where(same, pressure_amplitude_from_spl(float(level)), torch.nan).to(torch.complex128)
    if side == "normal":
        words = f"the stated {level:.4g} dB of the incident wave (normal incidence, rho c |Z + 1| |V|/2)"
        return INCIDENT, words, pressure
    return WALL, f"the stated {level:.4g} dB at the wall (grazing incidence, rho c |Z| |V|)", pressure


def _of_record(moments: Moments, frequency: Tensor, record: PressureRecord) -> KnownPressure:
    """The pressure of the facesheet."""
    plane, cells = moments.plane, moments.cells
    if record.facesheet is None:
        raise ValueError(f"{record.name} holds no pressure of the facesheet, which a level check needs")
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
