"""DIR-TDIBC from bursts: one station after another, its segments side by side like probes."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import stated_frequency
from torchliner.engine.phase import Sound
from torchliner.ldv.line_average import station_interval
from torchliner.ldv.line_choices import StationChoices
from torchliner.ldv.segment_means import SegmentMeans, segment_means
from torchliner.ldv.station_segments import (
    ReferenceTone,
    Segments,
    clock_phases,
    cut_into_segments,
    reference_tone,
    sound_phases,
)
from torchliner.liners.model import LinerModel
from torchliner.records import BurstRecord, ImpedanceLine, Interval, ReferenceChannel
from torchliner.records.notes import Note
from torchliner.signals.inspected_station import inspect_stations
from torchliner.velocity.answer import goodrich_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.review import review_liner, review_record, texts
from torchliner.velocity.review_answer import review_rule
from torchliner.version import __version__

CASE = ("fluid", "mach", "incident_level", "source_side", "reference")  # one for a whole line
NO_TONE = 0.05  # squared coherence with v below which a reference tells no phase
WANDERS = 0.9  # of the segments' mean amplitude that is left over the whole record


def educe_station(
    record: BurstRecord, liner: LinerModel, frequency: Any, station_choices: StationChoices,
    choices: Choices, reference: ReferenceChannel | None = None,
    reference_phase: float | None = None,
) -> ImpedanceLine:  # fmt: skip
    """One station, which depends on no other: a line of N = 1 without an average.

    Args:
        record: bursts as read.  liner: as for ``educe``.
        frequency: Hz, one or several; None takes the record's tone.
        station_choices, choices: from bursts to segments; of the replay, for tones.
        reference: channel that carries the phase of the sound.
        reference_phase: psi in rad for ``given``: x(t) = cos(2 pi f t + psi) on the clock of the
            arrivals; with a reference, psi is the lead of x over it.
    Raises:
        ValueError: see ``torchliner.educe_bursts``.
    """
    liner = liner.in_flow(record.mach)
    (station,) = inspect_stations([record], station_choices.filters)
    kept, flags = station.kept, tuple(station.flags)
    if flags and station_choices.flagged == "refuse":
        raise ValueError(
            f"{record.name} is flagged: {'; '.join(flags)}. Leave it out of the averages with "
            "flagged='exclude', or take it as it is with flagged='use'"
        )
    wanted = _frequencies(record, frequency)
    cut = cut_into_segments(kept, wanted, station_choices)
    known = segment_means(cut.plane, liner, wanted, choices, station_choices.window)
    tone = None if reference is None else reference_tone(cut, reference, wanted, known)
    sound, held = _sound(known, cut, wanted, tone, choices, reference_phase)
    reflection = known.reflection(choices.phase, sound).cpu()
    coherence = known.coherence.mean(0) if tone is None else tone.coherence
    notes = [
        *cut.notes, *texts(_reviewed(cut, liner, wanted, choices)),
        *texts(review_rule(held, known.blocks, choices)), *_warnings_of(known, cut, wanted, tone, choices),
    ]  # fmt: skip
    interval = station_interval(reflection, choices)
    vertical = station.moments.components["wall_normal"]
    used = not flags or station_choices.flagged == "use"
    return ImpedanceLine(
        frequency=wanted, reflection=reflection[None], segment_start=cut.start[None],
        x=_one(record.x), y=_one(record.y), z=_one(record.z),
        mean_velocity=_one(vertical.weighted_mean), velocity_rms=_one(vertical.weighted_rms),
        velocity_amplitude=_mean_amplitude(known, clock_phases(cut, wanted, tone))[None],
        coherence=coherence[None], attenuation=cut.attenuation[None], corrected=cut.corrected[None],
        phase_held=held.to(torch.float64).mean(0)[None],
        rate=_one(cut.signal.mean_rate), grid_rate=_one(cut.signal.grid.rate),
        longest_gap=_one(cut.signal.longest_gap), received=torch.tensor([record.received]),
        bursts=torch.tensor([kept.bursts]), used=torch.tensor([used]),
        wall=None if choices.wall_filter is None else (coherence < choices.wall_filter)[None],
        interval=interval and Interval(*(value[None] for value in vars(interval).values())),
        names=(record.title or record.name,), flags=(flags,), dropped=(dict(kept.dropped),),
        station_notes=(tuple(notes),), goodrich=goodrich_of(cut.plane, liner, wanted),
        choices={
            "version": __version__, **choices.describe(), "liner": liner.describe(), "tone": record.frequency,
            "surface": record.liner, "blocks": known.blocks, "referred": tone is not None,
            "nodes": None if known.nodes is None else known.nodes.describe(), "model_error": known.model_error,
            **station_choices.describe(),
        },
        **{key: getattr(record, key) for key in CASE},
    )  # fmt: skip


def _sound(
    known: SegmentMeans, cut: Segments, frequency: Tensor, tone: ReferenceTone | None, choices: Choices,
    reference_phase: float | None,
) -> tuple[Sound, Tensor]:  # fmt: skip
    """What a phase rule may know: the tone in v itself, or what of v follows the reference; where it holds, (S, F)."""
    velocity, coherence = (known.velocity, known.coherence) if tone is None else tone.coherent_part
    held = (coherence >= choices.minimum_coherence) | torch.tensor(choices.phase != "self-consistent")
    phase = sound_phases(cut, frequency, tone, reference_phase) if choices.phase == "given" else None
    return Sound(velocity, held, phase), held


def _reviewed(cut: Segments, liner: LinerModel, frequency: Tensor, choices: Choices) -> list[Note]:
    return review_record(cut.plane, frequency, choices) + review_liner(cut.plane, liner)


def _one(value: Any) -> Tensor:
    """A number of the station as (1,), nan where unknown."""
    return torch.tensor([math.nan if value is None else float(value)], dtype=torch.float64)


def _frequencies(record: BurstRecord, frequency: Any) -> Tensor:
    wanted = stated_frequency(frequency, record.frequency, record.name)
    if len(wanted.unique()) < len(wanted):
        raise ValueError(f"a frequency is asked for twice: {wanted.tolist()} Hz; name each once")
    return wanted


def _mean_amplitude(known: SegmentMeans, phases: Tensor) -> Tensor:
    """Complex peak amplitude of v into the liner, (F,): over the segments, less their phases."""
    return 2 * (known.velocity * torch.exp(-1j * phases)).mean(0)


def _warnings_of(
    known: SegmentMeans, cut: Segments, frequency: Tensor, tone: ReferenceTone | None, choices: Choices
) -> list[str]:
    """A tone that wanders past the correction; a reference that v does not follow."""
    notes = []
    size = 2 * known.velocity.abs().mean(0)
    left = _mean_amplitude(known, clock_phases(cut, frequency, None)).abs() / size.clamp(min=1e-300)
    has_tone = known.coherence.mean(0) > choices.minimum_coherence / 2
    for i, f in enumerate(frequency.tolist()):
        if bool(cut.corrected[i]) and float(left[i]) < WANDERS and bool(has_tone[i]):
            notes.append(
                f"the tone of {f:g} Hz wanders: over the whole record {float(left[i]):.2f} of its amplitude in the "
                "segments is left, and the correction, made over the record, misses the rest"
            )
        if tone is not None and float(tone.coherence[i]) < NO_TONE:
            notes.append(
                f"the squared coherence of v with the reference is {float(tone.coherence[i]):.2g} at {f:g} Hz: it "
                "tells nothing of the phase of the sound there"
            )
    return notes
