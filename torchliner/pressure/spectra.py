r"""Tones of signals, exact in any record, and transfer functions between signals.

H1 puts all noise on the output: :math:`H_1 = \sum X^* Y/\sum |X|^2` over segments, unbiased by whatever in y is
incoherent with x. So x is the quieter signal: the pressure at the bottom of a cavity, which no boundary layer reaches,
or the voltage of a loudspeaker, which hears no flow.
"""

import math
from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.engine.blocks import waves
from torchliner.engine.survey import coherence_by_chance

BLOCK = 1 << 14  # samples at once, so that a long record needs no matrix of its length
ELEMENTS = 1 << 22  # values of many signals at once, 32 MB
INDISTINCT = 1e-6  # of the determinant of tone and conjugate; 1 over many periods
FEWEST_SEGMENTS = 8  # that tell sound from flow noise
NO_TONE = 1e-24  # power of a tone over the largest square of its signal
CHANCE = 0.01  # of so high a coherence without any sound


def window_weights(name: Any, samples: int) -> Tensor:
    """A window of scipy in its periodic form, float64, (samples,); ``name``: ``hann`` and so on, with parameters as
    text, ``"kaiser,8"``, or as scipy takes it, ``("kaiser", 8)``. ValueError for one that scipy does not know."""
    if name in ("boxcar", "hann"):  # without scipy.signal, which takes half a second or more to import
        plain = torch.ones(samples) if name == "boxcar" else torch.hann_window(samples, dtype=torch.float64)
        return plain.double()
    from scipy.signal import get_window

    kind, *parameters = name.split(",") if isinstance(name, str) else name
    try:
        window: Any = (kind, *map(float, parameters))
        return torch.as_tensor(get_window(window, samples)).double()
    except (ValueError, TypeError) as error:
        raise ValueError(f"unknown window {name!r}: {error}; any of scipy.signal.get_window will do") from error


def tone_amplitudes(signal: Tensor, frequency: Tensor, sampling_rate: float, weights: Tensor, begin: int = 0) -> Tensor:
    r"""Amplitude A of the tone in m + A e^{j omega t} + A* e^{-j omega t}, exact in any record.

    With the window's sums :math:`S_q = \sum w\,e^{-jq\omega t}` the windowed lines of such a signal are
    :math:`L_1 = A S_0 + A^* S_2 + m S_1` and :math:`L_0 = m S_0 + 2 Re(A S_1^*)`. Without the mean m,
    :math:`L_1 - S_1 L_0/S_0 = A a + A^* b` with :math:`a = S_0 - |S_1|^2/S_0, b = S_2 - S_1^2/S_0`, which is solved
    for A. At the bins of a periodic Hann window (from the second on) this is the plain transform.

    Args:
        signal: real, (..., n).  frequency: Hz, (F,).  sampling_rate: Hz.  weights: window, (n,).
        begin: sample number of the first value; the phase is that at sample 0.
    Returns:
        Half the complex peak amplitude, complex128, (..., F).
    Raises:
        ValueError: the record is too short to tell the tone from its conjugate and the mean.
    """
    wanted = frequency.to("cpu", torch.float64)
    zero, once = _line_sums(weights, wanted, sampling_rate, begin)
    _, twice = _line_sums(weights, 2 * wanted, sampling_rate, begin)
    a, b = zero - once.abs() ** 2 / zero, twice - once**2 / zero
    determinant = a**2 - b.abs() ** 2
    blurred = determinant / zero**2 < INDISTINCT
    if bool(blurred.any()):
        short = float(wanted[blurred].min())
        raise ValueError(
            f"{len(weights)} samples at {sampling_rate:g} Hz hold {len(weights) / sampling_rate * short:.3g} periods "
            f"of {short:g} Hz, too few to tell this tone from a mean; take a longer record"
        )
    mean, line = _line_sums(signal.to("cpu", torch.float64) * weights, wanted, sampling_rate, begin)
    line = line - once / zero * mean
    return line * (a / determinant) - line.conj() * (b / determinant)


def _line_sums(values: Tensor, frequency: Tensor, sampling_rate: float, begin: int) -> tuple[Tensor, Tensor]:
    """Sums over samples of real values (..., n), (..., 1), and of these times e^{-j omega t}, (..., F)."""
    batch, count = values.shape[:-1], len(frequency)
    total = torch.zeros((*batch, 1 + 2 * count), dtype=torch.float64)
    step = min(BLOCK, max(1, ELEMENTS // max(1, math.prod(batch))))
    for low in range(0, values.shape[-1], step):
        part = values[..., low : low + step]
        total += part @ waves(frequency, sampling_rate, begin + low, begin + low + part.shape[-1]).T
    return total[..., :1], torch.complex(total[..., 1 : 1 + count], -total[..., 1 + count :])


def segment_amplitudes(
    signal: Tensor,
    frequency: Tensor,
    sampling_rate: float,
    *,
    window: Any = "hann",
    segment: float | None = None,
    start: float = 0.0,
) -> Tensor:
    """Complex tone amplitudes, see ``tone_amplitudes``, of each segment, (S, ..., F), on one clock.

    Args:
        signal: real, (..., T).  frequency: Hz, (F,).  sampling_rate: Hz.  window: any window of scipy.
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
    together = max(1, ELEMENTS // (length * max(1, math.prod(signal.shape[:-1]))))
    parts = [tone_amplitudes(each, frequency, sampling_rate, weights) for each in frames.split(together, -2)]
    # Each frame was read from its own first sample on.
    starts = first + step * torch.arange(frames.shape[-2])
    turns = 2 * torch.pi / sampling_rate * torch.outer(starts, frequency.cpu())
    return (torch.cat(parts, dim=-2) * torch.exp(-1j * turns)).movedim(-2, 0)


class Transfer(NamedTuple):
    """H1 = Y/X, complex128, (..., F), its squared coherence, 0 to 1 (nan from a single segment, where it would always
    be 1), the mean of |X|^2 over the segments, and their number."""

    response: Tensor
    coherence: Tensor
    driver_power: Tensor
    segments: int


def transfer_from_amplitudes(driver: Tensor, response: Tensor) -> Transfer:
    """H1 from amplitudes of segments, (S, ..., F) each; leading axes broadcast."""
    across = (driver.conj() * response).sum(0)
    driving, answering = driver.abs().square().sum(0), response.abs().square().sum(0)
    coherence = across.abs().square() / (driving * answering)
    if len(driver) == 1:
        coherence = torch.full_like(coherence, torch.nan)
    return Transfer(across / driving, coherence, driving / len(driver), len(driver))


def transfer_function(driver: Tensor, response: Tensor, *about: Any, **cut: Any) -> Transfer:
    """H1 = response/driver of two real signals, (..., T), at the same times; the rest as for ``segment_amplitudes``.

    Over segments at their own bins this is scipy's csd(driver, response)/welch(driver); tones come out exactly between
    the bins too.
    """
    return transfer_from_amplitudes(*(segment_amplitudes(x, *about, **cut) for x in (driver, response)))


# Under flow


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

    The amplitude :math:`H_1 |X|_{rms}` is that of the sound. Turbulence, of power (1 - coherence) of the whole, leaves
    the relative standard deviation :math:`\sqrt{(1-\gamma^2)/(2(n-1)\gamma^2)}` in amplitude and, in radians, in phase
    (Bendat & Piersol, Random Data, section 9.2; n - 1 since the coherence is estimated from the same segments). S
    segments that overlap by half count as :math:`n = S/(1 + 2\rho(S-1)/S)`, :math:`\rho = \sum w(t)w(t+T/2)/\sum w^2`:
    11.4 of 15 for the Hann window. Welch's :math:`\rho^2` would be for a random reference; that of a tone is the same
    in every segment.

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
    found = transfer_function(driver, pressure, frequency, sampling_rate, window="hann", segment=length)
    if found.segments < FEWEST_SEGMENTS:
        raise ValueError(
            f"{name}: {found.segments} segments of {length:g} s fit; at least {FEWEST_SEGMENTS} are needed to tell "
            "sound from flow noise: shorten the segment"
        )
    power = found.driver_power.reshape(-1)
    absent = power <= NO_TONE * reference.to(torch.float64).square().max()
    if bool(absent.any()):
        raise ValueError(f"{name}: the reference has no tone at {float(frequency[absent][0]):g} Hz; name those played")
    weights = window_weights("hann", round(length * sampling_rate))
    half = len(weights) // 2
    rho = float((weights[:-half] * weights[half:]).sum() / weights.square().sum())
    independent = found.segments / (1 + 2 * rho * (found.segments - 1) / found.segments)
    coherence = found.coherence.clamp(max=1)
    error = ((1 - coherence) / (2 * (independent - 1) * coherence)).sqrt()
    limit, notes = coherence_by_chance(independent, CHANCE), []
    if bool((coherence < limit).any()):
        worst = coherence.reshape(-1, len(frequency)).amin(0)
        notes = [
            f"{name}: the coherence with the reference is {float(worst.min()):.2g} at "
            f"{float(frequency[worst.argmin()]):g} Hz, below {limit:.2g} in {int((coherence < limit).sum())} of "
            f"{coherence.numel()} values: flow noise alone reaches that once in a hundred times; record longer"
        ]
    tell(notes)
    return RejectedFlow(2 * found.response * power.sqrt(), coherence, error, found.segments, tuple(notes))
