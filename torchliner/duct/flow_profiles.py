"""Mean flows along +x between the walls y = 0 and y = H: plug, parabola, tanh layers, tables."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import trapezoid
from scipy.interpolate import PchipInterpolator

from torchliner.checks import one_number, plain_array, require_positive, tell

Array = NDArray[np.float64]
THIN_SHEAR, THINNEST_SHEAR = 0.05, 0.03  # of a tanh profile, half heights: a warning, a refusal
WHOLE = 1e-9  # of the height: where a table ends at a wall or the centreline


class MeanFlow:
    """A subsonic flow that is symmetric about the centreline, U/U_0 a shape over t, half heights from the nearer wall.

    Attributes:
        bulk_mach: mean of U over the height, divided by c.  duct_height: H, m.  sound_speed: c, m/s.
    """

    bulk_mach: float
    duct_height: float
    sound_speed: float
    _bulk_share: float = 1.0  # mean of the shape over t = 0..1

    def __post_init__(self) -> None:
        for name in ("duct_height", "sound_speed"):
            require_positive(f"profile {name}", getattr(self, name))
        for name, mach in (("bulk_mach", self.bulk_mach), ("largest Mach number", self._largest())):
            if not 0 <= mach < 1:
                limit = "at least 0 and below 1 (a Mach number, not m/s; the flow runs along +x)"
                raise ValueError(f"profile {name} is {mach:.4g}; it must be {limit}")

    def velocity(self, y: ArrayLike) -> Array:
        """U, m/s, at distances y from a wall, m, 0 to H, any shape; ValueError for a point outside the duct."""
        return self.sound_speed * self.mach(y)

    def mach(self, y: ArrayLike) -> Array:
        """M = U/c at y (m)."""
        return self._mach(self._inside(y))

    def mach_slope(self, y: ArrayLike) -> Array:
        """dM/dy at y (m), 1/m: the derivative of ``mach``, not a difference quotient."""
        return self._slope(self._inside(y))

    @property
    def centreline_mach(self) -> float:
        """U_0/c, from the integral of the profile."""
        return self.bulk_mach / self._bulk_share

    @property
    def displacement_thickness(self) -> float:
        """delta* at the wall y = 0, m: H/2 (1 - bulk/centreline velocity), exactly eq. (2.8)."""
        return self.duct_height / 2 * (1 - self._bulk_share)

    def _largest(self) -> float:
        return self.centreline_mach

    def _inside(self, y: ArrayLike) -> Array:
        heights = np.asarray(y, np.float64)
        outside = ~((heights >= 0) & (heights <= self.duct_height))
        if outside.any():
            raise ValueError(f"y = {heights[outside].flat[0]:g} m lies outside the duct, 0 to {self.duct_height:g} m")
        return heights

    def _shape(self, t: Array) -> tuple[Array, Array]:
        """U/U_0 and its derivative by t."""
        return np.ones_like(t), np.zeros_like(t)

    def _mach(self, y: Array) -> Array:
        return self.centreline_mach * self._shape(self._depth(y))[0]

    def _slope(self, y: Array) -> Array:
        half = self.duct_height / 2
        return np.sign(half - y) * self.centreline_mach / half * self._shape(self._depth(y))[1]

    def _depth(self, y: Array) -> Array:
        return np.minimum(y, self.duct_height - y) / (self.duct_height / 2)


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
        shear: d, thickness of the shear layer in half heights.  allow_thin: take one below 0.03 too.
    Raises:
        ValueError: as ``UniformProfile``, or ``shear`` below 0.03.
    Warns:
        DataWarning: ``shear`` below 0.05.
    Source: Rienstra & Vilenski (2008), eq. (4), with the half height as radius, as in section 5.5.4 and appendix A.2 of
        Roncen et al. (2026). A print with "+ r" in place of the factor (1 + r) does not reach U_0 on the centreline.
    """

    bulk_mach: float
    duct_height: float
    shear: float = 0.1
    sound_speed: float = 343.2
    allow_thin: bool = False

    def __post_init__(self) -> None:
        require_positive("profile shear", self.shear)
        text = f"profile shear is {self.shear:g}, below"
        if self.shear < THINNEST_SHEAR and not self.allow_thin:
            raise ValueError(
                f"{text} {THINNEST_SHEAR:g}: so thin a layer makes the answer a matter of the grid; thicken it (or "
                "pass allow_thin=True to study it; allow_thin = true in a .toml's [flow])"
            )
        super().__post_init__()
        if self.shear < THIN_SHEAR:
            unstable = "waves on so thin a layer may be unstable, and results then depend on the mesh"
            tell(f"{text} {THIN_SHEAR:g}: {unstable}", depth=2)

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
        if self.centreline_mach == 0:
            raise ValueError("the velocity on the centreline is 0; it gives no displacement")
        return float(self._mach.integrate(0, self.duct_height / 2)) / (self.duct_height / 2 * self.centreline_mach)

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
