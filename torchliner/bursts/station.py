"""DIR-TDIBC of one station of bursts, its segments side by side like probes."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import torch

from torchliner.bursts.choices import StationChoices
from torchliner.bursts.segments import cut_into_segments, follow_reference, segment_means
from torchliner.bursts.stations import Station
from torchliner.checks import stated_frequency
from torchliner.engine.phase import PHASE_RULES, Sound
from torchliner.liners.model import LinerModel
from torchliner.records import BurstRecord, ImpedanceLine, ReferenceChannel
from torchliner.velocity.answer import goodrich_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.review_answer import review_rule
from torchliner.version import __version__

CASE = ("fluid", "mach", "incident_level", "source_side", "reference")  # one for a whole line
NO_TONE = 0.05  # squared coherence with v below which a reference knows no phase
WANDERS = 0.9  # of the segments' mean amplitude that is left over the whole record


def educe_station(
    record: BurstRecord,
    liner: LinerModel,
    frequency: Any,
    own: StationChoices,
    choices: Choices,
    reference: ReferenceChannel | None = None,
    reference_phase: float | None = None,
) -> ImpedanceLine:
    """One station, which depends on no other: a line of N = 1 without average and intervals; see ``educe_bursts``.

    ``own`` are from bursts to segments, ``choices`` of the eduction; the record is as read.
    """
    liner, station = liner.in_flow(record.mach), Station.of(record, own.filters)
    kept, flags = station.kept, station.flags
    if flags and own.flagged == "refuse":
        raise ValueError(
            f"{record.name} is flagged: {'; '.join(flags)}. Leave it out of the averages with flagged='exclude', or "
            "take it as it is with flagged='use'"
        )
    wanted = stated_frequency(frequency, record.frequency, record.name)
    if len(wanted.unique()) < len(wanted):
        raise ValueError(f"a frequency is asked for twice: {wanted.tolist()} Hz; name each once")
    if choices.phase == "given" and reference is None and reference_phase is None:
        raise ValueError(
            "phase='given' needs a reference channel, or reference_phase in rad on the clock of the arrivals"
        )
    cut = cut_into_segments(kept, wanted, own)
    known = segment_means(cut.plane, liner, wanted, choices, own.window)
    seen, nodes = known.moments.survey, known.moments.nodes
    clock = 2 * torch.pi * torch.outer(cut.start, wanted)  # phase of a steady tone at each segment's first sample
    phases, velocity, coherence = clock, known.velocity, seen.coherence(wanted).cpu()
    steady = coherence.mean(0)
    if reference is not None:
        phases, velocity, coherence = follow_reference(cut, reference, wanted, known)
    held = ((coherence >= choices.minimum_coherence) | (choices.phase != "self-consistent")).expand(velocity.shape)
    sound = Sound(velocity, held, phases + (reference_phase or 0.0))
    coherence = steady if reference is None else coherence
    notes = [
        *kept.notes,
        *(note.text for note in known.moments.notes),
        *(note.text for note in review_rule(held, seen.blocks.count, choices)),
        *cut.notes,
    ]
    # Over the whole record a tone that wanders has less amplitude than in its segments.
    left = (known.velocity * torch.exp(-1j * clock)).mean(0).abs() / known.velocity.abs().mean(0).clamp(min=1e-300)
    wanders = cut.corrected & (left < WANDERS) & (steady > choices.minimum_coherence / 2)
    for i, f in enumerate(wanted.tolist()):
        if bool(wanders[i]):
            notes.append(
                f"the tone of {f:g} Hz wanders: over the whole record {float(left[i]):.2f} of its amplitude in the "
                "segments is left, and the correction, made over the record, misses the rest"
            )
        if reference is not None and float(coherence[i]) < NO_TONE:
            notes.append(
                f"the squared coherence of v with the reference is {float(coherence[i]):.2g} at {f:g} Hz (limit "
                f"{NO_TONE:g}): it tells nothing of the phase of the sound there"
            )
    vertical, grid = station.moments.components["wall_normal"], cut.signal.grid
    numbers = {
        **{axis: math.nan if (value := getattr(record, axis)) is None else value for axis in "xyz"},
        "mean_velocity": vertical.weighted_mean,
        "velocity_rms": vertical.weighted_rms,
        "rate": grid.mean_rate,
        "grid_rate": grid.rate,
        "longest_gap": grid.longest_gap[0],
    }
    tensors: dict[str, Any] = {
        "reflection": PHASE_RULES[choices.phase](known.a, known.b, sound),
        "segment_start": cut.start,
        "velocity_amplitude": 2 * (known.velocity * torch.exp(-1j * phases)).mean(0),
        "coherence": coherence,
        "attenuation": cut.attenuation,
        "corrected": cut.corrected,
        "phase_held": held.to(torch.float64).mean(0),
        "received": torch.tensor(record.received),
        "bursts": torch.tensor(kept.bursts),
        "used": torch.tensor(not flags or own.flagged == "use"),
        **{key: torch.tensor(value, dtype=torch.float64) for key, value in numbers.items()},
    }
    return ImpedanceLine(
        frequency=wanted,
        wall=None if choices.wall_filter is None else (coherence < choices.wall_filter)[None],
        interval=None,
        names=(station.name,),
        flags=(flags,),
        dropped=(dict(kept.dropped),),
        station_notes=(tuple(notes),),
        goodrich=goodrich_of(cut.plane, liner, wanted),
        choices={
            "version": __version__,
            **choices.describe(),
            "liner": liner.describe(),
            "tone": record.frequency,
            "surface": record.liner,
            "blocks": seen.blocks.count,
            "referred": reference is not None,
            "nodes": None if nodes is None else nodes.describe(),
            "model_error": known.model_error,
            **asdict(own),
        },
        **{key: value[None] for key, value in tensors.items()},
        **{key: getattr(record, key) for key in CASE},
    )
