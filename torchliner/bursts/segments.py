"""Bursts of a station on a uniform grid, the tone corrected, cut into overlapping segments side by side like probes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchliner.bursts.arrivals import ArrivalGrid, GridSignal, checked_bursts
from torchliner.bursts.choices import StationChoices
from torchliner.bursts.tone_damping import corrected_coherent_part, tone_attenuation
from torchliner.checks import SAME_FREQUENCY
from torchliner.records import BurstRecord, VelocityPlane

MOST_SEGMENTS = 5000
STATED = ("frequency", "fluid", "incident_level", "mach", "source_side", "liner", "displacement_thickness", "name")
DAMPED = 0.95  # warned of below


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
        notes: warnings.
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
    grid = ArrivalGrid.of(
        times, choices.grid_rate, choices.method, tone or float(frequency.max()), choices.band_limit, name
    )
    length = round(choices.segment * grid.rate)
    hop = max(1, int((1 - choices.overlap) * length + 1e-9))
    count, (gap, begin) = 1 + (grid.samples - length) // hop, grid.longest_gap
    if count > MOST_SEGMENTS:
        raise ValueError(
            f"{name}: {grid.seconds:.4g} s hold {count} segments of {choices.segment:g} s with an overlap of "
            f"{choices.overlap:g} (limit: {MOST_SEGMENTS}). Lower the overlap, or lengthen the segment"
        )
    if count < 2:
        raise ValueError(
            f"{name}: {len(times)} bursts over {grid.seconds:.4g} s; two segments of {choices.segment:g} s with an "
            f"overlap of {choices.overlap:g} take {(2 - choices.overlap) * choices.segment:.4g} s. Measure longer, or "
            "shorten the segment"
        )
    if gap > choices.segment:
        raise ValueError(
            f"{name}: no burst for {gap:.4g} s from {begin:.6g} s on, longer than a segment of {choices.segment:g} s, "
            "which would be made up; cut the record there"
        )
    signal, notes = GridSignal(grid(values), grid), tuple[str, ...]()
    tone = None if choices.correction == "none" else tone or (float(frequency) if len(frequency) == 1 else None)
    corrected = (frequency / (tone or torch.inf) - 1).abs() < SAME_FREQUENCY
    unasked = tone is not None and not bool(corrected.any())
    damping = tone_attenuation(signal, [*frequency.tolist(), tone] if unasked else frequency)
    if tone is not None:
        place = slice(-1, None) if unasked else corrected
        own = {key: getattr(damping, key)[place] for key in ("factor", "image", "frequency")}
        left = float(own["factor"].abs())
        if unasked and left < DAMPED:
            text = f"the stated tone of {tone:g} Hz, of which {grid.method} reconstruction leaves {left:.3f}, is"
            notes = (f"{text} corrected: it drives |v| at all frequencies",)
        signal = corrected_coherent_part(signal, replace(damping, **own), noise=choices.correction == "tone-and-noise")
    plane = VelocityPlane(
        signal.values.unfold(0, length, hop),
        sampling_rate=grid.rate,
        height=record.y if record.y is not None and record.y > 0 else None,
        **{key: getattr(record, key) for key in STATED},
    )
    start = grid.start + hop * torch.arange(count, dtype=torch.float64) / grid.rate
    return Segments(plane, signal, start, hop, damping.factor[: len(frequency)], corrected, notes)
