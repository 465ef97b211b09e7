"""Levels that look like pascals, phases like radians, metres like mm and Hz like kHz."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.records.case import LOUDEST, QUIETEST

LOWEST_TONE, LOWEST_RATE = 20.0, 500.0  # Hz: below, no liner is tuned
# m: what a liner's data may span, and lie above it; a boundary layer's displacement.
LONGEST, HIGHEST, THICKEST = 20.0, 0.05, 0.1
# m: probes this far apart, over so long a plane, see no cell of a liner.
APART, LONG = 0.05, 1.0
SAMPLES = (4.0, 1e5)  # of a period: fewer show no velocity, more are no measurement of a tone
LIKE_PASCALS = 20.0  # dB, below any duct's sound
TURN = 0.5  # rad, of a plane wave from end to end: more must show in phases in degrees
NEAR = 4.0  # by which the steps of phases, taken as radians, may miss a plane wave's


def require_pressures(pressure: Tensor, frequency: Tensor, name: str) -> None:
    """Refuse amplitudes above one atmosphere, and lines whose loudest is below its last digit: what
    is no pressure in Pa also overflows, or vanishes, in sums of squares.

    Args:
        pressure: complex, peak, Pa, (..., N, F).  frequency: Hz, (F,).  name: of the record.
    Raises:
        ValueError: with the level, the frequency and the limits.
    """
    loudest = spl_from_pressure_amplitude(pressure.detach().to(torch.complex128)).amax(-2)
    bad = ((loudest > LOUDEST) | (loudest < QUIETEST)).nonzero()
    if len(bad):
        place = bad[0].tolist()
        raise ValueError(
            f"{name}: the loudest microphone at {float(frequency[place[-1]]):g} Hz has "
            f"{float(loudest[tuple(place)]):.4g} dB, not within {QUIETEST:g} and {LOUDEST:g} dB; complex peak "
            "amplitudes in Pa are needed"
        )


def plane_unit_warnings(plane: Any, frequency: float | None) -> list[str]:
    """Why numbers of a plane may be in other units than Hz, m and dB, or not be meant.

    Args:
        plane: a ``VelocityPlane``.
        frequency: the lowest that is asked for, Hz; None if none is.
    """
    spans = {key: values.unique() for key in "xz" if (values := getattr(plane, key)) is not None}
    tone, level = frequency or LOWEST_TONE, plane.incident_level or LIKE_PASCALS
    checked = [
        *((f"{key} spans", float(at[-1] - at[0]), 0.0, LONGEST, "m", "mm") for key, at in spans.items()),
        ("the height is", plane.height or 0.0, 0.0, HIGHEST, "m", "mm"),
        ("displacement_thickness is", plane.displacement_thickness or 0.0, 0.0, THICKEST, "m", "mm"),
        ("the frequency is", tone, LOWEST_TONE, math.inf, "Hz", "kHz"),
        ("the sampling rate is", plane.sampling_rate, LOWEST_RATE, math.inf, "Hz", "kHz"),
        ("the incident level is", level, LIKE_PASCALS, math.inf, "dB", "pascals"),
    ]
    found = [
        f"{what} {value:.4g} {unit}, {'above' if value > high else 'below'} {min(max(value, low), high):g} {unit}; "
        f"are these {other}?"
        for what, value, low, high, unit, other in checked
        if not low <= value <= high
    ]
    if len(x := spans.get("x", ())) > 1:
        apart, span = float(x.diff().median()), float(x[-1] - x[0])
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
    # Over half a wavelength even a standing wave turns by pi: steps in degrees add up to some 57 times those in rad.
    long = (turn >= math.pi) & (turn <= math.pi * (phase.shape[-2] - 1))
    ratio = phase.diff(dim=-2).abs().sum(-2)[..., long] / turn[long]
    unwrapped = ratio.numel() > 0 and bool(((ratio > 1 / NEAR) & (ratio < NEAR)).all())
    if (largest <= 2 * math.pi and most > TURN) or unwrapped:
        found.append(
            f"{name}: no phase is beyond {largest:.3g}, or they change by little from microphone to microphone, while "
            f"a plane wave turns by {math.degrees(most):.0f} degrees, {most:.3g} rad; are these radians? Degrees are "
            "needed"
        )
    return tuple(found)
