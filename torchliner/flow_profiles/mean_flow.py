"""What a mean flow is to those who ask it, and what profiles symmetric in the duct share."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torchliner.checks import require_positive

Array = NDArray[np.float64]


class FlowProfile(Protocol):
    """A mean flow between two walls; any object that knows these two will do."""

    @property
    def duct_height(self) -> float:
        """H, m."""
        ...

    def velocity(self, y: ArrayLike) -> Array:
        """U at a distance y (m, 0 to H) from the wall, m/s."""
        ...


class MeanFlow(FlowProfile, Protocol):
    """A mean flow as sound in a duct needs it: along +x, below Mach 1, with its slope."""

    @property
    def bulk_mach(self) -> float:
        """Mean of U over the height, divided by c."""
        ...

    @property
    def sound_speed(self) -> float:
        """c, m/s."""
        ...

    @property
    def displacement_thickness(self) -> float:
        """delta* at the wall y = 0, m."""
        ...

    def mach(self, y: ArrayLike) -> Array:
        """M = U/c at y (m)."""
        ...

    def mach_slope(self, y: ArrayLike) -> Array:
        """dM/dy at y (m), 1/m: the derivative of ``mach``, not a difference quotient."""
        ...


class SymmetricProfile:
    """U/U_0 as a shape over t, the distance from the nearer wall in half heights, 0 to 1.

    A profile states its shape, the shape's slope and the mean of the shape; the rest is here.
    """

    bulk_mach: float
    duct_height: float
    sound_speed: float

    def _shape(self, t: Array) -> Array:
        """U/U_0 at t; 1 at t = 1."""
        raise NotImplementedError

    def _shape_slope(self, t: Array) -> Array:
        """d(U/U_0)/dt."""
        raise NotImplementedError

    @property
    def _bulk_share(self) -> float:
        """Mean of U/U_0 over t = 0..1."""
        raise NotImplementedError

    @property
    def centreline_mach(self) -> float:
        """U_0/c, from the integral of the profile."""
        return self.bulk_mach / self._bulk_share

    @property
    def displacement_thickness(self) -> float:
        """delta* of either wall, m: H/2 (1 - bulk/centreline velocity), exactly eq. (2.8)."""
        return self.duct_height / 2 * (1 - self._bulk_share)

    def velocity(self, y: ArrayLike) -> Array:
        """U(y), m/s.

        Args:
            y: distance from one wall, m, 0 to the duct height, any shape.
        Raises:
            ValueError: a point lies outside the duct.
        """
        return self.sound_speed * self.mach(y)

    def mach(self, y: ArrayLike) -> Array:
        """M(y) = U/c; arguments and errors of ``velocity``."""
        return self.centreline_mach * self._shape(self._depth(y))

    def mach_slope(self, y: ArrayLike) -> Array:
        """dM/dy, 1/m, differentiated by hand; arguments and errors of ``velocity``."""
        heights, half = np.asarray(y, np.float64), self.duct_height / 2
        slope = self.centreline_mach / half * self._shape_slope(self._depth(y))
        return np.sign(half - heights) * slope

    def _depth(self, y: ArrayLike) -> Array:
        heights = inside_duct(y, self.duct_height)
        return np.minimum(heights, self.duct_height - heights) / (self.duct_height / 2)

    def _check_scale(self) -> None:
        """Refuse lengths and speeds that are none, and Mach numbers not below 1."""
        for name in ("bulk_mach", "duct_height", "sound_speed"):
            require_positive(f"profile {name}", getattr(self, name))
        if self.bulk_mach >= 1:
            raise ValueError(f"profile bulk_mach is {self.bulk_mach:g}; it must be below 1 (a Mach number, not m/s)")

    def _check_centreline(self, about: str = "") -> None:
        if self.centreline_mach >= 1:
            raise ValueError(
                f"profile centreline Mach number is {self.centreline_mach:.4g} for bulk_mach "
                f"{self.bulk_mach:g}{about}; it must be below 1"
            )


def inside_duct(y: ArrayLike, duct_height: float) -> Array:
    """Distances from the wall as an array.

    Raises:
        ValueError: one is not within 0 to ``duct_height``.
    """
    heights = np.asarray(y, np.float64)
    outside = ~((heights >= 0) & (heights <= duct_height))
    if outside.any():
        raise ValueError(f"y = {heights[outside].flat[0]:g} m lies outside the duct, 0 to {duct_height:g} m")
    return heights
