"""The incident wave of an IR-TDIBC run: rate, length and draws of its record, and where Z is read."""

from __future__ import annotations

import dataclasses
import math
from fractions import Fraction
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_positive
from torchliner.records.incident import BandNoise, Incident, Recorded, Tones

RATE = 48_000.0  # Hz, at least
FEWEST, USUAL = 8, 16  # samples in a period of the highest frequency
SECONDS, TONE_SECONDS = 0.25, 0.04  # of a record of noise; of tones, at least
LONGEST = 1 << 17  # samples of a record of tones
READ = 8  # frequencies in the band of a wave, unless others are asked for
MOST_LINES = 256  # of a spectrum; of more, neighbours are taken together


def rate_of(wave: Incident, stated: float | None) -> float:
    """The sampling rate stated, or one of whole periods, Hz.

    Raises:
        ValueError: fewer than 8 samples a period of the highest frequency; not the rate of the recording.
    """
    if isinstance(wave, Recorded):
        if stated is not None and abs(stated / wave.sampling_rate - 1) > 1e-6:
            raise ValueError(
                f"{wave.label} is sampled at {wave.sampling_rate:g} Hz, sampling_rate is {stated:g} Hz; resample it"
            )
        return wave.sampling_rate
    assert wave.band is not None
    highest = wave.band[1]
    if stated is None:
        unit = _divisor(wave) if isinstance(wave, Tones) else 1000.0
        return unit * math.ceil(max(RATE, USUAL * highest) / unit)
    require_positive("sampling_rate (Hz)", stated)
    if stated < FEWEST * highest:
        raise ValueError(
            f"sampling_rate is {stated:g} Hz, {stated / highest:.3g} samples a period of {highest:g} Hz, the highest "
            f"of {wave.label}; give {FEWEST * highest:g} Hz or more ({USUAL * highest:g} Hz or more for its harmonics)"
        )
    return float(stated)


def _divisor(tones: Tones) -> float:
    """Highest frequency of which all tones are multiples, to 1 mHz, Hz."""
    parts = [Fraction(f).limit_denominator(1000) for f in tones.frequency.tolist()]
    whole = math.lcm(*(part.denominator for part in parts))
    return math.gcd(*(int(part * whole) for part in parts)) / whole


def length_of(wave: Incident, rate: float, duration: float | None, kernel: int) -> int:
    """Samples of the record: whole periods of tones, at least the kernel's length.

    Raises:
        ValueError: a record shorter than the kernel; tones without a common period; a duration of a recording.
    """
    if duration is not None:
        require_positive("duration (s)", duration)
    samples = round((duration or SECONDS) * rate)
    if isinstance(wave, Recorded):
        samples = len(wave.signal)
        if duration is not None:
            raise ValueError(f"{wave.label} is sent whole, {samples / rate:.6g} s; cut it, or leave duration out")
    if isinstance(wave, Tones):
        turns = [f / rate for f in wave.frequency.tolist()]
        exact = [Fraction(turn).limit_denominator(1_000_000) for turn in turns]
        period = math.lcm(*(turn.denominator for turn in exact))
        least = round(duration * rate) if duration else max(round(TONE_SECONDS * rate), kernel)
        samples = period * math.ceil(least / period)
        worst = max(abs(float(a) - b) for a, b in zip(exact, turns, strict=True)) * samples
        if samples > LONGEST or worst > 1e-6:
            raise ValueError(
                f"{wave.label} repeats after {period} samples at {rate:g} Hz, which is too long; leave sampling_rate "
                "out, or give a multiple of the tones' common divisor"
            )
    if samples < kernel:
        raise ValueError(
            f"{wave.label}: the record has {samples} samples ({1e3 * samples / rate:.3g} ms), the kernel {kernel}; "
            "give a longer duration or a smaller after="
        )
    return samples


def draws_of(wave: Incident, count: int, samples: int, rate: float) -> Tensor:
    """Records of rms 1, float64, (N, n): the wave itself, then others of its kind, of other phases or other seeds.

    Raises:
        ValueError: several of a wave that has only one; one value throughout.
    """
    waves = [wave]
    for i in range(1, count):
        if isinstance(wave, BandNoise):
            waves.append(dataclasses.replace(wave, seed=wave.seed + i))
        elif isinstance(wave, Tones) and len(wave.frequency) > 1:
            phase = torch.rand(len(wave.frequency), generator=torch.Generator().manual_seed(i)).double()
            waves.append(Tones(wave.frequency, wave.amplitude, 2 * torch.pi * phase))
        else:
            raise ValueError(
                f"{wave.label} has one realisation, {count} are asked for; noise and several tones have more"
            )
    draws = torch.stack([each.sampled(samples, rate) for each in waves])
    if isinstance(wave, Recorded):  # whose mean is an offset: it moves no wave
        draws = draws - draws.mean(1, keepdim=True)
    size = draws.square().mean(1, keepdim=True).sqrt()
    if not bool((size > 1e-12 * draws.abs().max()).all()):
        raise ValueError(f"{wave.label} is one value throughout; there is no wave to scale to a level")
    return draws / size


def read_at(wave: Incident, frequency: Any, rate: float) -> Tensor:
    """Where Z is read, Hz, (F,): by default at the tones, or at eight frequencies within the band.

    Raises:
        ValueError: a frequency that the wave does not hold.
    """
    known, (low, high) = None, wave.band or (0.0, math.inf)
    if isinstance(wave, Tones):
        known = wave.frequency[wave.amplitude != 0]
        frequency = known if frequency is None and len(known) else frequency
    if frequency is None:
        if wave.band is None:
            raise ValueError(f"{wave.label} states no frequencies; give frequency=, in Hz")
        frequency = torch.linspace(low, high, READ + 2, dtype=torch.float64)[1:-1]
    read = frequency_tensor(frequency, rate)
    for f in read.tolist():
        absent = known is not None and not bool(((known - f).abs() < 1e-6 * f).any())
        if absent or not low * (1 - 1e-6) <= f <= high * (1 + 1e-6):
            raise ValueError(f"frequency {f:g} Hz is not in {wave.label}; R is not known there")
    return read


def lines_of(record: Tensor, rate: float) -> tuple[Tensor, Tensor]:
    """Frequencies (Hz) and mean squares of the lines that carry a record (n,); a line may stand for several."""
    power = 2 * (torch.fft.rfft(record) / len(record)).abs().square()
    power[0] = 0  # a mean moves no wave
    carries = power > 1e-10 * power.max()
    frequency = torch.fft.rfftfreq(len(record), 1 / rate, dtype=torch.float64)[carries]
    power = power[carries]
    together = torch.arange(len(power)) * min(MOST_LINES, len(power)) // len(power)
    sums, moments = (torch.bincount(together, weights=each) for each in (power, power * frequency))
    return moments / sums, sums
