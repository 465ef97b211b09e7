"""Levels that look like pascals and phases that look like radians."""

from __future__ import annotations

import math

from torch import Tensor

LIKE_PASCALS = 20.0  # dB, below any duct's sound
TURN = 0.5  # rad, of a plane wave from end to end: more must show in phases in degrees
# Over half a wavelength even a standing wave turns by pi, so that in degrees the steps from
# microphone to microphone add up to some 57 times those in radians.
WHOLE = math.pi
NEAR = 4.0  # by which the steps, taken as radians, may miss a plane wave's


def unit_warnings(
    name: str, level: Tensor, phase: Tensor, waves_per_metre: Tensor, length: float
) -> tuple[str, ...]:
    """Why the units of a table may not be what they should be.

    Args:
        name: of the record.
        level: dB.  phase: degrees, of the same shape, (..., N, F).
        waves_per_metre: f/c, 1/m, (F,).
        length: between the outermost microphones, m.
    """
    found = []
    if float(level.max()) < LIKE_PASCALS:
        found.append(
            f"{name}: the highest level is {float(level.max()):.3g} dB; are these pascals? SPL in "
            "dB re 20 uPa rms is needed"
        )
    turn = 2 * math.pi * waves_per_metre * length
    largest, most = float(phase.abs().max()), float(turn.max())
    if largest <= 2 * math.pi and most > TURN:
        found.append(
            f"{name}: no phase is beyond {largest:.3g}, while a plane wave turns by "
            f"{math.degrees(most):.0f} degrees along the line; are these radians? Degrees are "
            "needed"
        )
    elif _turns_in_radians(phase, turn):
        found.append(
            f"{name}: from microphone to microphone the phases change by "
            f"{float(_steps(phase).max()):.3g} in sum, while a plane wave turns by {most:.3g} rad, "
            f"{math.degrees(most):.0f} degrees; are these radians, unwrapped? Degrees are needed"
        )
    return tuple(found)


def _turns_in_radians(phase: Tensor, turn: Tensor) -> bool:
    """At every frequency with half a wavelength on the line and no step beyond one."""
    known = (turn >= WHOLE) & (turn <= math.pi * (phase.shape[-2] - 1))
    if not bool(known.any()):
        return False
    ratio = _steps(phase)[..., known] / turn[known]
    return bool(((ratio > 1 / NEAR) & (ratio < NEAR)).all())


def _steps(phase: Tensor) -> Tensor:
    return phase.diff(dim=-2).abs().sum(-2)
