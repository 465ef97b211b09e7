"""Pressures that are known besides the velocity: stated levels, records, microphones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, index_of_frequency
from torchliner.conversions import pressure_amplitude_from_spl
from torchliner.engine.blocks import Blocks, waves
from torchliner.engine.intervals import replicates
from torchliner.pressure.plane_waves import split_waves
from torchliner.records import MicrophoneLine, PressureRecord, VelocityPlane
from torchliner.records.cells import Cells, sort_into_cells
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
class Case:
    """What a known pressure is put beside.

    Args:
        plane: with all that is stated of it.
        frequency: Hz, (F,).
        cells: of the plane.
        cell_pitch: of the liner, m.
        blocks: of the record.
    """

    plane: VelocityPlane
    frequency: Tensor
    cells: Cells
    cell_pitch: float | None
    blocks: Blocks


@dataclass(frozen=True, eq=False)
class KnownPressure:
    """Complex peak amplitudes at y = 0, Pa; nan at frequencies where nothing is known.

    Args:
        kind: ``incident`` (of the incident wave) or ``wall`` (of the pressure itself).
        words: what it is, and what it is compared with.
        liner, cells: (F,) and (C, F).
        has_phase: whether the phase is on the clock of the velocity.
        moved: whether the velocity can be moved from its height to the wall: plane waves at normal
            incidence.
        replicates: of the pressure over its value, from all blocks of the record and without each of them,
            (1 + S, 1 + C, F), the liner first; None for what is stated.
    """

    kind: str
    words: str
    liner: Tensor
    cells: Tensor
    has_phase: bool
    moved: bool
    replicates: Tensor | None = None


def known_pressure(case: Case, given: Any = None) -> KnownPressure | str:
    """What is known of a plane's sound, or why nothing is compared.

    Args:
        case: the plane and what is asked of it.
        given: ``PressureRecord`` of the same run (facesheet, or microphones in front of the
            surface) or ``MicrophoneLine`` along the wall; None: the level that the plane states.
    Raises:
        TypeError: something else is given.
        ValueError: the record is of another case, or cannot be compared with this plane; the
            message says why.
    """
    if isinstance(given, MicrophoneLine):
        return _of_line(case, given)
    if isinstance(given, PressureRecord):
        require_same_run(case.plane, given)
        return _of_record(case, given)
    if given is not None:
        raise TypeError(f"pressure is {type(given).__name__}; a PressureRecord or a MicrophoneLine is needed")
    return _stated(case)


def _stated(case: Case) -> KnownPressure | str:
    plane = case.plane
    found = stated_pressure(plane, case.frequency, plane.frequency)
    if isinstance(found, str):
        return found
    kind, words, pressure = found
    cells = pressure.expand(case.cells.count, -1)
    return KnownPressure(kind, words, pressure, cells, False, kind == INCIDENT)


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


def _of_record(case: Case, record: PressureRecord) -> KnownPressure:
    plane, frequency = case.plane, case.frequency
    turn, same_times = _turn(case, record)
    if record.facesheet is not None:
        signals, words = _cell_pressures(case, record), "the facesheet's pressure"
    elif record.microphones is not None and len(record.microphones) > 1:
        if plane.source_side not in ("normal", "unknown"):
            raise ValueError(
                f"{record.name}: its microphones stand for a wave at normal incidence, but the "
                f"sound of {plane.name} comes from {plane.source_side}; give the facesheet's "
                "pressure or microphones along the wall"
            )
        return _of_waves(case, record, turn, same_times)
    else:
        raise ValueError(
            f"{record.name} holds one microphone alone; closure needs the facesheet's pressure or two microphones"
        )
    own = 2 * segment_amplitudes(signals, frequency, record.sampling_rate)[0]
    peak = turn * own
    cells = peak[1:].expand(case.cells.count, -1)
    left = _replicates(case, signals, record.sampling_rate)
    if left is not None:
        left = torch.cat([left[:, :1], left[:, 1:].expand(-1, case.cells.count, -1)], dim=1)
    words = f"{words} (rho c Z V, {'with' if same_times else 'without'} phase)"
    return KnownPressure(WALL, words, peak[0], cells, same_times, plane.source_side == "normal", left)


def _turn(case: Case, record: PressureRecord) -> tuple[Tensor, bool]:
    """e^{j omega t} over the time from the record's first sample to the plane's, (F,), which makes
    a phasor of the record one of the plane; whether they are of the same times."""
    plane = case.plane
    after = plane.start - record.start
    alike = abs(record.duration / plane.duration - 1) < SAME_TIMES and abs(after) < plane.duration
    return torch.exp(2j * torch.pi * case.frequency * (after if alike else 0.0)), alike


def _cell_pressures(case: Case, record: PressureRecord) -> Tensor:
    """Mean over the whole facesheet, then over each cell of the plane: (1 + C, T).

    Where the record's cells are not the plane's, one more row alone, the mean again.
    """
    face = record.facesheet.reshape(record.probes, -1).to(torch.float64)
    mean = face.mean(0, keepdim=True)
    cells, own = case.cells, sort_into_cells(record, case.cell_pitch)
    pitch = case.cell_pitch or 0.0
    alike = own.count == cells.count and all(
        bool(torch.nan_to_num(a - b).abs().max() <= 0.1 * pitch) for a, b in ((own.x, cells.x), (own.z, cells.z))
    )
    if not alike:
        return torch.cat([mean, mean])
    return torch.cat([mean, own.average(face, own.labels >= 0)])


def _of_waves(case: Case, record: PressureRecord, turn: Tensor, same_times: bool) -> KnownPressure:
    """Incident plus reflected wave at y = 0, from microphones in front of the surface."""
    frequency, rate = case.frequency, record.sampling_rate
    amplitude = segment_amplitudes(record.microphones, frequency, rate)[0]
    split, _, _ = split_waves(
        amplitude, record.microphone_y, frequency, record.fluid.sound_speed, record.microphone_mach
    )
    peak = 2 * turn * split.sum(0)
    words = (
        "the sum of incident and reflected wave from microphones (rho c Z V, "
        f"{'with' if same_times else 'without'} phase)"
    )
    cells = peak.expand(case.cells.count, -1)
    return KnownPressure(WALL, words, peak, cells, same_times, True)


def _of_line(case: Case, line: MicrophoneLine) -> KnownPressure | str:
    """Level along the wall, its logarithm interpolated to the middle of each cell."""
    x, frequency = case.cells.x, case.frequency
    if not bool(torch.isfinite(x).all()):
        raise ValueError(f"{case.plane.name} states no x; {line.name} cannot be put beside it")
    columns = []
    for f in frequency.tolist():
        index = index_of_frequency(line.frequency, f)
        if index is None:
            columns.append(torch.full_like(x, torch.nan))
            continue
        level = line.pressure.abs()[..., index].log()
        right = torch.searchsorted(line.x, x).clamp(1, len(line.x) - 1)
        before, after = line.x[right - 1], line.x[right]
        share = (x - before) / (after - before)
        inside = (x >= line.x[0]) & (x <= line.x[-1])
        found = level[right - 1] + share * (level[right] - level[right - 1])
        columns.append(torch.where(inside, found, torch.nan))
    logarithm = torch.stack(columns, -1)
    if not bool(torch.isfinite(logarithm).any()):
        return OTHER_TONE
    cells = logarithm.exp().to(torch.complex128)
    words = "microphones along the wall (rho c |Z| |V|)"
    mean = logarithm.mean(0).exp().to(torch.complex128)
    return KnownPressure(WALL, words, mean, cells, False, case.plane.source_side == "normal")


def _replicates(case: Case, signals: Tensor, rate: float) -> Tensor | None:
    """Lines of (n, T) from all blocks and without each, over the former; None where the times are not the plane's."""
    plane, blocks = case.plane, case.blocks
    if signals.shape[-1] != plane.samples or abs(rate / plane.sampling_rate - 1) >= 1e-9:
        return None
    steady = signals - signals.mean(-1, keepdim=True)
    count, sums = len(case.frequency), []
    for begin, end in pairwise(blocks.borders):
        found = steady[:, begin:end].to(torch.float64) @ waves(case.frequency, rate, begin, end)[1:].T
        sums.append(torch.complex(found[:, :count], -found[:, count:]))
    left = replicates(torch.stack(sums), blocks.lengths)
    return left / left[:1]
