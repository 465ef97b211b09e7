"""Mean flows along +x between the walls y = 0 and y = H, symmetric: plug, parabola, tanh layers, tables."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from torchliner.checks import plain_array, require_positive, tell

Array = NDArray[np.float64]
THIN_SHEAR = 0.05  # of a tanh profile, half heights
WHOLE = 1e-9  # of the height: where a table ends on the centreline


class MeanFlow:
    """A subsonic flow, U/U_0 a shape over t, half heights from the nearer wall.

    Attributes:
        bulk_mach: mean of U over the height, divided by c.  duct_height: H, m.  sound_speed: c, m/s.
    """

    bulk_mach: float
    duct_height: float
    sound_speed: float
    _bulk_share: float = 1.0  # mean of the shape over t = 0..1
    _fastest: float = 1.0  # its largest value

    def __post_init__(self) -> None:
        for name in ("duct_height", "sound_speed"):
            require_positive(f"profile {name}", getattr(self, name))
        largest = self._fastest * self.centreline_mach
        for name, mach in (("bulk_mach", self.bulk_mach), ("largest Mach number", largest)):
            if not 0 <= mach < 1:
                limit = "at least 0 and below 1 (a Mach number, not m/s; the flow runs along +x)"
                raise ValueError(f"profile {name} is {mach:.4g}; it must be {limit}")

    def velocity(self, y: ArrayLike) -> Array:
        """U, m/s, at distances y from a wall, m, 0 to H, any shape; ValueError for a point outside the duct."""
        return self.sound_speed * self.mach(y)

    def mach(self, y: ArrayLike) -> Array:
        """M = U/c at y (m)."""
        return self.centreline_mach * self._shape(self._depth(y))[0]

    def mach_slope(self, y: ArrayLike) -> Array:
        """dM/dy at y (m), 1/m: the derivative of ``mach``, not a difference quotient."""
        half = self.duct_height / 2
        side = np.sign(half - np.asarray(y, np.float64))
        return side * self.centreline_mach / half * self._shape(self._depth(y))[1]

    @property
    def centreline_mach(self) -> float:
        """U_0/c, from the integral of the profile."""
        return self.bulk_mach / self._bulk_share

    @property
    def displacement_thickness(self) -> float:
        """delta* at the wall, m: H/2 (1 - bulk/centreline velocity), exactly eq. (2.8)."""
        return self.duct_height / 2 * (1 - self._bulk_share)

    def _depth(self, y: ArrayLike) -> Array:
        heights = np.asarray(y, np.float64)
        outside = ~((heights >= 0) & (heights <= self.duct_height))
        if outside.any():
            raise ValueError(f"y = {heights[outside].flat[0]:g} m lies outside the duct, 0 to {self.duct_height:g} m")
        return np.minimum(heights, self.duct_height - heights) / (self.duct_height / 2)

    def _shape(self, t: Array) -> tuple[Array, Array]:
        """U/U_0 and its derivative by t."""
        return np.ones_like(t), np.zeros_like(t)


@dataclass(frozen=True)
class UniformProfile(MeanFlow):
    """One velocity from wall to wall, which slips there: bulk Mach number, 0 to 1 (mean of U over c), H (m), c (m/s).

    Raises:
        ValueError: bulk or centreline Mach number not in 0 to 1, a length or speed not above 0.
    """

    bulk_mach: float
    duct_height: float
    sound_speed: float = 343.2


class ParabolicProfile(UniformProfile):
    r"""Laminar flow, :math:`U/U_0 = t(2 - t)`; U_0 = 3/2 of the mean, whose Mach number is below 2/3."""

    _bulk_share = 2 / 3

    def _shape(self, t: Array) -> tuple[Array, Array]:
        return t * (2 - t), 2 * (1 - t)


@dataclass(frozen=True)
class TanhProfile(MeanFlow):
    r"""Boundary layers of adjustable thickness, scaled to a bulk Mach number.

    :math:`U/U_0 = \tanh\frac{1-r}{d} + (1 - T)\left[\frac{1+T}{d} r + 1 + r\right](1-r)`, with
    :math:`r = |2y/H - 1|` and :math:`T = \tanh(1/d)`: a plug flow for d -> 0, a parabola for d -> infinity.

    Args:
        bulk_mach, duct_height, sound_speed: as for ``UniformProfile``.
        shear: d, thickness of the shear layer in half heights.
    Raises:
        ValueError: as ``UniformProfile``; ``shear`` not above 0.
    Warns:
        DataWarning: ``shear`` below 0.05.
    Source: Rienstra & Vilenski (2008), eq. (4), with the half height as radius, as in section 5.5.4 and appendix A.2 of
        Roncen et al. (2026). A print with "+ r" in place of the factor (1 + r) does not reach U_0 on the centreline.
    """

    bulk_mach: float
    duct_height: float
    shear: float = 0.1
    sound_speed: float = 343.2

    def __post_init__(self) -> None:
        require_positive("profile shear", self.shear)
        super().__post_init__()
        if self.shear < THIN_SHEAR:
            unstable = "waves on so thin a layer may be unstable, and results then depend on the mesh"
            tell(f"profile shear is {self.shear:g}, below {THIN_SHEAR:g}: {unstable}", depth=2)

    @property
    def _rest(self) -> tuple[float, float]:
        """1 - T, without cancellation, and (1 + T)/d."""
        small = math.exp(-2 / self.shear)
        rest = 2 * small / (1 + small)
        return rest, (2 - rest) / self.shear

    def _shape(self, t: Array) -> tuple[Array, Array]:
        (rest, steep), layer = self._rest, np.tanh(t / self.shear)
        slope = (1 - layer**2) / self.shear + rest * (steep * (1 - 2 * t) + 2 - 2 * t)
        return layer + rest * (steep * (1 - t) + 2 - t) * t, slope

    @property
    def _bulk_share(self) -> float:  # type: ignore[override]
        rest, steep = self._rest
        logarithm = 1 / self.shear + math.log1p(math.exp(-2 / self.shear)) - math.log(2)  # of cosh(1/d)
        return self.shear * logarithm + rest * (steep / 6 + 2 / 3)


@dataclass(frozen=True, eq=False)
class TabulatedProfile(MeanFlow):
    """U at given heights, between them monotone cubics (PCHIP), which make no new extremes.

    Args:
        y: heights, m, increasing from 0 to the centreline, half the duct height, (N,), N at least 3.
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
        given, half = (self.y, self.velocity_table), self.duct_height / 2
        heights, speeds = (np.array(plain_array(each, "a profile's table"), np.float64) for each in given)
        if heights.shape != speeds.shape or heights.ndim != 1 or len(heights) < 3:
            both = f"y has shape {heights.shape} and velocity_table {speeds.shape}"
            raise ValueError(f"{both}; two equal lists of at least 3 points are needed")
        ends = heights[0] == 0 and abs(heights[-1] - half) <= WHOLE * half
        if not ends or not (np.diff(heights) > 0).all():
            raise ValueError(
                f"y runs from {heights[0]:g} to {heights[-1]:g} m; it must increase from the wall, 0, where the "
                f"velocity is 0, to the centreline, {half:g} m"
            )
        if not (speeds >= 0).all() or not 0 < speeds[-1] < math.inf:
            raise ValueError("velocity_table must be finite, at least 0 (flow along +x) and above 0 in the end")
        t, shape = heights / half, speeds / speeds[-1]
        t[-1] = 1.0
        curve = PchipInterpolator(np.append(t, 2 - t[-2]), np.append(shape, shape[-2]))  # beyond the centreline alike
        found = {"_curve": curve, "_bulk_share": float(curve.integrate(0, 1)), "_fastest": float(shape.max())}
        if self.bulk_mach is None:
            found["bulk_mach"] = float(speeds[-1]) * found["_bulk_share"] / self.sound_speed
        for name, value in found.items():
            object.__setattr__(self, name, value)
        super().__post_init__()

    def _shape(self, t: Array) -> tuple[Array, Array]:
        return self._curve(t), self._curve(t, 1)  # type: ignore[attr-defined]
