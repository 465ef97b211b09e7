"""What a reference channel, or a stated phase, tells of the sound at one station."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import real_tensor
from torchliner.ldv.station_segments import Segments
from torchliner.records import ReferenceChannel
from torchliner.reduction.coherence import PERIODS_PER_SEGMENT
from torchliner.replay.edges import Record
from torchliner.signals.tones import tone_amplitudes
from torchliner.signals.transfer import transfer_function

COARSE = 8.0  # samples a period, below which linear interpolation spoils a reference


@dataclass(frozen=True)
class ReferenceTone:
    """The tone of a reference channel, and how v follows it.

    Args:
        amplitude: of the reference in each segment, phase at the segment's first sample, (S, F).
        response: H1 from the reference to v, over pieces of two periods, (F,).
        coherence: squared, of the two, (F,); 0 where the reference is 0 throughout.
    """

    amplitude: Tensor
    response: Tensor
    coherence: Tensor

    @property
    def coherent_part(self) -> tuple[Tensor, Tensor]:
        """v into the liner that follows the reference; the one cell of the plane is their mean."""
        into = -self.response * self.amplitude
        amplitude = torch.cat([into, into.mean(0, keepdim=True)])
        return amplitude, self.coherence.expand(amplitude.shape)


def reference_tone(
    cut: Segments, reference: ReferenceChannel, frequency: Tensor, record: Record
) -> ReferenceTone:
    """The reference channel in the segments of a station; ``record`` has the window over each.

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
    weights = record.weights(0, record.samples)
    found = transfer_function(
        values, cut.signal.values, frequency, grid.rate,
        segment=PERIODS_PER_SEGMENT / float(frequency.min()),
    )  # fmt: skip
    return ReferenceTone(
        tone_amplitudes(segments, frequency, grid.rate, weights),
        found.response,
        torch.nan_to_num(found.coherence, nan=0.0),
    )


def clock_phases(cut: Segments, frequency: Tensor, reference: ReferenceTone | None) -> Tensor:
    """Phase of a steady tone, or of the reference, at each segment's first sample, (S, F)."""
    if reference is None:
        return 2 * torch.pi * torch.outer(cut.start, frequency)
    return reference.amplitude.angle()


def sound_phases(
    cut: Segments, frequency: Tensor, reference: ReferenceTone | None, lead: float | None
) -> Tensor:
    """psi of ``given`` in each segment, counted from its first sample, rad, (S, F), ``lead`` ahead
    of the clock.

    Raises:
        ValueError: neither a reference nor a lead is known.
    """
    if reference is None and lead is None:
        raise ValueError(
            "phase='given' needs a reference channel, or reference_phase in rad on the clock of "
            "the arrivals"
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
