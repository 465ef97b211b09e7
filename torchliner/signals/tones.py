"""Lines of a signal at given frequencies."""

from __future__ import annotations

import torch
from torch import Tensor

BLOCK = 1 << 14  # samples at once, so that a long record needs no matrix of its length


def line_sums(values: Tensor, frequency: Tensor, sampling_rate: float, begin: int = 0) -> Tensor:
    """sum over k of values[k] e^{-j omega (begin + k)/fs}: complex128, (F,).

    Args:
        values: real or complex, (n,).
        frequency: Hz, (F,).
        sampling_rate: Hz.
        begin: sample number of the first value.
    """
    total = torch.zeros(len(frequency), dtype=torch.complex128)
    for low in range(0, len(values), BLOCK):
        part = values[low : low + BLOCK].to(torch.complex128)
        total += waves(frequency, sampling_rate, begin + low, begin + low + len(part)) @ part
    return total


def waves(frequency: Tensor, sampling_rate: float, begin: int, end: int) -> Tensor:
    """e^{-j omega t} at samples begin .. end - 1, complex128, (F, t)."""
    steps = torch.arange(begin, end, dtype=torch.float64)
    return torch.exp(-1j * torch.outer(2 * torch.pi / sampling_rate * frequency.cpu(), steps))
