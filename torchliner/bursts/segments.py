"""Bursts of a station on a uniform grid, the tone corrected, cut into overlapping segments side by side like probes."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.bursts.arrivals import ArrivalGrid, GridSignal, gridded
from torchliner.bursts.choices import StationChoices
from torchliner.bursts.tone_damping import DAMPED, ToneAttenuation, attenuation_on, corrected_coherent_part
from torchliner.checks import SAME_FREQUENCY
from torchliner.records import BurstRecord, VelocityPlane

FEWEST_SEGMENTS, MOST_SEGMENTS = 2, 5000


@dataclass(frozen=True, eq=False)
class Segments:
    """A station cut into S overlapping segments.

    Args:
        plane: a probe a segment, (S, n): a view of ``signal``.
        signal: the station on its grid, the tone corrected if that was asked for.
        start: of each segment on the clock of the arrivals, s, (S,).
        hop: samples from one segment to the next.
        attenuation: factor on a tone over the whole record, complex128, (F,).
        corrected: frequencies whose tone was corrected, bool, (F,).
        notes: warnings, with numbers.
    """

    plane: VelocityPlane
    signal: GridSignal
    start: Tensor
    hop: int
    attenuation: Tensor
    corrected: Tensor
    notes: tuple[str, ...]


def cut_into_segments(record: BurstRecord, frequency: Tensor, choices: StationChoices) -> Segments:
    """Validated bursts onto a grid, the tone corrected, cut into segments.

    Raises:
        ValueError: no wall-normal velocity, a record shorter than two segments, a gap longer than a segment, fewer than
            two arrivals a period, a tone damped below 0.3.
    """
    name = record.name
    if record.wall_normal is None:
        raise ValueError(
            f"{name} holds no wall-normal velocity, only streamwise; say which channel measures it, e.g. components = "
            "-wall_normal"
        )
    method, tone = choices.method, record.frequency or float(frequency.max())
    bursts = record.arrival_time, record.wall_normal
    signal = gridded(*bursts, choices.grid_rate, method, tone, choices.band_limit, name)
    grid = signal.grid
    length = round(choices.segment * grid.rate)
    hop = max(1, int((1 - choices.overlap) * length + 1e-9))
    count = 1 + (grid.samples - length) // hop
    _require_segments(grid, count, choices, name)
    damping, corrected = _damping(record, grid, frequency, choices)
    notes = [*record.notes, *signal.notes, *damping.doubts(name, corrected)]
    if bool(corrected.any()):
        noise = choices.correction == "tone-and-noise"
        signal = corrected_coherent_part(signal, damping.select(corrected), noise=noise, name=name)
    left = float(damping.factor[-1].abs())
    if len(corrected) > len(frequency) and left < DAMPED:
        notes.append(
            f"the stated tone of {record.frequency:g} Hz, of which {method} reconstruction leaves {left:.3f}, "
            "is corrected: it drives |v| at all frequencies"
        )
    plane = VelocityPlane(
        signal.values.unfold(0, length, hop),
        sampling_rate=grid.rate,
        frequency=record.frequency,
        fluid=record.fluid,
        incident_level=record.incident_level,
        mach=record.mach,
        source_side=record.source_side,
        liner=record.liner,
        height=record.y if record.y is not None and record.y > 0 else None,
        displacement_thickness=record.displacement_thickness,
        name=name,
    )
    start = grid.start + hop * torch.arange(count, dtype=torch.float64) / grid.rate
    asked = slice(len(frequency))
    return Segments(plane, signal, start, hop, damping.factor[asked], corrected[asked], tuple(notes))


def _require_segments(grid: ArrivalGrid, count: int, choices: StationChoices, name: str) -> None:
    """Two segments, no more than memory holds, no gap longer than a segment."""
    lasts, bursts = float(grid.arrival_times[-1]) - grid.start, len(grid.arrival_times)
    of = f"of {choices.segment:g} s with an overlap of {choices.overlap:g}"
    if count < FEWEST_SEGMENTS:
        needed = (1 + (FEWEST_SEGMENTS - 1) * (1 - choices.overlap)) * choices.segment
        raise ValueError(
            f"{name}: {bursts} bursts over {lasts:.4g} s; two segments {of} take {needed:.4g} s. Measure longer, or "
            "shorten the segment"
        )
    if count > MOST_SEGMENTS:
        raise ValueError(
            f"{name}: {lasts:.4g} s hold {count} segments {of} (limit: {MOST_SEGMENTS}). Lower the overlap, or "
            "lengthen the segment"
        )
    gap, begin = grid.longest_gap
    if gap > choices.segment:
        raise ValueError(
            f"{name}: no burst for {gap:.4g} s from {begin:.6g} s on, longer than a segment of {choices.segment:g} s, "
            "which would be made up; cut the record there"
        )


def _damping(
    record: BurstRecord, grid: ArrivalGrid, frequency: Tensor, choices: StationChoices
) -> tuple[ToneAttenuation, Tensor]:
    """Of the frequencies asked for, and which are corrected, bool.

    The stated tone is corrected whatever is asked for, since it drives |v| at all frequencies: where it is not among
    them it stands behind them. Without a stated tone a single frequency asked for is one.
    """
    tone, tones = record.frequency, frequency
    if tone is None and len(frequency) == 1:
        tone = float(frequency)
    corrected = torch.zeros_like(frequency, dtype=torch.bool)
    if tone is not None and choices.correction != "none":
        if not bool(((frequency / tone - 1).abs() < SAME_FREQUENCY).any()):
            tones = torch.cat([frequency, frequency.new_tensor([tone])])
        corrected = (tones / tone - 1).abs() < SAME_FREQUENCY
    try:
        return attenuation_on(grid, tones, "hann", record.name), corrected
    except ValueError as error:
        if int(tones.argmax()) < len(frequency):
            raise
        raise ValueError(
            f"{error}. The stated tone of {tone:g} Hz is corrected whatever is asked for; correction='none' leaves it "
            "as it is"
        ) from None
