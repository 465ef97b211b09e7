"""Tones of microphones under flow, by a reference channel that hears no flow."""

from typing import NamedTuple

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.engine.tones import transfer_function, window_weights

FEWEST_SEGMENTS = 8  # that tell sound from flow noise
NO_TONE = 1e-24  # power of a tone over the largest square of its signal
CHANCE = 0.01  # of so high a coherence without any sound
WINDOW = "hann"


class RejectedFlow(NamedTuple):
    """Complex peak amplitudes of the sound alone, phase relative to the reference, their squared coherence, and the
    standard deviation over themselves (of the phase in radians), (..., F) each; S segments; what was warned of."""

    amplitude: Tensor
    coherence: Tensor
    relative_error: Tensor
    segments: int
    notes: tuple[str, ...]


def reject_flow_noise(
    pressure: Tensor,
    reference: Tensor,
    frequency: Tensor,
    sampling_rate: float,
    *,
    segment: float | None = None,
    name: str = "microphones",
) -> RejectedFlow:
    r"""Tones of microphones under flow that are coherent with a reference channel, which hears no flow.

    The amplitude :math:`H_1 |X|_{rms}` is that of the sound; the turbulence, of power (1 - coherence) of the whole, is
    rejected. What is left of it has the relative standard deviation :math:`\sqrt{(1-\gamma^2)/(2(n-1)\gamma^2)}` in
    amplitude and, in radians, in phase (Bendat & Piersol, Random Data, section 9.2; n - 1 since the coherence is
    estimated from the same segments). S segments that overlap by half count as :math:`n = S/(1 + 2\rho(S-1)/S)`,
    :math:`\rho = \sum w(t)w(t+T/2)/\sum w^2`: 11.4 of 15 for the Hann window. Welch's :math:`\rho^2` would be for a
    random reference; that of a tone is the same in every segment.

    Args:
        pressure: Pa, real, (..., T).  reference: of any unit, real, (T,), on the same times.
        frequency: Hz, (F,).  sampling_rate: Hz.
        segment: s, overlapping by half; default an eighth of the record, 15 segments.
        name: for messages.
    Raises:
        ValueError: lengths differ, the reference has no tone, fewer than eight segments.
    Warns:
        DataWarning: a coherence that noise alone reaches once in a hundred times.
    """
    samples = pressure.shape[-1]
    if samples != reference.shape[-1]:
        raise ValueError(f"{name}: the reference has {reference.shape[-1]} samples, the microphones {samples}")
    length = samples / sampling_rate / 8 if segment is None else segment
    driver = reference.reshape(*[1] * (pressure.ndim - 1), -1)
    found = transfer_function(driver, pressure, frequency, sampling_rate, window=WINDOW, segment=length)
    if found.segments < FEWEST_SEGMENTS:
        raise ValueError(
            f"{name}: {found.segments} segments of {length:g} s fit; at least {FEWEST_SEGMENTS} are needed to tell "
            "sound from flow noise: shorten the segment"
        )
    power = found.driver_power.reshape(-1)
    absent = power <= NO_TONE * reference.to(torch.float64).square().max()
    if bool(absent.any()):
        raise ValueError(
            f"{name}: the reference has no tone at {float(frequency[absent][0]):g} Hz; name those that were played"
        )
    weights = window_weights(WINDOW, round(length * sampling_rate))
    half = len(weights) // 2
    rho = float((weights[:-half] * weights[half:]).sum() / weights.square().sum())
    independent = found.segments / (1 + 2 * rho * (found.segments - 1) / found.segments)
    coherence = found.coherence.clamp(max=1)
    error = ((1 - coherence) / (2 * (independent - 1) * coherence)).sqrt()
    # Noise alone exceeds a coherence g with probability (1 - g)^(n - 1).
    limit, notes = 1 - CHANCE ** (1 / (independent - 1)), []
    if bool((coherence < limit).any()):
        worst = coherence.reshape(-1, len(frequency)).amin(0)
        notes = [
            f"{name}: the coherence with the reference is {float(worst.min()):.2g} at "
            f"{float(frequency[worst.argmin()]):g} Hz, below {limit:.2g} in {int((coherence < limit).sum())} of "
            f"{coherence.numel()} values: flow noise alone reaches that once in a hundred times; record longer"
        ]
    tell(notes)
    return RejectedFlow(2 * found.response * power.sqrt(), coherence, error, found.segments, tuple(notes))
