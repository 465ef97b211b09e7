"""Which frequencies are educed."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import stated_frequency
from torchliner.records import VelocityPlane
from torchliner.replay.edges import Record
from torchliner.replay.waves import Tones
from torchliner.signals.segments import segment_starts
from torchliner.tdibc.choices import Choices

MOST_LINES = 200  # frequencies of a broadband map unless more are asked for


def frequencies_of(plane: VelocityPlane, frequency: Any, record: Record, chosen: Choices) -> Tensor:
    """As asked, else the lines of the incident signal, else the tone of the plane; Hz, (F,)."""
    if frequency is None and chosen.incident is not None:
        frequency = signal_lines(plane, record, chosen)
    return stated_frequency(frequency, plane.frequency, plane.name, plane.sampling_rate)


def signal_lines(plane: VelocityPlane, record: Record, chosen: Choices) -> Tensor | None:
    """Lines of the segments in the incident signal's band, evenly thinned to ``MOST_LINES``."""
    wave = chosen.incident
    if isinstance(wave, Tones):
        return wave.frequency
    if wave.band is None:
        return None
    _, length = segment_starts(plane.samples, record.start, chosen.segment, plane.sampling_rate)
    spacing = plane.sampling_rate / length
    first = math.ceil(wave.band[0] / spacing - 1e-9)
    last = math.floor(wave.band[1] / spacing + 1e-9)
    step = max(1, math.ceil((last - first + 1) / MOST_LINES))
    return spacing * torch.arange(first, last + 1, step, dtype=torch.float64)
