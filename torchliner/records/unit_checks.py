"""Levels that look like pascals, phases that look like radians, and those that nobody measures."""

from __future__ import annotations

import math

from torch import Tensor

LOUDEST = 194.0  # dB: a peak of one atmosphere
WIDEST = 100.0  # dB below the loudest: 16 bits hold 96
MOST_DEGREES = 360e3  # a thousand turns; beyond, a phase is no measured one
LIKE_PASCALS = 20.0  # dB, below any duct's sound
TURN = 0.5  # rad, of a plane wave from end to end: more must show in phases in degrees
# Over half a wavelength even a standing wave turns by pi, so that in degrees the steps from
# microphone to microphone add up to some 57 times those in radians.
WHOLE = math.pi
NEAR = 4.0  # by which the steps, taken as radians, may miss a plane wave's


def require_measurable(name: str, level: Tensor, phase: Tensor, count: int) -> None:
    """Refuse levels and phases out of any range.

    Args:
        name: of the record.
        level: dB.  phase: degrees, of the same shape, (..., N, F) or (..., N).
        count: N.
    Raises:
        ValueError: a level is above ``LOUDEST`` or ``WIDEST`` below the loudest at its frequency, a
            phase beyond ``MOST_DEGREES``.
    """
    if level.numel() == 0:
        return
    single = level.ndim == 1 or level.shape[-2] != count
    axis = -1 if single else -2
    for bad, value, unit, why in (
        (level > LOUDEST, level, "dB", f"above {LOUDEST:g} dB, where the amplitude is one "
         "atmosphere; SPL in dB re 20 uPa rms is needed"),
        (level < level.amax(axis, keepdim=True) - WIDEST, level, "dB", f"more than {WIDEST:g} dB "
         "below the loudest; correct it or leave that microphone out"),
        (phase.abs() > MOST_DEGREES, phase, "degrees", f"beyond {MOST_DEGREES:g} degrees; correct "
         "it or leave that microphone out"),
    ):  # fmt: skip
        if bool(bad.any()):
            place = bad.nonzero()[0].tolist()
            raise ValueError(
                f"{name}: microphone {place[axis]} has {float(value[tuple(place)]):.4g} {unit}, "
                f"{why}"
            )


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
