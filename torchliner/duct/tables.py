"""What a duct takes from tables: a mean flow, an impedance along x or over frequency."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from scipy.integrate import trapezoid
from scipy.interpolate import PchipInterpolator
from torch import Tensor

from torchliner.checks import one_number, plain_array, tell
from torchliner.duct.flow_profiles import Array, MeanFlow
from torchliner.text_columns import read_lines, read_table

VELOCITY, VELOCITY_EXAMPLE = {"y": "length", "u": None}, "y [mm], U [m/s]"
IMPEDANCE = {"x": "length", "frequency": "frequency", "resistance": "number", "reactance": "number"}
IMPEDANCE_EXAMPLE = "x [mm], resistance, reactance"  # or frequency [Hz] in place of x
NEAR = 1e-6  # m; of the frequency

Z = Tensor | Callable[[Tensor, Tensor], Tensor]  # a value each, or a function of x and frequency
WHOLE = 1e-9  # of the height: where a table ends at a wall or the centreline


@dataclass(frozen=True, eq=False)
class TabulatedProfile(MeanFlow):
    """U at given heights, between them monotone cubics (PCHIP), which make no new extremes.

    dM/dy is exact for the cubics, but bends at each height of the table, so spectral methods converge on it no better
    than their mesh meets those heights.

    Args:
        y: heights, m, increasing from 0 to the duct height, or to half of it for a flow symmetric about the
            centreline, (N,) with N at least 3.
        velocity_table: U at ``y``, m/s or in any unit if ``bulk_mach`` is given; at least 0, (N,).
        duct_height: H, m.  bulk_mach: scale the table to this; default: as it stands, m/s.  sound_speed: c, m/s.
    Raises:
        ValueError: heights that do not increase or do not end at a wall or the centreline, a negative or not finite
            velocity, unequal lengths, a Mach number not below 1, no flow to scale.
    Source: Fritsch & Carlson (1980) for the cubics, as in scipy.
    """

    y: Array
    velocity_table: Array
    duct_height: float
    bulk_mach: float = None  # type: ignore[assignment]  # filled in on creation
    sound_speed: float = 343.2

    def __post_init__(self) -> None:
        heights, speeds = _checked_table(self.y, self.velocity_table, "velocity_table", 3)
        if (speeds < 0).any():
            raise ValueError(
                f"velocity_table is {speeds.min():g} at y = {heights[speeds.argmin()]:g} m; it must be at least 0 (the "
                "flow runs along +x, with no flow back)"
            )
        whole = self.duct_height
        if abs(heights[-1] - whole / 2) <= WHOLE * whole:
            heights = np.concatenate([heights, whole - heights[-2::-1]])
            speeds = np.concatenate([speeds, speeds[-2::-1]])
        elif abs(heights[-1] - whole) > WHOLE * whole:
            raise ValueError(
                f"y ends at {heights[-1]:g} m; it must end at the other wall, {whole:g} m, or, for a symmetric flow, "
                f"on the centreline, {whole / 2:g} m"
            )
        heights[-1] = whole
        mean = float(PchipInterpolator(heights, speeds).integrate(0, whole)) / whole
        bulk = mean / self.sound_speed if self.bulk_mach is None else self.bulk_mach
        if bulk > 0 and mean == 0:
            raise ValueError(f"the velocity table is 0 everywhere; it cannot be scaled to bulk_mach {bulk:g}")
        machs = speeds * (bulk / mean if mean else 0.0)
        if machs.max() >= 1:
            raise ValueError(
                f"the table's largest Mach number is {machs.max():.4g} at y = {heights[machs.argmax()]:g} m; it must "
                "be below 1"
            )
        for name, value in (("y", heights), ("velocity_table", self.sound_speed * machs), ("bulk_mach", bulk)):
            object.__setattr__(self, name, value)
        self._check()

    @property
    def centreline_mach(self) -> float:
        """U_0/c.

        Raises:
            ValueError: no flow on the centreline.
        """
        centre = float(self._mach(self.duct_height / 2))
        if centre == 0:
            raise ValueError("the velocity on the centreline is 0; it gives no displacement")
        return centre

    @property
    def displacement_thickness(self) -> float:
        """delta* at y = 0, m: the integral of 1 - M/M(H/2) from 0 to H/2, of the cubics exactly, eq. (2.8)."""
        half = self.duct_height / 2
        return half - float(self._mach.integrate(0, half)) / self.centreline_mach

    @cached_property
    def _mach(self) -> PchipInterpolator:  # type: ignore[override]
        return PchipInterpolator(self.y, self.velocity_table / self.sound_speed)

    @cached_property
    def _slope(self) -> PchipInterpolator:  # type: ignore[override]
        return self._mach.derivative()


def displacement_thickness(y: ArrayLike, velocity: ArrayLike, centreline_velocity: float | None = None) -> float:
    r"""Displacement thickness :math:`\delta^* = \int_0^{H/2} (1 - U/U_0)\,dy`, in metres.

    Args:
        y: distance from the wall, m, increasing from 0 to half the duct height, shape (N,).
        velocity: U(y), m/s, shape (N,).  centreline_velocity: U_0, m/s; default the last value.
    Raises:
        ValueError: fewer than two points, unequal lengths, y not increasing from the wall, or U_0 zero or not finite.
    Source: Roncen et al. (2026), eq. (2.8); trapezoidal rule, so its error is second order in the spacing.

    >>> round(tl.displacement_thickness([0.0, 0.01, 0.02], [0.0, 40.0, 40.0]), 6)  # a ramp of 10 mm
    0.005
    """
    heights, speeds = _checked_table(y, velocity, "velocity", 2)
    stated = speeds[-1] if centreline_velocity is None else centreline_velocity
    reference = one_number("centreline_velocity", stated)
    if reference == 0 or not math.isfinite(reference):
        raise ValueError(f"centreline_velocity is {reference:g} m/s; it must be finite and not 0")
    return float(trapezoid(1 - speeds / reference, heights))


def _checked_table(y: ArrayLike, velocity: ArrayLike, name: str, fewest: int) -> tuple[Array, Array]:
    """Heights from the wall, 0 m, on, and U there, copied, (N,) with N at least ``fewest``."""
    heights, speeds = np.array(plain_array(y, "y"), np.float64), np.array(plain_array(velocity, name), np.float64)
    if heights.shape != speeds.shape or heights.ndim != 1 or len(heights) < fewest:
        raise ValueError(
            f"y has shape {heights.shape} and {name} {speeds.shape}; two equal lists of at least {fewest} points are "
            "needed"
        )
    if not (np.isfinite(heights).all() and np.isfinite(speeds).all()):
        raise ValueError(f"y and {name} must be finite")
    if heights[0] != 0 or np.any(np.diff(heights) <= 0):
        raise ValueError(
            "y must increase from the wall to the centreline, or to the other wall, and starts at "
            f"{heights[0]:g} m; add the wall, y = 0, where the velocity is 0"
        )
    return heights, speeds


def velocity_table(path: Path) -> tuple[Array, Array]:
    """y, m, and U, in any unit, (N,), from a CSV with the columns ``y [mm], U [m/s]``.

    Raises:
        FileNotFoundError: no such file.
        ValueError: other columns, y without a unit, a cell that is no finite number.
    """
    found = read_table(read_lines(path), VELOCITY, path, example=VELOCITY_EXAMPLE, short={"velocity": "u"})
    return found["y"], found["u"]


def tabulated_wall(
    path: Path, liner: Sequence[tuple[float, float]], start: float, end: float, frequencies: Sequence[float]
) -> Z:
    """Z(x) of a CSV with the columns ``x [mm], resistance, reactance``, or Z at frequencies of one over ``frequency``.

    ``R`` and ``X`` are short for the latter two, in capitals; inf is rigid. Between its rows Z is linear in the
    admittance.

    Args:
        liner: edges of the lined patches, m.  start, end: of the duct, m.  frequencies: Hz, (F,).
    Returns:
        A function of x and frequency, or (F, S) for S patches.
    Raises:
        FileNotFoundError: no such file.
        ValueError: other columns, x without a unit, a cell that is no number, stations outside the
            duct, or all of them before or behind a lined patch; as ``impedance_along``; a frequency outside the table.
    Warns:
        DataWarning: stations that end within a lined patch: Z is constant beyond the last.
    """
    found = read_table(
        read_lines(path),
        IMPEDANCE,
        path,
        example=IMPEDANCE_EXAMPLE,
        short={"R": "resistance", "X": "reactance"},
        special=("resistance", "reactance"),
        optional=("x", "frequency"),
    )
    if ("x" in found) == ("frequency" in found):
        raise ValueError(f"{path} needs x or frequency, one of them; write {IMPEDANCE_EXAMPLE}")
    walls = np.empty(len(found["resistance"]), np.complex128)  # a sum with 1j inf would be nan
    walls.real, walls.imag = found["resistance"], found["reactance"]
    places = found["x" if "x" in found else "frequency"]
    try:
        between = impedance_along(places, walls)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from error
    low, high = float(places[0]), float(places[-1])
    if "frequency" in found:
        for f in frequencies:
            if not low * (1 - NEAR) <= f <= high * (1 + NEAR):
                raise ValueError(f"{path.name}: {f:g} Hz lies outside its table, {low:g} to {high:g} Hz")
        wanted = torch.tensor(frequencies, dtype=torch.float64)
        return between(wanted, wanted[:1]).mT.expand(-1, len(liner))
    stations = f"{path}: its stations, x = {low:g} to {high:g} m,"
    if low < start - NEAR or high > end + NEAR:
        raise ValueError(f"{stations} leave the duct, {start:g} to {end:g} m; is their unit right?")
    for first, last in liner:
        where = f"the lined patch, x = {first:g} to {last:g} m"
        if low > last or high < first:
            raise ValueError(f"{stations} do not reach {where}; is their unit right?")
        if low > first + NEAR or high < last - NEAR:
            tell(f"{stations} do not span {where}; beyond them Z is taken as at the last one")
    return between


def impedance_along(x: Any, impedance: Any) -> Callable[[Tensor, Tensor], Tensor]:
    """Z(x) at all frequencies: linear in the admittance between stations, constant beyond them.

    Args:
        x: m, increasing, (N,).
        impedance: Z there, (N,); inf is a rigid station, between two of which the wall is rigid.
    Raises:
        ValueError: x does not increase, lengths differ, or a Z is nan or 0, whose admittance has no
            bound to interpolate from.
    """
    places, values = np.asarray(x, np.float64), np.asarray(impedance, np.complex128)
    if places.ndim != 1 or places.shape != values.shape or len(places) < 1:
        raise ValueError(f"x has shape {places.shape}, impedance {values.shape}; both are (N,)")
    if (np.diff(places) <= 0).any():
        raise ValueError("the stations of an impedance profile must increase along x")
    faulty = (values == 0) | np.isnan(values)
    if faulty.any():
        raise ValueError(
            f"the impedance profile is {values[faulty][0].real:g} at x = {places[faulty][0]:g} m, which has no "
            "admittance to interpolate; write a small resistance, as 0.001, for a soft wall and inf for a rigid one"
        )
    rigid = np.isinf(values)
    admittance = np.where(rigid, 0, 1 / np.where(rigid, 1, values))

    def along(at: Tensor, frequency: Tensor) -> Tensor:
        wanted = at.detach().cpu().numpy()
        found = np.interp(wanted, places, admittance)
        hard = found == 0
        z = np.where(hard, np.inf, 1 / np.where(hard, 1, found))
        return torch.as_tensor(z).expand(len(frequency), len(wanted))

    return along
