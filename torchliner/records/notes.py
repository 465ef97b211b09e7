"""Warnings as objects, and those about units: metres like mm, Hz like kHz, levels like pascals."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

LOWEST_TONE, LOWEST_RATE = 20.0, 500.0  # Hz: below, no liner is tuned
# m: what a liner's data may span, and lie above it; a boundary layer's displacement.
LONGEST, HIGHEST, THICKEST = 20.0, 0.05, 0.1
SAMPLES = 4.0  # of a period: fewer show no velocity
LIKE_PASCALS = 20.0  # dB, below any duct's sound


@dataclass(frozen=True)
class Note:
    """One warning about a result."""

    code: str  # short and stable, such as "short-record"; what to search and filter by
    text: str  # what is wrong, with its numbers, the limit and the remedy
    size: float | None = None  # how far Z may be off by it, normalised; None where no number can be derived

    def __str__(self) -> str:
        return self.text


def plane_notes(plane: Any, frequency: float | None, cell_pitch: float | None = None) -> Iterator[Note]:
    """Why numbers of a ``VelocityPlane`` may be in other units than Hz, m and dB, or not be meant; and whether it lies
    too high above a liner, of a ``cell_pitch`` in m, to see its cells. ``frequency``: the lowest asked for, Hz."""
    name, rate, height = plane.name, plane.sampling_rate, plane.height
    along = {key: at for key in "xz" if (at := getattr(plane, key)) is not None}
    checked = [
        *((f"{key} spans", float(at.max() - at.min()), 0.0, LONGEST, "m", "mm") for key, at in along.items()),
        ("the height is", height, 0.0, HIGHEST, "m", "mm"),
        ("displacement_thickness is", plane.displacement_thickness, 0.0, THICKEST, "m", "mm"),
        ("the frequency is", frequency, LOWEST_TONE, math.inf, "Hz", "kHz"),
        ("the sampling rate is", rate, LOWEST_RATE, math.inf, "Hz", "kHz"),
        ("the incident level is", plane.incident_level, LIKE_PASCALS, math.inf, "dB", "pascals"),
    ]
    for what, value, low, high, unit, other in checked:
        if value is not None and not low <= value <= high:
            beyond = f"above {high:g} {unit}" if value > high else f"below {low:g} {unit}"
            text = f"{name}: {what} {value:.4g} {unit}, {beyond}; are these {other}?"
            yield Note("units", f"{text} SI units and dB re 20 uPa rms are needed")
    if frequency and rate < SAMPLES * frequency:
        text = f"{name}: {rate / frequency:.4g} samples a period of {frequency:.6g} Hz, below {SAMPLES:g}"
        yield Note("units", f"{text}: check sampling rate and frequency")
    if cell_pitch is not None and height is not None and height > cell_pitch:
        text = (
            f"{name} lies {1e3 * height:.4g} mm above the liner, more than its cell pitch of {1e3 * cell_pitch:.4g} mm"
        )
        yield Note("height", f"{text}: the velocity of the cells is hardly seen there")
