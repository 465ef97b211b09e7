r"""Transfer functions between signals, from tones that are exact in any record.

H1 puts all noise on the output: :math:`H_1 = \sum X^* Y/\sum |X|^2` over segments, unbiased by
whatever in y is incoherent with x. So x is the quieter signal: here the pressure at the bottom of a
cavity, which no boundary layer reaches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.signals.segments import segment_starts
from torchliner.signals.tones import ELEMENTS, tone_amplitudes
from torchliner.signals.windows import make_window


@dataclass(frozen=True)
class Transfer:
    """H1 and how far it can be believed.

    Args:
        response: H1 = Y/X, complex128, (..., F).
        coherence: squared, 0 to 1, (..., F); nan from a single segment, where it would always be 1.
        driver_power: mean of |X|^2 over the segments, (..., F).  segments: S.
    """

    response: Tensor
    coherence: Tensor
    driver_power: Tensor
    segments: int


def segment_amplitudes(
    signal: Tensor, frequency: Tensor, sampling_rate: float, *, window: Any = "hann",
    segment: float | None = None, start: float = 0.0,
) -> Tensor:  # fmt: skip
    """Complex tone amplitudes of each segment, (S, ..., F); see ``tone_amplitudes``.

    Args:
        signal: real, (..., T).  frequency: Hz, (F,).  sampling_rate: Hz.
        window: any window of scipy.
        segment: s, overlapping by half; None for one segment of the whole record, which wastes
            nothing of a short one.
        start: s at the beginning that are left out.
    Raises:
        ValueError: no segment fits, or one is too short for a frequency.
    """
    samples = signal.shape[-1]
    first = round(start * sampling_rate)
    if not 0 <= first <= samples - 2:
        raise ValueError(
            f"start is {start:g} s; it must be at least 0 and leave something of the record's "
            f"{samples / sampling_rate:g} s"
        )
    starts, length = segment_starts(samples, first, segment, sampling_rate)
    weights = make_window(window, length).weights
    step = starts[1] - starts[0] if len(starts) > 1 else 1
    frames = signal[..., first:].unfold(-1, length, step)[..., : len(starts), :]  # a view, (..., S, n)
    together = max(1, ELEMENTS // (length * max(1, math.prod(signal.shape[:-1]))))
    parts = [
        tone_amplitudes(frames[..., low : low + together, :], frequency, sampling_rate, weights)
        for low in range(0, len(starts), together)
    ]
    # Each frame was read from its own first sample on.
    turns = 2 * torch.pi / sampling_rate * torch.outer(torch.tensor(starts), frequency.cpu())
    return (torch.cat(parts, dim=-2) * torch.exp(-1j * turns)).movedim(-2, 0)


def transfer_from_amplitudes(driver: Tensor, response: Tensor) -> Transfer:
    """H1 from amplitudes of segments, (S, ..., F) each; leading axes broadcast."""
    across = (driver.conj() * response).sum(0)
    driving, answering = driver.abs().square().sum(0), response.abs().square().sum(0)
    coherence = across.abs().square() / (driving * answering)
    if len(driver) == 1:
        coherence = torch.full_like(coherence, torch.nan)
    return Transfer(across / driving, coherence, driving / len(driver), len(driver))


def transfer_function(
    driver: Tensor, response: Tensor, frequency: Tensor, sampling_rate: float, **cut: Any
) -> Transfer:
    """H1 = response/driver of two real signals (..., T) at the frequencies (F,), Hz.

    Over segments at their own bins this is scipy's csd(driver, response)/welch(driver); between the
    bins, and over a whole record of any length, tones come out exactly.

    Args:
        driver, response: x and y, (..., T), same times; leading axes broadcast.
        frequency, sampling_rate: as for ``segment_amplitudes``.
        cut: its ``window``, ``segment`` and ``start``.
    Raises:
        ValueError: lengths differ, or as ``segment_amplitudes``.
    """
    if driver.shape[-1] != response.shape[-1]:
        raise ValueError(
            f"driver has {driver.shape[-1]} samples, response {response.shape[-1]}; they share one time base"
        )
    both = (segment_amplitudes(x, frequency, sampling_rate, **cut) for x in (driver, response))
    return transfer_from_amplitudes(*both)
