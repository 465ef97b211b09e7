"""DIR-TDIBC from bursts: one station after another, its segments as a batch of the engines."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import stated_frequency
from torchliner.ldv.line_average import station_interval
from torchliner.ldv.line_choices import StationChoices
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
from torchliner.replay.phase_rule import phase_rule
from torchliner.signals.inspected_station import inspect_stations
from torchliner.tdibc.assemble import facts_of, goodrich_of
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.educe import replay
from torchliner.tdibc.prepare import prepare
from torchliner.tdibc.prepared import Prepared

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
    (station,) = inspect_stations([record], station_choices.filters)
    kept, flags = station.kept, tuple(station.flags)
    if flags and station_choices.flagged == "refuse":
        raise ValueError(
            f"{record.name} is flagged: {'; '.join(flags)}. Leave it out of the averages with "
            "flagged='exclude', or take it as it is with flagged='use'"
        )
    wanted = _frequencies(record, frequency)
    cut = cut_into_segments(kept, wanted, station_choices)
    # Intervals and walls are those of the station, not of its segments.
    of_segments = dataclasses.replace(choices, interval=None, wall_filter=None)
    ready = prepare([cut.plane], liner, wanted, of_segments)[0]
    tone = None if reference is None else reference_tone(cut, reference, wanted, ready.record)
    takes_phase = phase_rule(choices.phase).takes_phase
    replayed = replay(ready)
    rule = replayed.rule(
        choices.phase,
        sound_phases(cut, wanted, tone, reference_phase) if takes_phase else None,
        None if tone is None else tone.coherent_part,
    )
    segments = len(cut.start)
    reflection = rule.reflection(replayed.means)[:segments].cpu()
    coherence = ready.survey.coherence[:segments].cpu().mean(0) if tone is None else tone.coherence
    notes = (
        *cut.notes, *ready.notes, *rule.notes(segments, replayed.means, wanted),
        *_warnings_of(ready, cut, tone, choices),
    )  # fmt: skip
    interval = station_interval(reflection, choices)
    vertical = station.moments.components["wall_normal"]
    return ImpedanceLine(
        frequency=wanted, reflection=reflection[None], segment_start=cut.start[None],
        x=_one(record.x), y=_one(record.y), z=_one(record.z),
        mean_velocity=_one(vertical.weighted_mean), velocity_rms=_one(vertical.weighted_rms),
        velocity_amplitude=_mean_amplitude(ready, clock_phases(cut, wanted, tone))[None],
        coherence=coherence[None], attenuation=cut.attenuation[None], corrected=cut.corrected[None],
        phase_held=rule.held[:segments].cpu().to(torch.float64).mean(0)[None],
        rate=_one(cut.signal.mean_rate), grid_rate=_one(cut.signal.grid.rate),
        longest_gap=_one(cut.signal.longest_gap), received=torch.tensor([record.received]),
        bursts=torch.tensor([kept.bursts]),
        used=torch.tensor([not flags or station_choices.flagged == "use"]),
        wall=None if choices.wall_filter is None else (coherence < choices.wall_filter)[None],
        interval=interval and Interval(*(value[None] for value in vars(interval).values())),
        names=(record.title or record.name,), flags=(flags,), dropped=(dict(kept.dropped),),
        station_notes=(notes,), goodrich=goodrich_of(ready),
        choices={
            **_facts(ready, station_choices, choices), "referred": tone is not None,
            "tone": record.frequency,
        },
        **{key: getattr(record, key) for key in CASE},
    )  # fmt: skip


def _one(value: Any) -> Tensor:
    """A number of the station as (1,), nan where unknown."""
    return torch.tensor([math.nan if value is None else float(value)], dtype=torch.float64)


def _frequencies(record: BurstRecord, frequency: Any) -> Tensor:
    wanted = stated_frequency(frequency, record.frequency, record.name)
    if len(wanted.unique()) < len(wanted):
        raise ValueError(f"a frequency is asked for twice: {wanted.tolist()} Hz; name each once")
    return wanted


def _mean_amplitude(ready: Prepared, phases: Tensor) -> Tensor:
    """Complex peak amplitude of v into the liner, (F,): over the segments, less their phases."""
    amplitude = ready.velocity_amplitude[: len(phases)].cpu()
    return 2 * (amplitude * torch.exp(-1j * phases)).mean(0)


def _warnings_of(ready: Prepared, cut: Segments, tone: ReferenceTone | None, choices: Choices) -> list[str]:
    """A tone that wanders past the correction; a reference that v does not follow."""
    notes = []
    segments = slice(0, len(cut.start))
    size = 2 * ready.velocity_amplitude[segments].cpu().abs().mean(0)
    left = _mean_amplitude(ready, clock_phases(cut, ready.frequency, None)).abs() / size.clamp(min=1e-300)
    has_tone = ready.survey.coherence[segments].cpu().mean(0) > choices.minimum_coherence / 2
    for i, f in enumerate(ready.frequency.tolist()):
        if bool(cut.corrected[i]) and float(left[i]) < WANDERS and bool(has_tone[i]):
            notes.append(
                f"the tone of {f:g} Hz wanders: over the whole record {float(left[i]):.2f} of its "
                "amplitude in the segments is left, and the correction, made over the record, "
                "misses the rest"
            )
        if tone is not None and float(tone.coherence[i]) < NO_TONE:
            notes.append(
                f"the squared coherence of v with the reference is {float(tone.coherence[i]):.2g} "
                f"at {f:g} Hz: it tells nothing of the phase of the sound there"
            )
    return notes


def _facts(ready: Prepared, station_choices: StationChoices, choices: Choices) -> dict[str, Any]:
    """Every choice; what differs from station to station is in the line itself."""
    facts = facts_of(ready, choices.phase)
    for key in ("velocity_max", "samples", "sampling_rate", "source", "data"):
        facts.pop(key)
    restored = {"interval": choices.interval, "wall_filter": choices.wall_filter}
    return {**facts, **restored, **station_choices.describe()}
