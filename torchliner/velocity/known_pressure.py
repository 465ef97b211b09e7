"""Pressures that are known besides the velocity: stated levels, records, microphones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, index_of_frequency
from torchliner.conversions import pressure_amplitude_from_spl
from torchliner.engine.blocks import Blocks, waves
from torchliner.engine.intervals import replicates
from torchliner.engine.moments import Moments
from torchliner.pressure.plane_waves import split_waves
from torchliner.records import MicrophoneLine, PressureRecord
from torchliner.records.cells import sort_into_cells
from torchliner.records.level_check import UNKNOWN
from torchliner.records.same_case import require_same_run
from torchliner.tones import segment_amplitudes

INCIDENT, WALL = "incident", "wall"
SAME_TIMES = 0.01  # of the duration: beyond, phases belong to different times
NO_SIDE = (
    "not checked, state source_side: normal makes incident_level that of the incident wave, "
    "upstream or downstream that of the pressure at the wall"
)
NO_SOUND = "not checked, since source_side states that there is no sound"
OTHER_TONE = "not checked, since nothing is known at the frequencies asked for"


@dataclass(frozen=True, eq=False)
class KnownPressure:
    """Complex peak amplitudes at y = 0, Pa; nan at frequencies where nothing is known.

    Args:
        moments: of the plane that they are put beside.
        frequency: Hz, (F,).
        kind: ``incident`` (of the incident wave) or ``wall`` (of the pressure itself).
        words: what it is, and what it is compared with.
        liner: (F,).
        cells: (C, F); or (F,), the same above all.
        has_phase: whether the phase is on the clock of the velocity.
        moved: whether the velocity can be moved from its height to the wall: plane waves at normal incidence.
        replicates: of the pressure over its value, from all blocks of the record and without each of them,
            (1 + S, 1 + C, F), the liner first; None for what is stated.
    """

    moments: Moments
    frequency: Tensor
    kind: str
    words: str
    liner: Tensor
    cells: Tensor
    has_phase: bool = False
    moved: bool = False
    replicates: Tensor | None = None

    @property
    def height(self) -> float:
        """From which the velocity is moved to the wall, m."""
        return (self.moments.plane.height or 0.0) if self.moved else 0.0

    @property
    def places(self) -> Tensor:
        """Of the liner, then of each cell, (1 + C, F)."""
        return torch.cat([self.liner[None], self.cells.expand(self.moments.cells.count, -1)])


def known_pressure(moments: Moments, frequency: Tensor, given: Any = None) -> KnownPressure | str:
    """What is known of a plane's sound at frequencies in Hz, (F,), or why nothing is compared.

    Args:
        moments: of the plane.
        frequency: Hz, (F,).
        given: ``PressureRecord`` of the same run (facesheet, or microphones in front of the surface) or
            ``MicrophoneLine`` along the wall; None: the level that the plane states.
    Raises:
        TypeError: something else is given.
        ValueError: the record is of another case, or cannot be compared with this plane; the message says why.
    """
    plane = moments.plane
    if isinstance(given, MicrophoneLine):
        return _of_line(moments, frequency, given)
    if isinstance(given, PressureRecord):
        require_same_run(plane, given)
        return _of_record(moments, frequency, given)
    if given is not None:
        raise TypeError(f"pressure is {type(given).__name__}; a PressureRecord or a MicrophoneLine is needed")
    found = stated_pressure(plane, frequency, plane.frequency)
    if isinstance(found, str):
        return found
    kind, words, pressure = found
    return KnownPressure(moments, frequency, kind, words, pressure, pressure, moved=kind == INCIDENT)


def stated_pressure(record: Any, frequency: Tensor, tone: float | None) -> tuple[str, str, Tensor] | str:
    """Kind, words and peak amplitude (Pa, nan off the tone) of a level, or why there is none.

    Args:
        record: with ``incident_level`` and ``source_side``.
        frequency: Hz, (F,).
        tone: of the level, Hz; None: the frequency itself, if it is one.
    """
    level, side = record.incident_level, record.source_side
    if side == "none":
        return NO_SOUND
    if level is None:
        return UNKNOWN
    if side == "unknown":
        return NO_SIDE
    tone = tone or (float(frequency[0]) if len(frequency) == 1 else math.nan)
    same = (frequency / tone - 1).abs() < SAME_FREQUENCY
    if not bool(same.any()):
        return OTHER_TONE
    pressure = torch.where(same, pressure_amplitude_from_spl(float(level)), torch.nan)
    kind, words = WALL, f"the stated {level:.4g} dB at the wall (grazing incidence, rho c |Z| |V|)"
    if side == "normal":
        kind = INCIDENT
        words = f"the stated {level:.4g} dB of the incident wave (normal incidence, rho c |Z + 1| |V|/2)"
    return kind, words, pressure.to(torch.complex128)


def _of_record(moments: Moments, frequency: Tensor, record: PressureRecord) -> KnownPressure:
    """The pressure of the facesheet, or incident plus reflected wave at y = 0 from microphones in front of it."""
    plane, rate = moments.plane, record.sampling_rate
    after = plane.start - record.start
    same_times = abs(record.duration / plane.duration - 1) < SAME_TIMES and abs(after) < plane.duration
    # A phasor of the record becomes one of the plane.
    turn = 2 * torch.exp(2j * torch.pi * frequency * (after if same_times else 0.0))
    phase, normal = f"{'with' if same_times else 'without'} phase", plane.source_side == "normal"
    if record.facesheet is not None:
        signals = _cell_pressures(moments, record)
        peak, left = turn * segment_amplitudes(signals, frequency, rate)[0], None
        if signals.shape[-1] == plane.samples and abs(rate / plane.sampling_rate - 1) < 1e-9:
            left = _replicates(moments.survey.blocks, frequency, signals, rate)
            left = torch.cat([left[:, :1], left[:, 1:].expand(-1, moments.cells.count, -1)], dim=1)
        words = f"the facesheet's pressure (rho c Z V, {phase})"
        return KnownPressure(moments, frequency, WALL, words, peak[0], peak[1:], same_times, normal, left)
    if record.microphones is None or len(record.microphones) < 2:
        raise ValueError(
            f"{record.name} holds one microphone alone; a level check needs the facesheet's pressure or two microphones"
        )
    if plane.source_side not in ("normal", "unknown"):
        raise ValueError(
            f"{record.name}: its microphones stand for a wave at normal incidence, but the sound of {plane.name} comes "
            f"from {plane.source_side}; give the facesheet's pressure or microphones along the wall"
        )
    amplitude = segment_amplitudes(record.microphones, frequency, rate)[0]
    speed, mach = record.fluid.sound_speed, record.microphone_mach
    whole = turn * split_waves(amplitude, record.microphone_y, frequency, speed, mach)[0].sum(0)
    words = f"the sum of incident and reflected wave from microphones (rho c Z V, {phase})"
    return KnownPressure(moments, frequency, WALL, words, whole, whole, same_times, moved=True)


def _cell_pressures(moments: Moments, record: PressureRecord) -> Tensor:
    """Mean over the whole facesheet, then over each cell of the plane, (1 + C, T), or the mean again, (2, T), where the
    record's cells are not the plane's."""
    face = record.facesheet.reshape(record.probes, -1).to(torch.float64)
    mean = face.mean(0, keepdim=True)
    cells, own = moments.cells, sort_into_cells(record, moments.cell_pitch)
    near = 0.1 * (moments.cell_pitch or 0.0)
    places = ((own.x, cells.x), (own.z, cells.z))
    same = own.count == cells.count and all(bool(torch.nan_to_num(a - b).abs().max() <= near) for a, b in places)
    return torch.cat([mean, own.average(face, own.labels >= 0) if same else mean])


def _of_line(moments: Moments, frequency: Tensor, line: MicrophoneLine) -> KnownPressure | str:
    """Level along the wall, its logarithm interpolated to the middle of each cell."""
    x = moments.cells.x
    if not bool(torch.isfinite(x).all()):
        raise ValueError(f"{moments.plane.name} states no x; {line.name} cannot be put beside it")
    logarithm = torch.full((len(x), len(frequency)), torch.nan, dtype=torch.float64)
    for f, hertz in enumerate(frequency.tolist()):
        index = index_of_frequency(line.frequency, hertz)
        if index is not None:
            level = line.pressure[..., index].abs().log()
            found = np.interp(x.numpy(), line.x.numpy(), level.numpy(), left=np.nan, right=np.nan)
            logarithm[:, f] = torch.from_numpy(found)
    if not bool(torch.isfinite(logarithm).any()):
        return OTHER_TONE
    mean, cells = (each.exp().to(torch.complex128) for each in (logarithm.mean(0), logarithm))
    words = "microphones along the wall (rho c |Z| |V|)"
    return KnownPressure(moments, frequency, WALL, words, mean, cells, moved=moments.plane.source_side == "normal")


def _replicates(blocks: Blocks, frequency: Tensor, signals: Tensor, rate: float) -> Tensor:
    """Lines of (n, T) at the times of the plane, from all blocks and without each, over the former."""
    steady = signals - signals.mean(-1, keepdim=True)
    sums = [steady[:, low:high] @ waves(frequency, rate, low, high)[1:].T for low, high in pairwise(blocks.borders)]
    left = replicates(torch.stack([torch.complex(*each.chunk(2, 1)).conj() for each in sums]), blocks.lengths)
    return left / left[:1]
