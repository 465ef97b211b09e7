r"""How much of a signal keeps step with a tone: at the tone, at its harmonics, and the rest.

Over blocks of whole periods mean, tone and harmonics are fitted by least squares, which is exact in
any record. With :math:`A_s` the amplitude in block s of S, the power that keeps its phase is

.. math:: \tfrac12\,\frac{|\sum_s A_s|^2 - \sum_s |A_s|^2}{S(S-1)},

the products of different blocks alone: noise in them is independent and has no mean there, whereas
:math:`|\langle A_s\rangle|^2` would count 1/S of the noise as tone.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import require_positive

FEWEST_BLOCKS = 2


@dataclass(frozen=True)
class PhaseLocked:
    """Powers of a signal, squares of its unit, each (...).

    Args:
        variance: of the signal over the blocks.
        tone, harmonics: that keep their phase from block to block; estimates without bias, so a
            small one may be negative.
        blocks: S.
    """

    variance: Tensor
    tone: Tensor
    harmonics: Tensor
    blocks: int

    @property
    def rest(self) -> Tensor:
        """What does not keep step: turbulence, subharmonics, drift."""
        return self.variance - self.tone - self.harmonics


def phase_locked_power(
    signal: Tensor, frequency: float, sampling_rate: float, highest: int = 8, periods: int = 2
) -> PhaseLocked:
    """Power at a tone and at its harmonics 2 to ``highest`` that keeps its phase.

    Args:
        signal: real, (..., n); what is left over beyond whole blocks is cut at the start.
        frequency: Hz.
        sampling_rate: Hz, above twice the highest harmonic.
        periods: of the tone in a block; 2 or more, so that a block can tell a subharmonic.
    Raises:
        ValueError: fewer than two blocks, or a harmonic at or above Nyquist.
    """
    require_positive("frequency (Hz)", frequency)
    require_positive("sampling_rate (Hz)", sampling_rate)
    if 2 * highest * frequency >= sampling_rate:
        raise ValueError(
            f"harmonic {highest} of {frequency:g} Hz is not below half the sampling rate, {sampling_rate / 2:g} Hz"
        )
    samples = signal.shape[-1]
    length = periods * sampling_rate / frequency
    blocks = int(samples / length + 1e-6)
    if blocks < FEWEST_BLOCKS:
        raise ValueError(
            f"{samples} samples hold {samples / length * periods:.3g} periods of {frequency:g} Hz; "
            f"{FEWEST_BLOCKS} blocks of {periods} are needed to tell what keeps its phase"
        )
    ends = [samples - round((blocks - s) * length) for s in range(blocks + 1)]
    parts = [
        _amplitudes(signal[..., low:high], low, frequency, sampling_rate, highest)
        for low, high in itertools.pairwise(ends)
    ]
    amplitude = torch.stack(parts)
    locked = amplitude.sum(0).square() - amplitude.square().sum(0)
    power = 0.5 * (locked / (blocks * (blocks - 1))).sum(-2)
    used = signal[..., ends[0] :].to(torch.float64)
    return PhaseLocked(used.var(-1, correction=0), power[..., 0], power[..., 1:].sum(-1), blocks)


def _amplitudes(signal: Tensor, begin: int, frequency: float, sampling_rate: float, highest: int) -> Tensor:
    """Cosine and sine amplitudes of harmonics 1 to ``highest``, (..., 2, highest)."""
    time = torch.arange(begin, begin + signal.shape[-1], dtype=torch.float64) / sampling_rate
    turns = 2 * torch.pi * frequency * torch.outer(time, torch.arange(1, highest + 1))
    model = torch.cat([turns.cos(), turns.sin(), torch.ones_like(time)[:, None]], dim=1)
    flat = signal.to("cpu", torch.float64).reshape(-1, signal.shape[-1])
    found = torch.linalg.lstsq(model, flat.T).solution[:-1]
    return found.T.reshape(*signal.shape[:-1], 2, highest)
