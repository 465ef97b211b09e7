"""What a reference channel beside the bursts tells of the sound in the segments of a station."""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.bursts.segments import Segments
from torchliner.checks import SAME_FREQUENCY
from torchliner.records import ReferenceChannel
from torchliner.signals.tones import tone_amplitudes
from torchliner.signals.transfer import transfer_function

COARSE = 8.0  # samples a period, below which linear interpolation spoils a reference
FEWEST_PIECES = 8  # of a record, over which coherence is found


def follow_reference(
    cut: Segments, reference: ReferenceChannel, frequency: Tensor, weights: Tensor, block: float
) -> tuple[Tensor, Tensor, Tensor]:
    """The tone of a reference channel in the segments of a station, and what of v follows it.

    Args:
        cut: the segments.
        reference: on the clock of the arrivals.
        frequency: Hz, (F,).
        weights: of the samples of a segment, (n,).
        block: s, over which coherence is found.
    Returns:
        Phase of the reference at each segment's first sample, rad, and half the complex peak amplitude of the v into
        the liner that follows it, (S, F); squared coherence of the two, (F,), 0 where the reference is 0 throughout.
    Raises:
        ValueError: the channel does not cover the station, or has fewer than 8 samples a period.
    """
    grid, highest, tone = cut.signal.grid, float(frequency.max()), cut.plane.frequency
    if reference.sampling_rate < COARSE * highest:
        raise ValueError(
            f"{reference.name} is sampled at {reference.sampling_rate:g} Hz, less than {COARSE:g} times a period of "
            f"{highest:g} Hz; its phase between the samples would be wrong"
        )
    values, found = reference.at(grid.times), []
    for f in frequency.tolist():
        piece, apart = block, 0.0 if tone is None else abs(f - tone * max(1, round(f / tone)))
        if apart >= SAME_FREQUENCY * f:
            # A harmonic of the tone is in both channels, and would count as coherent: it has to lie two bins away, at
            # the zero of Hann's window.
            piece = max(block, min(2 / apart, grid.samples / grid.rate / FEWEST_PIECES))
        at = torch.tensor([f], dtype=torch.float64)
        found.append(transfer_function(values, cut.signal.values, at, grid.rate, segment=piece))
    amplitude = tone_amplitudes(values.unfold(0, cut.plane.samples, cut.hop), frequency, grid.rate, weights)
    coherence = torch.nan_to_num(torch.cat([each.coherence for each in found]), nan=0.0)
    return amplitude.angle(), -torch.cat([each.response for each in found]) * amplitude, coherence
