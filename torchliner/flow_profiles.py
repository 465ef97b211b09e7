"""Mean-flow profiles of a duct and their integral measures."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import trapezoid

from torchliner.checks import DataWarning, require_positive

THIN_SHEAR, THINNEST_SHEAR = 0.05, 0.03


class FlowProfile(Protocol):
    """A mean flow between two walls; any object that knows these two will do."""

    @property
    def duct_height(self) -> float:
        """H, m."""
        ...

    def velocity(self, y: ArrayLike) -> NDArray[np.float64]:
        """U at a distance y (m, 0 to H) from the wall, m/s."""
        ...


@dataclass(frozen=True)
class TanhProfile:
    r"""Boundary layers of adjustable thickness, scaled to a bulk Mach number.

    :math:`U/U_0 = \tanh\frac{1-r}{d} + (1 - T)\left[\frac{1+T}{d} r + 1 + r\right](1-r)`, with
    :math:`r = |2y/H - 1|` and :math:`T = \tanh(1/d)`: 1 and smooth on the centreline, 0 at the
    walls. For d -> 0 it is a plug flow, for d -> infinity a parabola.

    Args:
        bulk_mach: mean of U over the height, divided by c; 0 to 1.
        duct_height: H, m.
        shear: d, thickness of the shear layer in half heights; at least 0.03.
        sound_speed: c, m/s.
    Raises:
        ValueError: bulk or centreline Mach number not below 1, or ``shear`` below 0.03.
    Warns:
        DataWarning: ``shear`` below 0.05.
    Source: Rienstra & Vilenski (2008), eq. (4), with the half height as radius, as in section
        5.5.4 and appendix A.2 of Roncen et al. (2026). A print with "+ r" in place of the factor
        (1 + r) does not reach U_0 on the centreline.
    """

    bulk_mach: float
    duct_height: float
    shear: float = 0.1
    sound_speed: float = 343.2

    def __post_init__(self) -> None:
        for name in ("bulk_mach", "duct_height", "shear", "sound_speed"):
            require_positive(f"profile {name}", getattr(self, name))
        if self.bulk_mach >= 1:
            raise ValueError(
                f"profile bulk_mach is {self.bulk_mach:g}; it must be below 1 (a Mach number, "
                "not m/s)"
            )
        if self.shear < THINNEST_SHEAR:
            raise ValueError(
                f"profile shear is {self.shear:g}, below {THINNEST_SHEAR:g}: so thin a layer makes "
                "any answer that depends on its inside a matter of the grid; thicken it"
            )
        if self.centreline_mach >= 1:
            raise ValueError(
                f"profile centreline Mach number is {self.centreline_mach:.4g} for bulk_mach "
                f"{self.bulk_mach:g} and shear {self.shear:g}; it must be below 1"
            )
        if self.shear < THIN_SHEAR:
            warnings.warn(
                f"profile shear is {self.shear:g}, below {THIN_SHEAR:g}: waves on so thin a layer "
                "may be unstable, and results then depend on the mesh",
                DataWarning,
                stacklevel=3,
            )

    @property
    def centreline_mach(self) -> float:
        """U_0/c, from the exact integral of the profile."""
        return self.bulk_mach / self._bulk_share

    @property
    def displacement_thickness(self) -> float:
        """delta* of either wall, m: H/2 (1 - bulk/centreline velocity), exactly eq. (2.8)."""
        return self.duct_height / 2 * (1 - self._bulk_share)

    def velocity(self, y: ArrayLike) -> NDArray[np.float64]:
        """U(y), m/s.

        Args:
            y: distance from one wall, m, 0 to the duct height, any shape.
        Raises:
            ValueError: a point lies outside the duct.
        """
        heights = np.asarray(y, np.float64)
        outside = ~((heights >= 0) & (heights <= self.duct_height))
        if outside.any():
            raise ValueError(
                f"y = {heights[outside].flat[0]:g} m lies outside the duct, 0 to "
                f"{self.duct_height:g} m"
            )
        r, d = np.abs(2 * heights / self.duct_height - 1), self.shear
        rest, slope = self._remainder
        shape = np.tanh((1 - r) / d) + rest * (slope * r + 1 + r) * (1 - r)
        return self.centreline_mach * self.sound_speed * shape

    @property
    def _remainder(self) -> tuple[float, float]:
        """1 - T without cancellation, and (1 + T)/d."""
        rest = 2 * math.exp(-2 / self.shear) / (1 + math.exp(-2 / self.shear))
        return rest, (2 - rest) / self.shear

    @property
    def _bulk_share(self) -> float:
        """Mean of U/U_0 over r = 0..1: d ln cosh(1/d) + (1 - T) [((1 + T)/d + 1)/6 + 1/2]."""
        d = self.shear
        rest, slope = self._remainder
        log_cosh = 1 / d + math.log1p(math.exp(-2 / d)) - math.log(2)
        return d * log_cosh + rest * ((slope + 1) / 6 + 0.5)


def displacement_thickness(
    y: ArrayLike, velocity: ArrayLike, centreline_velocity: float | None = None
) -> float:
    r"""Displacement thickness :math:`\delta^* = \int_0^{H/2} (1 - U/U_0)\,dy`, in metres.

    Args:
        y: distance from the wall, m, increasing from 0 to half the duct height, shape (N,).
        velocity: U(y), m/s, shape (N,).
        centreline_velocity: U_0, m/s; default the last value.
    Raises:
        ValueError: fewer than two points, unequal lengths, y not increasing from the wall, or
            U_0 zero.
    Source: Roncen et al. (2026), eq. (2.8); trapezoidal rule, so its error is second order in the
        spacing.
    """
    heights, speeds = np.asarray(y, float), np.asarray(velocity, float)
    if heights.shape != speeds.shape or heights.ndim != 1 or len(heights) < 2:
        raise ValueError(
            f"y has shape {heights.shape} and velocity {speeds.shape}; two equal lists of at "
            "least two points are needed"
        )
    if not (np.isfinite(heights).all() and np.isfinite(speeds).all()):
        raise ValueError("y and velocity must be finite")
    if heights[0] != 0:
        raise ValueError(
            f"y starts at {heights[0]:g} m; add the wall, y = 0, where the velocity is 0"
        )
    if np.any(np.diff(heights) <= 0):
        raise ValueError("y must increase from the wall to the centreline")
    reference = speeds[-1] if centreline_velocity is None else centreline_velocity
    if reference == 0:
        raise ValueError("the centreline velocity is 0; the profile has no flow")
    return float(trapezoid(1 - speeds / reference, heights))
