"""A mean flow from a table, and its displacement thickness."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import trapezoid
from scipy.interpolate import PchipInterpolator

from torchliner.checks import one_number, plain_array
from torchliner.duct.flow_profiles import Array, MeanFlow

WHOLE = 1e-9  # of the height: where a table ends at a wall or the centreline


@dataclass(frozen=True, eq=False)
class TabulatedProfile(MeanFlow):
    """U at given heights, between them monotone cubics (PCHIP), which make no new extremes.

    Args:
        y: heights, m, increasing from 0 to the duct height, or to half of it for a symmetric flow, (N,), N at least 3.
        velocity_table: U at ``y``, m/s or in any unit if ``bulk_mach`` is given; at least 0, (N,).
        duct_height: H, m.  bulk_mach: scale the table to this; default: as it stands, m/s.  sound_speed: c, m/s.
    Raises:
        ValueError: a table that is none, or of no subsonic flow.
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
            where = f"{speeds.min():g} at y = {heights[speeds.argmin()]:g} m"
            raise ValueError(f"velocity_table is {where}; it must be at least 0 (the flow runs along +x)")
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
        speeds = speeds * (self.sound_speed * bulk / mean if mean else 0.0)
        for name, value in (("y", heights), ("velocity_table", speeds), ("bulk_mach", bulk)):
            object.__setattr__(self, name, value)
        super().__post_init__()

    @cached_property
    def _bulk_share(self) -> float:  # type: ignore[override]
        """Of the lower half, over U on the centreline."""
        half, centre = self.duct_height / 2, float(self._mach(self.duct_height / 2))
        if centre == 0:
            raise ValueError("the velocity on the centreline is 0; it gives no displacement")
        return float(self._mach.integrate(0, half)) / (half * centre)

    @property
    def centreline_mach(self) -> float:
        """U_0/c."""
        return float(self._mach(self.duct_height / 2))

    def _largest(self) -> float:
        return float(self.velocity_table.max()) / self.sound_speed

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
    reference = one_number("centreline_velocity", speeds[-1] if centreline_velocity is None else centreline_velocity)
    if reference == 0 or not math.isfinite(reference):
        raise ValueError(f"centreline_velocity is {reference:g} m/s; it must be finite and not 0")
    return float(trapezoid(1 - speeds / reference, heights))


def _checked_table(y: ArrayLike, velocity: ArrayLike, name: str, fewest: int) -> tuple[Array, Array]:
    """Heights from the wall, 0 m, on, and U there, copied, (N,) with N at least ``fewest``."""
    heights, speeds = np.array(plain_array(y, "y"), np.float64), np.array(plain_array(velocity, name), np.float64)
    if heights.shape != speeds.shape or heights.ndim != 1 or len(heights) < fewest:
        both = f"y has shape {heights.shape} and {name} {speeds.shape}"
        raise ValueError(f"{both}; two equal lists of at least {fewest} points are needed")
    if not (np.isfinite(heights).all() and np.isfinite(speeds).all()):
        raise ValueError(f"y and {name} must be finite")
    if heights[0] != 0 or np.any(np.diff(heights) <= 0):
        raise ValueError(
            "y must increase from the wall to the centreline, or to the other wall, and starts at "
            f"{heights[0]:g} m; add the wall, y = 0, where the velocity is 0"
        )
    return heights, speeds
