"""What is emitted at any sample before, in and after a record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from torchliner.signals.tones import waves


class Emission(Protocol):
    """S channels of an incident wave, real or complex."""

    def values(self, begin: int, end: int) -> Tensor:
        """Samples begin .. end - 1, also outside the record, (S, end - begin), 64-bit."""
        ...


@dataclass(frozen=True)
class ComplexTones:
    """exp(+j omega t) for each frequency (Hz, (F,)): what phase averaging replays."""

    frequency: Tensor
    sampling_rate: float

    def values(self, begin: int, end: int) -> Tensor:
        """complex128, (F, t)."""
        return waves(-self.frequency, self.sampling_rate, begin, end)


@dataclass(frozen=True)
class Sent:
    """An incident signal on a record: one real channel.

    Args:
        signal: float64, (n,).
        periodic: whether it goes on outside; else it is zero there.
    """

    signal: Tensor
    periodic: bool

    def values(self, begin: int, end: int) -> Tensor:
        """float64, (1, t)."""
        steps = torch.arange(begin, end)
        n = len(self.signal)
        values = self.signal[steps % n]
        if not self.periodic:
            values = torch.where((steps >= 0) & (steps < n), values, 0.0)
        return values[None]


@dataclass(frozen=True)
class SteadyTones:
    """Tones that were on before the record and stay on: (F,) in Hz, amplitude, rad."""

    frequency: Tensor
    amplitude: Tensor
    phase: Tensor
    sampling_rate: float

    def values(self, begin: int, end: int) -> Tensor:
        """float64, (1, t)."""
        turn = 2 * torch.pi / self.sampling_rate * self.frequency
        steps = torch.arange(begin, end, dtype=torch.float64)
        tones = torch.cos(torch.outer(turn, steps) + self.phase[:, None])
        return (self.amplitude @ tones)[None]
