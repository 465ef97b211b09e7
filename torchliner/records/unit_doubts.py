"""Levels that look like pascals and phases that look like radians: only a person knows for sure."""

from __future__ import annotations

import math

from torch import Tensor

LIKE_PASCALS = 20.0  # dB, below any duct's sound
TURN = 0.5  # rad, of a plane wave from end to end: more must show in phases in degrees


def unit_doubts(
    name: str, level: Tensor, phase: Tensor, waves_per_metre: float, length: float
) -> tuple[str, ...]:
    """What makes the units of a table doubtful, in words.

    Args:
        name: of the record.
        level: dB.  phase: degrees, of the same shape.
        waves_per_metre: f/c of the highest frequency, 1/m.
        length: between the outermost microphones, m.
    """
    found = []
    if float(level.max()) < LIKE_PASCALS:
        found.append(
            f"{name}: the highest level is {float(level.max()):.3g} dB; are these pascals? SPL in "
            "dB re 20 uPa rms is needed"
        )
    turn = 2 * math.pi * waves_per_metre * length
    largest = float(phase.abs().max())
    if largest <= 2 * math.pi and turn > TURN:
        found.append(
            f"{name}: no phase is beyond {largest:.3g}, while a plane wave turns by "
            f"{math.degrees(turn):.0f} degrees along the line; are these radians? Degrees are "
            "needed"
        )
    return tuple(found)
