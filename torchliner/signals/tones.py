"""Lines of a signal at given frequencies, and the tones behind them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

BLOCK = 1 << 14  # samples at once, so that a long record needs no matrix of its length
ELEMENTS = 1 << 22  # complex values of many signals at once, 64 MB
STEP = 256  # samples whose waves are computed, and turned to wherever they are needed
INDISTINCT = 1e-6  # of the determinant of tone and conjugate; 1 over many periods


def line_sums(values: Tensor, frequency: Tensor, sampling_rate: float, begin: int = 0) -> Tensor:
    """sum over k of values[k] e^{-j omega (begin + k)/fs}: complex128, (..., F).

    Args:
        values: real or complex, (..., n).  frequency: Hz, (F,).  sampling_rate: Hz.
        begin: sample number of the first value.
    """
    batch = values.shape[:-1]
    total = torch.zeros((*batch, len(frequency)), dtype=torch.complex128)
    step = min(BLOCK, max(1, ELEMENTS // max(1, math.prod(batch))))
    for low in range(0, values.shape[-1], step):
        part = values[..., low : low + step].to("cpu", torch.complex128)
        end = begin + low + part.shape[-1]
        total += part @ waves(frequency, sampling_rate, begin + low, end).T
    return total


def waves(frequency: Tensor, sampling_rate: float, begin: int, end: int) -> Tensor:
    """e^{-j omega t} at samples begin .. end - 1, complex128, (F, t)."""
    turn = (2 * torch.pi / sampling_rate * frequency.cpu())[:, None]
    own = torch.exp(-1j * turn * torch.arange(min(end - begin, STEP), dtype=torch.float64))
    starts = torch.arange(begin, max(end, begin + 1), STEP, dtype=torch.float64)
    found = torch.exp(-1j * turn * starts)[:, :, None] * own[:, None]
    return found.flatten(1)[:, : end - begin]


@dataclass(frozen=True)
class WindowSums:
    """The window's own sums at each frequency, S0 = sum w and S2 = sum w e^{-2 j omega t}, and
    those at the turns of a phase rule, (F, Q), where it asks for them."""

    zero: Tensor
    twice: Tensor
    turned: Tensor | None = None

    @classmethod
    def of(cls, weights: Tensor, start: int, frequency: Tensor, sampling_rate: float) -> WindowSums:
        """Sums of a window of N samples that begins at sample ``start``."""
        return cls(weights.sum(), line_sums(weights, 2 * frequency, sampling_rate, start))

    def tone_amplitude(self, line: Tensor) -> Tensor:
        """Amplitude A of A e^{j omega t} + A* e^{-j omega t} from its windowed line (..., F).

        The conjugate term leaks into the line unless the window spans whole periods; both are
        solved for, so a tone is recovered exactly from any record.
        """
        determinant = self.zero**2 - self.twice.abs() ** 2
        return line * (self.zero / determinant) - line.conj() * (self.twice / determinant)


def tone_amplitudes(signal: Tensor, frequency: Tensor, sampling_rate: float, weights: Tensor, begin: int = 0) -> Tensor:
    r"""Amplitude A of the tone in m + A e^{j omega t} + A* e^{-j omega t}, exact in any record.

    With the window's sums :math:`S_q = \sum w\,e^{-jq\omega t}` the windowed lines of such a signal
    are :math:`L_1 = A S_0 + A^* S_2 + m S_1` and :math:`L_0 = m S_0 + 2 Re(A S_1^*)`. The mean m is
    eliminated, :math:`L = L_1 - S_1 L_0/S_0`, and leaves the two equations of
    ``WindowSums.tone_amplitude`` with S0 - \|S1\|^2/S0 and S2 - S1^2/S0 in place of S0 and S2. At
    the bins of a periodic Hann window (from the second on) all this is the plain transform.

    Args:
        signal: real, (..., n).  frequency: Hz, (F,).  sampling_rate: Hz.  weights: window, (n,).
        begin: sample number of the first value; the phase is that at sample 0.
    Returns:
        Half the complex peak amplitude, complex128, (..., F).
    Raises:
        ValueError: the record is too short to tell the tone from its conjugate and the mean.
    """
    wanted = frequency.to("cpu", torch.float64)
    plain = WindowSums.of(weights, begin, wanted, sampling_rate)
    once = line_sums(weights, wanted, sampling_rate, begin)
    window = WindowSums(plain.zero - once.abs() ** 2 / plain.zero, plain.twice - once**2 / plain.zero)
    blurred = (window.zero**2 - window.twice.abs() ** 2) / plain.zero**2 < INDISTINCT
    if bool(blurred.any()):
        short = float(wanted[blurred].min())
        periods = len(weights) / sampling_rate * short
        raise ValueError(
            f"{len(weights)} samples at {sampling_rate:g} Hz hold {periods:.3g} periods of "
            f"{short:g} Hz, too few to tell this tone from a mean; take a longer record"
        )
    weighted = signal.to("cpu", torch.float64) * weights
    line = line_sums(weighted, wanted, sampling_rate, begin)
    line = line - once / plain.zero * weighted.sum(-1, keepdim=True)
    return window.tone_amplitude(line)
