"""Incident waves: records that repeat, of unit rms, and the rate that suits them."""

from __future__ import annotations

import dataclasses
import math
from fractions import Fraction
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import one_number, require_positive
from torchliner.records.incident import BandNoise, Recorded, Tones

RATE = 48_000.0  # Hz, at least
FEWEST, USUAL = 8, 16  # samples in a period of the highest frequency
SECONDS, TONE_SECONDS = 0.25, 0.04  # of a record of noise; of tones, at least
LONGEST = 1 << 17  # samples of a record of tones


def as_signal(incident: Any) -> Any:
    """A signal of ``replay.waves``, or tones from their frequencies in Hz."""
    if hasattr(incident, "sampled"):
        return incident
    if isinstance(incident, str):
        raise TypeError(f"incident is the text {incident!r}; give frequencies in Hz or a signal")
    return Tones(incident)


def sampling_rate_for(signal: Any, stated: Any) -> float:
    """The rate stated, or one of whole periods; Hz.

    Raises:
        ValueError: fewer than 8 samples a period of the highest frequency; a recording of another
            rate.
    """
    if isinstance(signal, Recorded):
        if stated is not None and abs(stated / signal.sampling_rate - 1) > 1e-6:
            raise ValueError(
                f"{signal.label} is sampled at {signal.sampling_rate:g} Hz, sampling_rate is "
                f"{stated:g} Hz; leave it out, or resample the recording"
            )
        return signal.sampling_rate
    highest = signal.band[1]
    if stated is None:
        least = max(RATE, USUAL * highest)
        unit = float(_common(signal)) if isinstance(signal, Tones) else 1000.0
        return unit * math.ceil(least / unit)
    require_positive("sampling_rate (Hz)", stated)
    rate = one_number("sampling_rate", stated)
    if rate < FEWEST * highest:
        raise ValueError(
            f"sampling_rate is {rate:g} Hz, {rate / highest:.3g} samples a period of "
            f"{highest:g} Hz, the highest of {signal.label}; give {FEWEST * highest:g} Hz or more "
            f"({USUAL * highest:g} Hz or more for its harmonics)"
        )
    return rate


def _common(tones: Tones) -> Fraction:
    """Highest frequency that all tones are multiples of, Hz, to 1 mHz."""
    parts = [Fraction(f).limit_denominator(1000) for f in tones.frequency.tolist()]
    return Fraction(math.gcd(*(p.numerator * math.lcm(*(q.denominator for q in parts))
                               // p.denominator for p in parts)),
                    math.lcm(*(p.denominator for p in parts)))  # fmt: skip


def record_length(signal: Any, rate: float, duration: Any, kernel: int) -> int:
    """Samples of the record that repeats: whole periods of tones, at least a kernel's length.

    Raises:
        ValueError: a record shorter than the kernel; tones without a common period; a duration of
            a recording.
    """
    if duration is not None:
        require_positive("duration (s)", duration)
    if isinstance(signal, Recorded):
        if duration is not None:
            raise ValueError(
                f"{signal.label} is sent whole, {len(signal.signal) / rate:.6g} s; cut it, or leave duration out"
            )
        samples = len(signal.signal)
    elif isinstance(signal, Tones):
        turns = [Fraction(f / rate).limit_denominator(1_000_000) for f in signal.frequency.tolist()]
        period = math.lcm(*(turn.denominator for turn in turns))
        least = max(round((duration or TONE_SECONDS) * rate), 0 if duration else kernel)
        samples = period * math.ceil(least / period)
        worst = max(abs(float(turn) - f / rate) * samples
                    for turn, f in zip(turns, signal.frequency.tolist(), strict=True))  # fmt: skip
        if samples > LONGEST or worst > 1e-6:
            raise ValueError(
                f"{signal.label} repeats after {period} samples at {rate:g} Hz, which is too long; "
                "leave sampling_rate out, or give a multiple of the tones' common divisor"
            )
    else:
        samples = round((duration or SECONDS) * rate)
    if samples < kernel:
        raise ValueError(
            f"{signal.label}: the record has {samples} samples ({1e3 * samples / rate:.3g} ms), "
            f"the kernel {kernel}; give a longer duration or a smaller after="
        )
    return samples


def unit_records(signal: Any, realisations: int, samples: int, rate: float) -> Tensor:
    """Realisations of a signal, rms 1 each, float64, (N, n): other phases, other seeds.

    Raises:
        ValueError: a signal that has only one.
    """
    several = isinstance(signal, BandNoise) or (isinstance(signal, Tones) and len(signal.frequency) > 1)
    if realisations > 1 and not several:
        raise ValueError(
            f"{signal.label} has one realisation, {realisations} are asked for; noise and several tones have more"
        )
    draws = torch.stack([_drawn(signal, i).sampled(samples, rate) for i in range(realisations)])
    if isinstance(signal, Recorded):  # whose mean is an offset: it moves no wave
        draws = draws - draws.mean(1, keepdim=True)
    size = draws.square().mean(1, keepdim=True).sqrt()
    if not bool((size > 1e-12 * draws.abs().max()).all()):
        raise ValueError(f"{signal.label} is one value throughout; there is no wave to scale to a level")
    return draws / size


def _drawn(signal: Any, number: int) -> Any:
    """The signal itself, then others of its kind."""
    if number == 0:
        return signal
    if isinstance(signal, BandNoise):
        return dataclasses.replace(signal, seed=signal.seed + number)
    generator = torch.Generator().manual_seed(number)
    phase = 2 * torch.pi * torch.rand(len(signal.frequency), generator=generator).double()
    return Tones(signal.frequency, signal.amplitude, phase)
