"""Draws of the error of microphones: independent in level and in phase."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchliner.checks import whole_number

LEVEL_ERROR, PHASE_ERROR = 0.1, 0.1  # dB and degrees, section 5.5.5


def require_draws(draws: int) -> None:
    """Refuse a number of draws that has no deviation; 0 is none.

    Raises:
        TypeError, ValueError: no whole number, below 0, or 1.
    """
    if whole_number("draws", draws) < 0 or draws == 1:
        raise ValueError(f"draws is {draws}; 0 for none, or at least 2, since one has no deviation")


def draw_pressures(
    pressure: Tensor, draws: int, generator: torch.Generator, *, level_error: float = LEVEL_ERROR,
    phase_error: float = PHASE_ERROR,
) -> Tensor:  # fmt: skip
    """Pressures with errors, (D, ..., N, F).

    Args:
        pressure: complex, Pa, (..., N, F).  draws: D.  generator: of random numbers, on the CPU.
        level_error: standard deviation of the SPL, dB.
        phase_error: standard deviation of the phase, degrees.
    Raises:
        ValueError: no draw, or an error below 0.
    Source: Roncen et al. (2026), section 5.5.5: 0.1 dB, 0.1 degrees, 500 realisations.
    """
    if draws < 1:
        raise ValueError(f"draws is {draws}; at least 1")
    for name, value in (("level_error (dB)", level_error), ("phase_error (degrees)", phase_error)):
        if not 0 <= value < math.inf:
            raise ValueError(f"{name} is {value:g}; it must be finite and at least 0")
    noise = torch.randn(2, draws, *pressure.shape, generator=generator, dtype=torch.float64)
    nepers = noise[0] * level_error * math.log(10) / 20
    turns = noise[1] * math.radians(phase_error)
    factor = torch.exp(torch.complex(nepers, turns)).to(pressure.device)
    return pressure * factor
