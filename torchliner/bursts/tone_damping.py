r"""What a reconstruction from random samples does to a tone, and the tone put back to its amplitude.

Each method of ``arrivals`` is linear in the values. A tone :math:`v = A e^{j\omega t} + A^* e^{-j\omega t}` known at
the arrivals alone therefore has, on the grid, the windowed line :math:`\hat A = G A + H A^*`: G is the line of the
reconstruction of :math:`e^{j\omega t_i}` and H that of its conjugate, two numbers of the arrival times, of the window
and of the method, known exactly. G is the attenuation; H, which has no mean over arrivals, lets :math:`\hat A` depend
on the phase.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.bursts.arrivals import BAND_SHARE, GridSignal
from torchliner.checks import frequency_tensor
from torchliner.tones import tone_amplitudes, window_weights

LEAST_FACTOR = 0.3  # below, a correction would raise noise by more than a factor 3


@dataclass(frozen=True, eq=False)
class ToneAttenuation:
    """The factors of a tone's line for the arrivals of a signal: line = factor A + image A*.

    Args:
        factor, image: G and H, complex128, (F,).  frequency: Hz, (F,).  weights: of the window, (T,).
    """

    factor: Tensor
    image: Tensor
    frequency: Tensor
    weights: Tensor

    def line(self, signal: GridSignal) -> Tensor:
        """Of the tones as they are in a gridded signal, phase at the grid's start, complex128, (F,)."""
        return tone_amplitudes(signal.values, self.frequency, signal.rate, self.weights)

    def true_amplitude(self, line: Tensor) -> Tensor:
        """A from the windowed lines GA + HA* of the gridded signal, (F,), exactly."""
        determinant = self.factor.abs() ** 2 - self.image.abs() ** 2
        return (self.factor.conj() * line - self.image * line.conj()) / determinant


def tone_attenuation(signal: GridSignal, frequency: Any, window: Any = "hann") -> ToneAttenuation:
    """The complex factors on a tone's windowed line for the arrivals, grid and method of a signal.

    Args:
        signal: from ``onto_grid``; its values do not count.
        frequency: Hz, one or several.
        window: any window of scipy, over the record.
    Raises:
        ValueError: a frequency above half the mean rate, outside the band of the fit or not below half the grid's rate.
    """
    wanted, grid = frequency_tensor(frequency), signal
    highest = float(wanted.max())
    if grid.mean_rate < 2 * highest:
        raise ValueError(
            f"{grid.name}: {grid.mean_rate:.6g} arrivals a second in the mean are fewer than two a period of "
            f"{highest:g} Hz, which cannot be put on a grid (correction='none' leaves a stated tone as it is)"
        )
    if grid.method == "band-limited" and highest >= grid.band:
        raise ValueError(
            f"{grid.name}: {highest:g} Hz is not below the band of the fit, {grid.band:g} Hz; these arrivals carry a "
            f"quarter of the mean rate, {BAND_SHARE * grid.mean_rate:g} Hz"
        )
    frequency_tensor(wanted, grid.rate)
    weights, lines = window_weights(window, grid.samples), []
    for f in wanted:
        turns = 2 * torch.pi * f * (grid.arrival_times - grid.start)
        both = grid.rebuilt(torch.stack([turns.cos(), turns.sin()]))  # two signals in memory at a time
        lines.append(tone_amplitudes(both, f[None], grid.rate, weights)[:, 0])
    # The line is linear over the reals: A = a + jb is v = 2a cos - 2b sin, whose line 2aC - 2bS is GA + HA* for all
    # a, b with G = C + jS, H = C - jS.
    cosine, sine = torch.stack(lines, 1)
    return ToneAttenuation(cosine + 1j * sine, cosine - 1j * sine, wanted, weights)


def corrected_coherent_part(signal: GridSignal, attenuation: ToneAttenuation, *, noise: bool = False) -> GridSignal:
    """The signal with each tone's own part put back to its amplitude, all else untouched.

    Noise at the line is raised by 1/G with it; what the reconstruction took from the turbulence stays lost.

    Args:
        attenuation: from ``tone_attenuation`` of that signal.
        noise: take out the whole reconstruction of the tone, the noise that it made of it too.
    Raises:
        ValueError: a factor below 0.3 (the correction would raise noise by more than 3).
    """
    frequency, smallest = attenuation.frequency, float(attenuation.factor.abs().min())
    if smallest < LEAST_FACTOR:
        raise ValueError(
            f"{signal.name}: {signal.method} reconstruction leaves {smallest:.3g} of the tone, and a correction would "
            f"raise noise {1 / smallest:.3g} times (limit: factor {LEAST_FACTOR:g}); take more arrivals, or no "
            "correction (correction='none')"
        )
    line, seconds = attenuation.line(signal), signal.times - signal.start
    amplitude = attenuation.true_amplitude(line)
    made = _tones(line, frequency, seconds)
    if noise:
        made = signal.rebuilt(_tones(amplitude, frequency, signal.arrival_times - signal.start))
    return replace(signal, values=signal.values + _tones(amplitude, frequency, seconds) - made)


def _tones(amplitude: Tensor, frequency: Tensor, seconds: Tensor) -> Tensor:
    """Sum over f of A e^{j omega t} + A* e^{-j omega t}: (F,) to (t,)."""
    turns = 2 * torch.pi * torch.outer(frequency, seconds)
    return 2 * (amplitude.real @ turns.cos() - amplitude.imag @ turns.sin())
