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
from torchliner.engine.blocks import waves
from torchliner.engine.intervals import replicates
from torchliner.engine.moments import Moments
from torchliner.pressure.plane_waves import split_waves
from torchliner.records import MicrophoneLine, PressureRecord
from torchliner.records.case import require_same_run
from torchliner.records.cells import sort_into_cells
from torchliner.records.level_check import UNKNOWN
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
        moments, frequency: what they are put beside, and at which Hz, (F,).
        kind, words: ``incident`` (of the incident wave) or ``wall`` (of the pressure itself); what it is compared with.
        liner, cells: (F,), and (C, F) or the same above all, (F,).
        has_phase: whether the phase is on the clock of the velocity.
        height: from which the velocity is moved to the wall, m; None where it cannot be: no plane waves.
        replicates: of a recorded pressure over its value, from all blocks and without each, (B, 1 + C, F), liner first.
    """

    moments: Moments
    frequency: Tensor
    kind: str
    words: str
    liner: Tensor
    cells: Tensor
    has_phase: bool = False
    height: float | None = None
    replicates: Tensor | None = None


def known_pressure(moments: Moments, frequency: Tensor, given: Any = None) -> KnownPressure | str:
    """What is known of a plane's sound at frequencies in Hz, (F,), or why nothing is compared.

    ``given``: ``PressureRecord`` of the same run (facesheet, or microphones in front of the surface) or
    ``MicrophoneLine`` along the wall; None: the level that the plane states.

    Raises:
        TypeError, ValueError: something else is given, or of another case, or what cannot be compared with this plane.
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
        return KnownPressure(moments, frequency, kind, words, pressure, pressure, height=moved)
    if not isinstance(given, MicrophoneLine):
        raise TypeError(f"pressure is {type(given).__name__}; a PressureRecord or a MicrophoneLine is needed")
    # The logarithm of the level along the wall, interpolated to the middle of each cell.
    x = moments.cells.x
    if not bool(torch.isfinite(x).all()):
        raise ValueError(f"{plane.name} states no x; {given.name} cannot be put beside it")
    logarithm = torch.full((len(x), len(frequency)), torch.nan, dtype=torch.float64)
    for f, hertz in enumerate(frequency.tolist()):
        index = index_of_frequency(given.frequency, hertz)
        if index is not None:
            level = given.pressure[..., index].abs().log().numpy()
            places = np.interp(x.numpy(), given.x.numpy(), level, left=np.nan, right=np.nan)
            logarithm[:, f] = torch.from_numpy(places)
    if not bool(torch.isfinite(logarithm).any()):
        return OTHER_TONE
    mean, cells = (each.exp().to(torch.complex128) for each in (logarithm.mean(0), logarithm))
    moved, words = height if plane.source_side == "normal" else None, "microphones along the wall (rho c |Z| |V|)"
    return KnownPressure(moments, frequency, WALL, words, mean, cells, height=moved)


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
    """The pressure of the facesheet, or incident plus reflected wave at y = 0 from microphones in front of it."""
    plane, rate, cells, blocks = moments.plane, record.sampling_rate, moments.cells, moments.survey.blocks
    after, side, height = plane.start - record.start, plane.source_side, plane.height or 0.0
    same_times = abs(record.duration / plane.duration - 1) < SAME_TIMES and abs(after) < plane.duration
    # A phasor of the record becomes one of the plane.
    turn = 2 * torch.exp(2j * torch.pi * frequency * (after if same_times else 0.0))
    phase = f"{'with' if same_times else 'without'} phase"
    if record.facesheet is not None:
        face = record.facesheet.reshape(record.probes, -1).to(torch.float64)
        mean, own = face.mean(0, keepdim=True), sort_into_cells(record, moments.cell_pitch)
        near, places = 0.1 * (moments.cell_pitch or 0.0), ((own.x, cells.x), (own.z, cells.z))
        same = own.count == cells.count and all(bool(torch.nan_to_num(a - b).abs().max() <= near) for a, b in places)
        # Where the record's cells are not the plane's, the mean stands for each.
        signals = torch.cat([mean, own.average(face, own.labels >= 0) if same else mean])
        peak, left = turn * segment_amplitudes(signals, frequency, rate)[0], None
        if signals.shape[-1] == plane.samples and abs(rate / plane.sampling_rate - 1) < 1e-9:
            steady = signals - signals.mean(-1, keepdim=True)
            pairs = pairwise(blocks.borders)
            sums = [steady[:, low:high] @ waves(frequency, rate, low, high)[1:].T for low, high in pairs]
            lines = torch.stack([torch.complex(*each.chunk(2, 1)).conj() for each in sums])
            left = replicates(lines, blocks.lengths)
            left = left / left[:1]
            left = torch.cat([left[:, :1], left[:, 1:].expand(-1, cells.count, -1)], dim=1)
        words, moved = f"the facesheet's pressure (rho c Z V, {phase})", height if side == "normal" else None
        return KnownPressure(moments, frequency, WALL, words, peak[0], peak[1:], same_times, moved, left)
    if record.microphones is None or len(record.microphones) < 2:
        raise ValueError(
            f"{record.name} holds one microphone alone; a level check needs the facesheet's pressure or two microphones"
        )
    if side not in ("normal", "unknown"):
        raise ValueError(
            f"{record.name}: its microphones stand for a wave at normal incidence, but the sound of {plane.name} comes "
            f"from {side}; give the facesheet's pressure or microphones along the wall"
        )
    amplitude = segment_amplitudes(record.microphones, frequency, rate)[0]
    speed, mach = record.fluid.sound_speed, record.microphone_mach
    whole = turn * split_waves(amplitude, record.microphone_y, frequency, speed, mach)[0].sum(0)
    words = f"the sum of incident and reflected wave from microphones (rho c Z V, {phase})"
    return KnownPressure(moments, frequency, WALL, words, whole, whole, same_times, height)
