"""DIR-TDIBC from bursts: one station after another, its segments as a batch of the engines."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import real_tensor, stated_frequency
from torchliner.ldv.line_average import station_interval
from torchliner.ldv.line_choices import StationChoices
from torchliner.ldv.station_segments import Segments, cut_into_segments
from torchliner.records import BurstRecord, ImpedanceLine, Interval, ReferenceChannel
from torchliner.replay.kernels import Liner
from torchliner.replay.phase_rule import phase_rule
from torchliner.replay.survey import PERIODS_PER_SEGMENT
from torchliner.signals.burst_flags import station_flags
from torchliner.signals.burst_moments import burst_moments
from torchliner.signals.burst_validation import validate_bursts
from torchliner.signals.tones import tone_amplitudes
from torchliner.signals.transfer import Transfer, transfer_function
from torchliner.signals.windows import make_window
from torchliner.tdibc.assemble import facts_of, goodrich_of
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.educe import replay
from torchliner.tdibc.prepare import prepare
from torchliner.tdibc.prepared import Prepared

COARSE = 8.0  # samples a period, below which linear interpolation spoils a reference
NO_TONE = 0.05  # squared coherence with v below which a reference tells no phase
WANDERS = 0.9  # of the segments' mean amplitude that is left over the whole record


@dataclass(frozen=True)
class Referred:
    """What a reference channel says of a station.

    Args:
        amplitude: of the reference in each segment, phase at the segment's first sample, (S, F).
        transfer: H1 from it to v and their coherence, over pieces of two periods, (F,).
    """

    amplitude: Tensor
    transfer: Transfer


def educe_station(
    record: BurstRecord,
    liner: Liner,
    frequency: Any,
    how: StationChoices,
    chosen: Choices,
    reference: ReferenceChannel | None = None,
    reference_phase: float | None = None,
) -> ImpedanceLine:
    """One station, which depends on no other: a line of N = 1 without an average.

    Args:
        record: bursts as read.
        liner: as for ``educe``.
        frequency: Hz, one or several; None takes the record's tone.
        how, chosen: choices; ``chosen`` is for tones.
        reference: channel that carries the phase of the sound.
        reference_phase: psi in rad for ``given``: x(t) = cos(2 pi f t + psi) on the clock of the
            arrivals; with a reference, psi is the lead of x over it.
    Raises:
        ValueError: see ``torchliner.educe_bursts``.
    """
    kept = validate_bursts(record, how.filters)
    moments = burst_moments(kept)
    flags = tuple(station_flags(record, kept, moments))
    if flags and how.flagged == "refuse":
        raise ValueError(
            f"{record.name} is flagged: {'; '.join(flags)}. Leave it out of the averages with "
            "flagged='exclude', or take it as it is with flagged='use'"
        )
    wanted = _frequencies(record, frequency)
    cut = cut_into_segments(kept, wanted, how)
    segments = dataclasses.replace(chosen, interval=None, wall_filter=None)
    ready = prepare([cut.plane], liner, wanted, segments)[0]
    referred = None if reference is None else _refer(cut, reference, wanted, chosen)
    coherent = None if referred is None else _coherent_part(referred)
    takes_phase = phase_rule(chosen.phase).takes_phase
    psi = _phases(cut, wanted, referred, reference_phase) if takes_phase else None
    replayed = replay(ready)
    rule = replayed.rule(chosen.phase, psi, coherent)
    count = len(cut.start)
    reflection, held = rule.reflection(replayed.means)[:count].cpu(), rule.held[:count].cpu()
    coherence = _coherence(ready, referred, count)
    wall = None if chosen.wall_filter is None else (coherence < chosen.wall_filter)[None]
    vertical = moments.components["wall_normal"]
    own: dict[str, Any] = _of_station(
        x=record.x, y=record.y, z=record.z, mean_velocity=vertical.weighted_mean,
        velocity_rms=vertical.weighted_rms, rate=cut.signal.mean_rate,
        grid_rate=cut.signal.grid.rate, longest_gap=cut.signal.longest_gap,
    )  # fmt: skip
    return ImpedanceLine(
        frequency=wanted,
        reflection=reflection[None],
        segment_start=cut.start[None],
        velocity_amplitude=_velocity(ready, cut, referred, wanted)[None],
        coherence=coherence[None],
        attenuation=cut.attenuation[None],
        corrected=cut.corrected[None],
        phase_held=held.to(torch.float64).mean(0)[None],
        received=torch.tensor([record.received]),
        bursts=torch.tensor([kept.bursts]),
        used=torch.tensor([not flags or how.flagged == "use"]),
        wall=wall,
        interval=_stacked(station_interval(reflection, chosen)),
        names=(record.title or record.name,),
        flags=(flags,),
        dropped=(dict(kept.dropped),),
        station_notes=(
            (
                *cut.notes,
                *ready.notes,
                *rule.notes(count),
                *_doubts(ready, cut, referred, chosen, wanted),
            ),
        ),
        fluid=record.fluid,
        reference=dict(record.reference),
        mach=record.mach,
        incident_level=record.incident_level,
        source_side=record.source_side,
        goodrich=goodrich_of(ready),
        choices=_facts(ready, how, chosen, reference is not None),
        **own,
    )


def _of_station(**values: Any) -> dict[str, Any]:
    """One number each, nan where unknown, as (1,)."""
    nan = float("nan")
    return {
        name: torch.tensor([nan if value is None else float(value)], dtype=torch.float64)
        for name, value in values.items()
    }


def _frequencies(record: BurstRecord, frequency: Any) -> Tensor:
    wanted = stated_frequency(frequency, record.frequency, record.name)
    if len(wanted.unique()) < len(wanted):
        raise ValueError(f"a frequency is asked for twice: {wanted.tolist()} Hz; name each once")
    return wanted


def _refer(
    cut: Segments, reference: ReferenceChannel, frequency: Tensor, chosen: Choices
) -> Referred:
    grid, highest = cut.signal.grid, float(frequency.max())
    if reference.sampling_rate < COARSE * highest:
        raise ValueError(
            f"{reference.name} is sampled at {reference.sampling_rate:g} Hz, less than {COARSE:g} "
            f"times a period of {highest:g} Hz; its phase between the samples would be wrong"
        )
    values = reference.at(grid.times)
    frames = values.unfold(0, cut.plane.samples, cut.hop)
    weights = make_window(chosen.window, cut.plane.samples).weights
    amplitude = tone_amplitudes(frames, frequency, grid.rate, weights)
    lowest = PERIODS_PER_SEGMENT / float(frequency.min())
    found = transfer_function(values, cut.signal.values, frequency, grid.rate, segment=lowest)
    # A reference that is silent in all pieces has none.
    coherence = torch.nan_to_num(found.coherence, nan=0.0)
    return Referred(amplitude, dataclasses.replace(found, coherence=coherence))


def _coherent_part(referred: Referred) -> tuple[Tensor, Tensor]:
    """v into the liner that follows the reference, and its coherence; the one cell of the plane
    is the segments' mean."""
    into = -referred.transfer.response * referred.amplitude
    amplitude = torch.cat([into, into.mean(0, keepdim=True)])
    return amplitude, referred.transfer.coherence.expand(amplitude.shape)


def _phases(
    cut: Segments, frequency: Tensor, referred: Referred | None, lead: float | None
) -> Tensor:
    """psi of each segment, counted from its first sample, rad, (S, F)."""
    if referred is not None:
        return referred.amplitude.angle() + (0.0 if lead is None else lead)
    if lead is None:
        raise ValueError(
            "phase='given' needs a reference channel, or reference_phase in rad on the clock of "
            "the arrivals"
        )
    return lead + 2 * torch.pi * torch.outer(cut.start, frequency)


def _velocity(
    ready: Prepared, cut: Segments, referred: Referred | None, frequency: Tensor
) -> Tensor:
    """Complex peak amplitude of v into the liner, (F,): mean over the segments, phases aligned."""
    amplitude = ready.velocity_amplitude[: len(cut.start)].cpu()
    if referred is None:
        turns = torch.exp(-2j * torch.pi * torch.outer(cut.start, frequency))
    else:
        turns = torch.exp(-1j * referred.amplitude.angle())
    return 2 * (amplitude * turns).mean(0)


def _doubts(
    ready: Prepared, cut: Segments, referred: Referred | None, chosen: Choices, frequency: Tensor
) -> list[str]:
    """A tone that wanders past the correction; a reference that v does not follow."""
    notes = []
    each = ready.velocity_amplitude[: len(cut.start)].cpu()
    steady = _velocity(ready, cut, None, frequency).abs() / 2
    for i, f in enumerate(frequency.tolist()):
        left = float(steady[i] / each[:, i].abs().mean().clamp(min=1e-300))
        if bool(cut.corrected[i]) and left < WANDERS and _heard(ready, chosen, i):
            notes.append(
                f"the tone of {f:g} Hz wanders: over the whole record {left:.2f} of its amplitude "
                "in the segments is left, and the correction, made over the record, misses the rest"
            )
        if referred is not None and float(referred.transfer.coherence[i]) < NO_TONE:
            notes.append(
                f"the squared coherence of v with the reference is "
                f"{float(referred.transfer.coherence[i]):.2g} at {f:g} Hz: it tells nothing of the "
                "phase of the sound there"
            )
    return notes


def _heard(ready: Prepared, chosen: Choices, i: int) -> bool:
    """Whether there is a tone in the segments at all."""
    return float(ready.seen.coherence[:-1, i].mean()) > chosen.minimum_coherence / 2


def _coherence(ready: Prepared, referred: Referred | None, count: int) -> Tensor:
    if referred is not None:
        return referred.transfer.coherence
    return ready.seen.coherence[:count].cpu().mean(0)


def _stacked(interval: Interval | None) -> Interval | None:
    if interval is None:
        return None
    return interval.map(lambda value: value[None])


def _facts(ready: Prepared, how: StationChoices, chosen: Choices, referred: bool) -> dict[str, Any]:
    """Every choice; what differs from station to station is in the line itself."""
    facts = facts_of(ready, chosen.phase)
    for key in ("velocity_max", "samples", "sampling_rate", "source", "data"):
        facts.pop(key)
    restored = {"interval": chosen.interval, "wall_filter": chosen.wall_filter}
    return {**facts, **restored, **how.describe(), "referred": referred}


def checked_phase(value: Any, stations: int) -> list[float | None]:
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
