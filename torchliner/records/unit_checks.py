"""Levels that look like pascals, phases like radians, metres like mm and Hz like kHz."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.records.case import LOUDEST, QUIETEST

LOWEST_TONE = 20.0  # Hz: below, no liner is tuned and no ear hears
LOWEST_RATE = 500.0  # Hz
# m: what a liner's data may span, and lie above it; a boundary layer's displacement.
LONGEST, HIGHEST, THICKEST = 20.0, 0.05, 0.1
# m: probes this far apart, over so long a plane, see no cell of a liner.
APART, LONG = 0.05, 1.0
SAMPLES = (4.0, 1e5)  # of a period: fewer show no velocity, more are no measurement of a tone
LIKE_PASCALS = 20.0  # dB, below any duct's sound
TURN = 0.5  # rad, of a plane wave from end to end: more must show in phases in degrees
# Over half a wavelength even a standing wave turns by pi, so that in degrees the steps from
# microphone to microphone add up to some 57 times those in radians.
WHOLE = math.pi
NEAR = 4.0  # by which the steps, taken as radians, may miss a plane wave's


def require_pressures(pressure: Tensor, frequency: Tensor, name: str) -> None:
    """Refuse amplitudes above one atmosphere, and lines whose loudest is below its last digit: what
    is no pressure in Pa also overflows, or vanishes, in sums of squares.

    Args:
        pressure: complex, peak, Pa, (..., N, F).  frequency: Hz, (F,).  name: of the record.
    Raises:
        ValueError: with the level, the frequency and the limit.
    """
    loudest = spl_from_pressure_amplitude(pressure.detach().to(torch.complex128)).amax(-2)
    for bad, limit in ((loudest > LOUDEST, f"above {LOUDEST:g}"), (loudest < QUIETEST, f"below {QUIETEST:g}")):
        if bool(bad.any()):
            place = bad.nonzero()[0].tolist()
            raise ValueError(
                f"{name}: the loudest microphone at {float(frequency[place[-1]]):g} Hz has "
                f"{float(loudest[tuple(place)]):.4g} dB, {limit} dB; complex peak amplitudes in Pa "
                "are needed"
            )


def plane_unit_warnings(plane: Any, frequency: float | None) -> list[str]:
    """Why numbers of a plane may be in other units than Hz, m and dB, or not be meant.

    Args:
        plane: a ``VelocityPlane``.
        frequency: the lowest that is asked for, Hz; None if none is.
    """
    spans = [
        (f"{key} spans", float(values.max() - values.min()), LONGEST, "m", "mm")
        for key in ("x", "z")
        if (values := getattr(plane, key)) is not None
    ]
    found = [
        f"{what} {value:.4g} {unit}, above {limit:g} {unit}; are these {other}?"
        for what, value, limit, unit, other in (
            *spans,
            ("the height is", plane.height or 0.0, HIGHEST, "m", "mm"),
            ("displacement_thickness is", plane.displacement_thickness or 0.0, THICKEST, "m", "mm"),
        )
        if value > limit
    ]
    found += [
        f"{what} {value:.4g} {unit}, below {limit:g} {unit}; are these {other}?"
        for what, value, limit, unit, other in (
            ("the frequency is", frequency or LOWEST_TONE, LOWEST_TONE, "Hz", "kHz"),
            ("the sampling rate is", plane.sampling_rate, LOWEST_RATE, "Hz", "kHz"),
            ("the incident level is", plane.incident_level or LIKE_PASCALS, LIKE_PASCALS, "dB", "pascals"),
        )
        if value < limit
    ]
    apart, span = _steps_of(plane.x)
    if apart > APART and LONG < span <= LONGEST:
        found.append(f"x runs in steps of {apart:.4g} m over {span:.4g} m; are these mm?")
    found = [f"{plane.name}: {text} SI units and dB re 20 uPa rms are needed" for text in found]
    per_period = plane.sampling_rate / frequency if frequency else SAMPLES[0]
    if not SAMPLES[0] <= per_period <= SAMPLES[1]:
        found.append(
            f"{plane.name}: {per_period:.4g} samples a period of {frequency:.6g} Hz; "
            f"{SAMPLES[0]:g} to {SAMPLES[1]:.0f} are plausible: check sampling rate and frequency"
        )
    return found


def height_warnings(plane: Any, cell_pitch: float | None) -> list[str]:
    """Whether a plane lies too high above a liner of that cell pitch (m) to see its cells."""
    if cell_pitch is None or plane.height is None or plane.height <= cell_pitch:
        return []
    return [
        f"{plane.name} lies {1e3 * plane.height:.4g} mm above the liner, more than its cell pitch "
        f"of {1e3 * cell_pitch:.4g} mm: the velocity of the cells is hardly seen there"
    ]


def _steps_of(x: Tensor | None) -> tuple[float, float]:
    """Median step of the places along x, and from the first to the last, m."""
    if x is None or x.numel() < 2:
        return 0.0, 0.0
    places = x.unique()
    steps = places.diff()
    return (float(steps.median()) if len(steps) else 0.0), float(places[-1] - places[0])


def unit_warnings(name: str, level: Tensor, phase: Tensor, waves_per_metre: Tensor, length: float) -> tuple[str, ...]:
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
