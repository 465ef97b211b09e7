r"""Tones of signals, exact in any record, what each block of time adds to them, and what two signals share.

A signal is m + a cos wt + b sin wt and a remainder r. Weighted least squares of its three rows, B, under a window W
gives :math:`c = G^{-1} B^T W y,\ G = B^T W B`, of which block s of the record adds
:math:`G^{-1} (B^T W r)_s = G^{-1} ((B^T W y)_s - G_s c)`. At the bins of a periodic Hann window (from the second on)
this is the plain transform.

H1 puts all noise on the output: :math:`H_1 = \sum X^* Y/\sum |X|^2` over segments, unbiased by whatever in y is
incoherent with x. So x is the quieter signal: the pressure at the bottom of a cavity, which no boundary layer reaches,
or the voltage of a loudspeaker, which hears no flow.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.engine.blocks import waves
from torchliner.engine.survey import coherence_by_chance
from torchliner.names import WINDOWS

BLOCK = 1 << 14  # samples at once, so that a long record needs no matrix of its length
ELEMENTS = 1 << 22  # values of many signals at once, 32 MB
INDISTINCT = 1e-6  # of the determinant of tone and conjugate; 1 over many periods
FEWEST_SEGMENTS = 8  # that tell sound from flow noise
NO_TONE = 1e-24  # power of a tone over the largest square of its signal
CHANCE = 0.01  # of so high a coherence without any sound


def window_weights(name: str, samples: int) -> Tensor:
    """A window of ``names.WINDOWS`` in its periodic form, float64, (samples,)."""
    hann = require_choice("window", name, WINDOWS) == "hann"
    return torch.hann_window(samples, dtype=torch.float64) if hann else torch.ones(samples, dtype=torch.float64)


def tone_amplitudes(signal: Tensor, frequency: Tensor, sampling_rate: float, weights: Tensor) -> Tensor:
    """Half the complex peak amplitude of tones, phase at the first sample, complex128, (..., F); arguments and errors
    as of ``tone_blocks``."""
    return tone_blocks(signal, frequency, sampling_rate, weights, (0, len(weights)))[0]


def tone_blocks(
    signal: Tensor, frequency: Tensor, sampling_rate: float, weights: Tensor, borders: Sequence[int]
) -> tuple[Tensor, Tensor]:
    """Half the complex peak amplitude A of tones, and what the remainder adds to it in blocks of the record.

    Args:
        signal: real, (..., n).  frequency: Hz, (F,).  sampling_rate: Hz.  weights: window, (n,).
        borders: first samples of S blocks and the end of the last one, from 0 to n.
    Returns:
        A, complex128, (..., F), phase at the first sample; what each block adds, (S, ..., F), of sum 0.
    Raises:
        ValueError: the record is too short to tell the tone from its conjugate and the mean.
    """
    wanted = frequency.to("cpu", torch.float64)
    zero, wave = _row_sums(torch.ones(len(weights)), weights, torch.cat([wanted, 2 * wanted]), sampling_rate, borders)
    (c, s), (c2, s2) = wave.unflatten(-1, (2, 2, -1)).movedim((-2, -3), (0, 1))
    rows = [zero, c, s, c, (zero + c2) / 2, s2 / 2, s, s2 / 2, (zero - c2) / 2]
    normal = torch.stack(torch.broadcast_tensors(*rows), -1).unflatten(-1, (3, 3))  # G, (S, F, 3, 3)
    whole = normal.sum(0)
    blurred = 4 * torch.linalg.det(whole) < INDISTINCT * whole[:, 0, 0] ** 3
    if bool(blurred.any()):
        short, held = float(wanted[blurred].min()), len(weights) / sampling_rate
        few = f"{short * held:.3g} periods of {short:g} Hz, too few to tell this tone from a mean"
        raise ValueError(f"{len(weights)} samples at {sampling_rate:g} Hz hold {few}; take a longer record")
    zero, wave = _row_sums(signal.cpu(), weights, wanted, sampling_rate, borders)
    sums = torch.stack(torch.broadcast_tensors(zero, *wave.chunk(2, -1)), -1)  # B^T W y, (S, ..., F, 3)
    solve = torch.linalg.inv(whole)
    fitted = torch.einsum("fij,...fj->...fi", solve, sums.sum(0))
    left = torch.einsum("fij,s...fj->s...fi", solve, sums - torch.einsum("sfij,...fj->s...fi", normal, fitted))
    amplitude, added = (torch.complex(each[..., 1], -each[..., 2]) / 2 for each in (fitted, left))
    return amplitude, added


def _row_sums(
    values: Tensor, weights: Tensor, lines: Tensor, sampling_rate: float, borders: Sequence[int]
) -> tuple[Tensor, Tensor]:
    """Weighted sums over each block of real values (..., n), (S, ..., 1), and of these times cos, then sin, of L lines
    (Hz), (S, ..., 2 L)."""
    found = weights.new_zeros(len(borders) - 1, *values.shape[:-1], 1 + 2 * len(lines))
    step = min(BLOCK, max(1, ELEMENTS // max(1, math.prod(values.shape[:-1]))))
    for block, (begin, end) in enumerate(pairwise(borders)):
        for low in range(begin, end, step):
            high = min(end, low + step)
            found[block] += (values[..., low:high] * weights[low:high]) @ waves(lines, sampling_rate, low, high).T
    return found[..., :1], found[..., 1:]


def segment_amplitudes(
    signal: Tensor,
    frequency: Tensor,
    sampling_rate: float,
    *,
    window: str = "hann",
    segment: float | None = None,
    start: float = 0.0,
) -> Tensor:
    """Complex tone amplitudes, see ``tone_blocks``, of each segment, (S, ..., F), on one clock.

    Args:
        signal: real, (..., T).  frequency: Hz, (F,).  sampling_rate: Hz.  window: of ``names.WINDOWS``.
        segment: s, overlapping by half; None for one segment of the whole record.
        start: s at the beginning that are left out.
    Raises:
        ValueError: no segment fits, or one is too short for a frequency.
    """
    whole = signal.shape[-1] / sampling_rate
    size = whole - start if segment is None else segment
    if not (start >= 0 and 2 <= size * sampling_rate < (whole - start) * sampling_rate + 0.5):
        raise ValueError(f"segment is {size:g} s from {start:g} s on; it must hold 2 samples or more of {whole:g} s")
    first, length = round(start * sampling_rate), round(size * sampling_rate)
    weights, step = window_weights(window, length), length // 2
    frames = signal[..., first:].unfold(-1, length, step)  # a view, (..., S, n)
    # Each frame was read from its own first sample on.
    starts = first + step * torch.arange(frames.shape[-2])
    turns = 2 * torch.pi / sampling_rate * torch.outer(starts, frequency.cpu())
    return (tone_amplitudes(frames, frequency, sampling_rate, weights) * torch.exp(-1j * turns)).movedim(-2, 0)


def transfer(driver: Tensor, response: Tensor) -> tuple[Tensor, Tensor]:
    """H1 = response/driver of amplitudes of segments, (S, ..., F) each, and the squared coherence, 0 to 1, nan of a
    single segment, where it would always be 1: (..., F); leading axes broadcast.

    Over segments at their own bins this is scipy's csd(driver, response)/welch(driver).
    """
    across = (driver.conj() * response).sum(0)
    driving, answering = driver.abs().square().sum(0), response.abs().square().sum(0)
    coherence = across.abs().square() / (driving * answering)
    return across / driving, coherence if len(driver) > 1 else torch.full_like(coherence, torch.nan)


def reject_flow_noise(
    pressure: Tensor,
    reference: Tensor,
    frequency: Tensor,
    sampling_rate: float,
    *,
    segment: float | None = None,
    name: str = "microphones",
) -> tuple[Tensor, Tensor, list[str]]:
    r"""Tones of microphones under flow that are coherent with a reference channel, which hears no flow.

    The amplitude :math:`H_1 |X|_{rms}` is that of the sound. S segments that overlap by half count as
    :math:`n = S/(1 + 2\rho(S-1)/S)`, :math:`\rho = \sum w(t)w(t+T/2)/\sum w^2`, 11.4 of 15, since a tone is the same in
    every segment. Turbulence leaves a standard deviation of :math:`\sqrt{(1-\gamma^2)/(2(n-1)\gamma^2)}`, relative and
    in radians (Bendat & Piersol, Random Data, section 9.2).

    Args:
        pressure: Pa, real, (..., T).  reference: of any unit, real, (T,), on the same times.
        frequency: Hz, (F,).  sampling_rate: Hz.
        segment: s, overlapping by half; default an eighth of the record, 15 segments.
        name: for messages.
    Returns:
        Complex peak amplitudes of the sound alone, phase relative to the reference, and their squared coherence, (...,
        F) each; what was warned of.
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
    x, y = (segment_amplitudes(each, frequency, sampling_rate, segment=length) for each in (driver, pressure))
    if len(x) < FEWEST_SEGMENTS:
        few = f"{len(x)} segments of {length:g} s fit; at least {FEWEST_SEGMENTS} are needed to tell sound from noise"
        raise ValueError(f"{name}: {few}: shorten the segment")
    power = x.abs().square().mean(0).reshape(-1)
    absent = power <= NO_TONE * reference.to(torch.float64).square().max()
    if bool(absent.any()):
        raise ValueError(f"{name}: the reference has no tone at {float(frequency[absent][0]):g} Hz; name those played")
    weights = window_weights("hann", round(length * sampling_rate))
    half = len(weights) // 2
    rho = float((weights[:-half] * weights[half:]).sum() / weights.square().sum())
    limit = coherence_by_chance(len(x) / (1 + 2 * rho * (len(x) - 1) / len(x)), CHANCE)
    response, coherence = transfer(x, y)
    coherence, notes = coherence.clamp(max=1), list[str]()
    if bool((low := coherence < limit).any()):
        worst = f"{float(coherence.min()):.2g} at {float(frequency[int(coherence.argmin()) % len(frequency)]):g} Hz"
        count = f"below {limit:.2g} in {int(low.sum())} of {coherence.numel()} values"
        why = "flow noise alone reaches that once in a hundred times; record longer"
        notes = [f"{name}: the coherence with the reference is {worst}, {count}: {why}"]
    tell(notes)
    return 2 * response * power.sqrt(), coherence, notes
