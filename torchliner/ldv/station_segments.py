"""Bursts of one station as segments of a uniform signal, a batch axis of the engines, and what a
reference channel, or a stated phase, tells of the sound in them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, DataWarning, real_tensor
from torchliner.ldv.line_choices import StationChoices
from torchliner.ldv.segment_means import SegmentMeans
from torchliner.records import BurstRecord, ReferenceChannel, VelocityPlane
from torchliner.signals.arrivals import GridSignal, onto_grid
from torchliner.signals.attenuation import DAMPED, REMEDY, ToneAttenuation, tone_attenuation
from torchliner.signals.coherent_part import LEAST_FACTOR, corrected_coherent_part
from torchliner.signals.segments import segment_starts
from torchliner.signals.tones import tone_amplitudes
from torchliner.signals.transfer import transfer_function

FEWEST_SEGMENTS = 2
MOST_SEGMENTS = 5000  # 200 MB, the covariance of their mean
MOST_POINTS = 3e7  # 240 MB of a station
COARSE = 8.0  # samples a period, below which linear interpolation spoils a reference
FEWEST_PIECES = 8  # of a record, over which coherence is told


@dataclass(frozen=True)
class Segments:
    """A station cut into overlapping segments.

    Args:
        plane: a probe a segment, (S, n): a view of ``signal``.
        signal: the station on its grid, the tone corrected if that was asked for.
        start: of each segment on the clock of the arrivals, s, (S,).
        hop: samples from one segment to the next.
        attenuation: factor on a tone over the whole record, complex128, (F,).
        corrected: frequencies whose tone was corrected, bool, (F,).  notes: warnings, with numbers.
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
        ValueError: no wall-normal velocity, a record shorter than two segments, a gap longer than
            a segment, fewer than two arrivals a period, a tone damped below 0.3.
    """
    if record.wall_normal is None:
        raise ValueError(
            f"{record.name} holds no wall-normal velocity, only streamwise; say which channel "
            "measures it, e.g. components = -wall_normal"
        )
    _require_enough(record, choices)
    # What is doubtful becomes a note of the station; the line as a whole warns once.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)
        signal = onto_grid(
            record.arrival_time, record.wall_normal, choices.grid_rate, choices.method,
            frequency=record.frequency or float(frequency.max()), band=choices.band_limit,
            name=record.name,
        )  # fmt: skip
        tones = _with_tone(record, frequency, choices)
        try:
            factors = tone_attenuation(
                record.arrival_time, tones, method=choices.method, band=choices.band_limit,
                grid=signal.grid, name=record.name,
            )  # fmt: skip
        except ValueError as error:
            if float(tones.max()) == float(frequency.max()):
                raise
            raise ValueError(
                f"{error}. The stated tone of {tones[-1]:g} Hz is corrected whatever is asked for; "
                "correction='none' leaves it as it is"
            ) from None
    notes = (*record.notes, *signal.notes, *factors.notes)
    corrected = _is_tone(record, tones) & (choices.correction != "none")
    if bool(corrected.any()):
        signal = _corrected(record, signal, factors, corrected, choices)
        notes = tuple(note for note in notes if REMEDY not in note)
        left = float(factors.factor[0, -1].abs())
        if len(tones) > len(frequency) and left < DAMPED:
            notes += (
                f"the stated tone of {tones[-1]:g} Hz, of which {choices.method} reconstruction "
                f"leaves {left:.3f}, is corrected: it drives |v| at all frequencies",
            )
    rate = signal.grid.rate
    starts, length = segment_starts(signal.grid.samples, 0, choices.segment, rate, choices.overlap)
    if len(starts) < FEWEST_SEGMENTS:
        raise ValueError(f"{record.name}: its grid holds one segment of {choices.segment:g} s; shorten the segment")
    hop = starts[1] - starts[0]
    plane = VelocityPlane(
        signal.values.unfold(0, length, hop), sampling_rate=rate, frequency=record.frequency,
        fluid=record.fluid, incident_level=record.incident_level, mach=record.mach,
        source_side=record.source_side, liner=record.liner,
        height=record.y if record.y is not None and record.y > 0 else None,
        displacement_thickness=record.displacement_thickness, name=record.name,
    )  # fmt: skip
    begin = signal.grid.start + torch.tensor(starts, dtype=torch.float64) / rate
    asked = slice(0, len(frequency))
    return Segments(
        plane, signal, begin, hop, factors.factor[0, asked], corrected[asked], notes
    )  # fmt: skip


def _require_enough(record: BurstRecord, choices: StationChoices) -> None:
    """Two segments, no more and a grid no finer than memory holds, no gap longer than a segment."""
    lasts = float(record.arrival_time[-1] - record.arrival_time[0])
    needed = (1 + (FEWEST_SEGMENTS - 1) * (1 - choices.overlap)) * choices.segment
    if lasts < needed or record.bursts < 2:
        raise ValueError(
            f"{record.name}: {record.bursts} bursts over {lasts:.4g} s; two segments of "
            f"{choices.segment:g} s with an overlap of {choices.overlap:g} take {needed:.4g} s. "
            "Measure longer, or shorten the segment"
        )
    count = 1 + (lasts - choices.segment) / ((1 - choices.overlap) * choices.segment)
    if count > MOST_SEGMENTS:
        raise ValueError(
            f"{record.name}: {lasts:.4g} s hold {count:.4g} segments of {choices.segment:g} s with "
            f"an overlap of {choices.overlap:g} (limit: {MOST_SEGMENTS}). Lower the overlap, or "
            "lengthen the segment"
        )
    points = lasts * (choices.grid_rate or 0.0)
    if points > MOST_POINTS:
        raise ValueError(
            f"{record.name}: a grid of {choices.grid_rate:g} Hz has {points:.3g} points (limit "
            f"{MOST_POINTS:g}); {record.bursts} bursts fill far fewer, lower grid_rate"
        )
    steps = record.arrival_time.diff()
    longest = int(steps.argmax())
    if float(steps[longest]) > choices.segment:
        raise ValueError(
            f"{record.name}: no burst for {float(steps[longest]):.4g} s from "
            f"{float(record.arrival_time[longest]):.6g} s on, longer than a segment of "
            f"{choices.segment:g} s, which would be made up; cut the record there"
        )


def _with_tone(record: BurstRecord, frequency: Tensor, choices: StationChoices) -> Tensor:
    """The frequencies asked for, and after them the stated tone, which is corrected in any case: it
    drives |v| at all of them."""
    tone = record.frequency
    if tone is None or choices.correction == "none" or bool(_is_tone(record, frequency).any()):
        return frequency
    return torch.cat([frequency, frequency.new_tensor([tone])])


def _is_tone(record: BurstRecord, frequency: Tensor) -> Tensor:
    """Where there is a tone to correct: at the record's own, or at the only frequency asked for."""
    if record.frequency is None:
        return torch.full_like(frequency, len(frequency) == 1, dtype=torch.bool)
    return (frequency / record.frequency - 1).abs() < SAME_FREQUENCY


def _corrected(
    record: BurstRecord, signal: GridSignal, factors: ToneAttenuation, tones: Tensor,
    choices: StationChoices,
) -> GridSignal:  # fmt: skip
    """The signal with the tones among the frequencies, bool (F,), put back."""
    factors = replace(
        factors, factor=factors.factor[:, tones], image=factors.image[:, tones],
        frequency=factors.frequency[tones],
    )  # fmt: skip
    smallest = float(factors.factor.abs().min())
    if smallest < LEAST_FACTOR:
        raise ValueError(
            f"{record.name}: {choices.method} reconstruction leaves {smallest:.3g} of the tone; a "
            f"correction would raise noise {1 / smallest:.3g} times (limit: {LEAST_FACTOR:g}). "
            "More arrivals are needed, or correction='none' leaves the tone as it is"
        )
    arrivals = record.arrival_time if choices.correction == "tone-and-noise" else None
    return corrected_coherent_part(signal, factors, arrivals).signal


@dataclass(frozen=True)
class ReferenceTone:
    """The tone of a reference channel, and how v follows it.

    Args:
        amplitude: of the reference in each segment, phase at the segment's first sample, (S, F).
        response: H1 from the reference to v, over pieces of the record, see ``_piece``, (F,).
        coherence: squared, of the two, (F,); 0 where the reference is 0 throughout.
    """

    amplitude: Tensor
    response: Tensor
    coherence: Tensor

    @property
    def coherent_part(self) -> tuple[Tensor, Tensor]:
        """v into the liner that follows the reference, and its coherence, (S, F) each."""
        into = -self.response * self.amplitude
        return into, self.coherence.expand(into.shape)


def reference_tone(cut: Segments, reference: ReferenceChannel, frequency: Tensor, known: SegmentMeans) -> ReferenceTone:
    """The reference channel in the segments of a station, under the window of ``known``.

    Raises:
        ValueError: the channel does not cover the station, or has fewer than 8 samples a period.
    """
    grid, highest = cut.signal.grid, float(frequency.max())
    if reference.sampling_rate < COARSE * highest:
        raise ValueError(
            f"{reference.name} is sampled at {reference.sampling_rate:g} Hz, less than {COARSE:g} "
            f"times a period of {highest:g} Hz; its phase between the samples would be wrong"
        )
    values = reference.at(grid.times)
    segments = values.unfold(0, cut.plane.samples, cut.hop)
    block, whole = cut.plane.duration / known.blocks, grid.samples / grid.rate
    found = [
        transfer_function(
            values, cut.signal.values, frequency[i : i + 1], grid.rate,
            segment=_piece(f, cut.plane.frequency, block, whole),
        )
        for i, f in enumerate(frequency.tolist())
    ]  # fmt: skip
    return ReferenceTone(
        tone_amplitudes(segments, frequency, grid.rate, known.weights),
        torch.cat([each.response for each in found]),
        torch.nan_to_num(torch.cat([each.coherence for each in found]), nan=0.0),
    )


def _piece(frequency: float, tone: float | None, block: float, whole: float) -> float:
    """Seconds of the pieces of a record of ``whole`` s over which coherence at a frequency (Hz) is told.

    A ``block``; beside a harmonic of the ``tone`` so long that it lies two bins away, at the zero of Hann's window:
    both channels hold it, and it would count as coherent.
    """
    apart = 0.0 if tone is None else abs(frequency - tone * max(1, round(frequency / tone)))
    if apart < SAME_FREQUENCY * frequency:
        return block
    return max(block, min(2 / apart, whole / FEWEST_PIECES))


def clock_phases(cut: Segments, frequency: Tensor, reference: ReferenceTone | None) -> Tensor:
    """Phase of a steady tone, or of the reference, at each segment's first sample, (S, F)."""
    if reference is None:
        return 2 * torch.pi * torch.outer(cut.start, frequency)
    return reference.amplitude.angle()


def sound_phases(cut: Segments, frequency: Tensor, reference: ReferenceTone | None, lead: float | None) -> Tensor:
    """psi of ``given`` in each segment, counted from its first sample, rad, (S, F), ``lead`` ahead
    of the clock.

    Raises:
        ValueError: neither a reference nor a lead is known.
    """
    if reference is None and lead is None:
        raise ValueError(
            "phase='given' needs a reference channel, or reference_phase in rad on the clock of the arrivals"
        )
    return clock_phases(cut, frequency, reference) + (lead or 0.0)


def checked_phases(value: Any, stations: int) -> list[float | None]:
    """``reference_phase`` of each station.

    Raises:
        ValueError: neither one value nor one a station, or not finite.
    """
    if value is None:
        return [None] * stations
    values = real_tensor(value).reshape(-1)
    if len(values) not in (1, stations) or not bool(torch.isfinite(values).all()):
        raise ValueError(
            f"reference_phase holds {len(values)} values for {stations} stations; one for all or "
            "one a station, finite, in rad"
        )
    return [float(each) for each in values.expand(stations)]
