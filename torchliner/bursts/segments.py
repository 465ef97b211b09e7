"""Bursts of a station on a uniform grid, the tone corrected, cut into overlapping segments side by side like probes."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.bursts.arrivals import ArrivalGrid, GridSignal, checked_bursts
from torchliner.bursts.choices import StationChoices
from torchliner.bursts.tone_damping import corrected_coherent_part, tone_attenuation
from torchliner.checks import SAME_FREQUENCY
from torchliner.records import BurstRecord, VelocityPlane

FEWEST_SEGMENTS, MOST_SEGMENTS = 2, 5000
STATED = ("frequency", "fluid", "incident_level", "mach", "source_side", "liner", "displacement_thickness", "name")


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
        tone: that was corrected, Hz; None if none was.
        left: of the tone before its correction, |factor|; 1 if none was corrected.
    """

    plane: VelocityPlane
    signal: GridSignal
    start: Tensor
    hop: int
    attenuation: Tensor
    corrected: Tensor
    tone: float | None
    left: float


def cut_into_segments(record: BurstRecord, frequency: Tensor, choices: StationChoices) -> Segments:
    """Validated bursts onto a grid, the tone corrected, cut into segments.

    The stated tone is corrected whatever is asked for, since it drives |v| at all frequencies. Without a stated tone a
    single frequency asked for is one.

    Raises:
        ValueError: no wall-normal velocity, a record shorter than two segments, a gap longer than a segment, fewer than
            two arrivals a period, a tone damped below 0.3.
    """
    name, tone = record.name, record.frequency
    if record.wall_normal is None:
        raise ValueError(
            f"{name} holds no wall-normal velocity, only streamwise; say which channel measures it, e.g. components = "
            "-wall_normal"
        )
    times, values = checked_bursts(record.arrival_time, record.wall_normal, name)
    on = tone or float(frequency.max())
    grid = ArrivalGrid.of(times, choices.grid_rate, choices.method, on, choices.band_limit, name)
    length = round(choices.segment * grid.rate)
    hop = max(1, int((1 - choices.overlap) * length + 1e-9))
    count = 1 + (grid.samples - length) // hop
    _require_segments(grid, count, choices, name)
    signal = GridSignal(grid(values), grid)
    damping = tone_attenuation(signal, frequency, name=name)
    corrected, left = torch.zeros_like(frequency, dtype=torch.bool), 1.0
    if tone is None and len(frequency) == 1:
        tone = float(frequency)
    if choices.correction == "none":
        tone = None
    if tone is not None:
        corrected = (frequency / tone - 1).abs() < SAME_FREQUENCY
        own, words = damping.select(corrected), name
        if not bool(corrected.any()):
            words = f"{name}, stated tone (left as it is with correction='none')"
            own = tone_attenuation(signal, tone, name=words)
        left = float(own.factor.abs())
        signal = corrected_coherent_part(signal, own, noise=choices.correction == "tone-and-noise", name=words)
    plane = VelocityPlane(
        signal.values.unfold(0, length, hop),
        sampling_rate=grid.rate,
        height=record.y if record.y is not None and record.y > 0 else None,
        **{key: getattr(record, key) for key in STATED},
    )
    start = grid.start + hop * torch.arange(count, dtype=torch.float64) / grid.rate
    return Segments(plane, signal, start, hop, damping.factor, corrected, tone, left)


def _require_segments(grid: ArrivalGrid, count: int, choices: StationChoices, name: str) -> None:
    """Two segments, no more than memory holds, no gap longer than a segment."""
    of = f"of {choices.segment:g} s with an overlap of {choices.overlap:g}"
    if count < FEWEST_SEGMENTS:
        needed = (1 + (FEWEST_SEGMENTS - 1) * (1 - choices.overlap)) * choices.segment
        raise ValueError(
            f"{name}: {len(grid.arrival_times)} bursts over {grid.seconds:.4g} s; two segments {of} take {needed:.4g} "
            "s. Measure longer, or shorten the segment"
        )
    if count > MOST_SEGMENTS:
        raise ValueError(
            f"{name}: {grid.seconds:.4g} s hold {count} segments {of} (limit: {MOST_SEGMENTS}). Lower the overlap, or "
            "lengthen the segment"
        )
    gap, begin = grid.longest_gap
    if gap > choices.segment:
        raise ValueError(
            f"{name}: no burst for {gap:.4g} s from {begin:.6g} s on, longer than a segment of {choices.segment:g} s, "
            "which would be made up; cut the record there"
        )
