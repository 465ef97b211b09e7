"""Mean flows along +x between the walls y = 0 and y = H: plug, parabola, tanh layers, law of the wall."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from torchliner.checks import require_positive, tell

Array = NDArray[np.float64]
STEP = 1e-30  # imaginary, of t: the slope of an analytic shape is Im shape(t + j h)/h, to rounding
NODES, WEIGHTS = np.polynomial.legendre.leggauss(200)
THIN_SHEAR, THINNEST_SHEAR = 0.05, 0.03  # of a tanh profile, half heights: a warning, a refusal
KARMAN, BUFFER = 0.4, 7.8  # Reichardt's; B = BUFFER + ln(KARMAN)/KARMAN = 5.5
SUBLAYER, BUFFER_DECAY = 11.0, 3.0  # y+
LOWEST, HIGHEST = 180.0, 1e7  # friction Reynolds number
AIR_VISCOSITY = 1.813e-5 / 1.204  # m2/s, 20 C


class MeanFlow:
    """A subsonic flow: U/U_0 as an analytic shape over t, 1 at t = 1, with t the half heights from the nearer wall.

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
        _require_subsonic("bulk_mach", self.bulk_mach)
        _require_subsonic("largest Mach number", self._largest())

    def velocity(self, y: ArrayLike) -> Array:
        """U, m/s, at distances y from a wall, m, 0 to H, any shape.

        Raises:
            ValueError: a point outside the duct.
        """
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

    def _shape(self, t: Any) -> Any:
        """U/U_0; t may be complex, from which the slope comes."""
        return np.ones_like(t)

    def _mach(self, y: Array) -> Array:
        return self.centreline_mach * self._shape(self._depth(y))

    def _slope(self, y: Array) -> Array:
        half = self.duct_height / 2
        slope = np.imag(self._shape(self._depth(y) + 1j * STEP)) / STEP
        return np.sign(half - y) * self.centreline_mach / half * slope

    def _depth(self, y: Array) -> Array:
        return np.minimum(y, self.duct_height - y) / (self.duct_height / 2)


def _require_subsonic(name: str, mach: float) -> None:
    if not 0 <= mach < 1:
        limit = "at least 0 and below 1 (a Mach number, not m/s; the flow runs along +x)"
        raise ValueError(f"profile {name} is {mach:.4g}; it must be {limit}")


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

    def _shape(self, t: Any) -> Any:
        return t * (2 - t)


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

    def _shape(self, t: Any) -> Any:
        rest = 2 * math.exp(-2 / self.shear) / (1 + math.exp(-2 / self.shear))  # 1 - T without cancellation
        slope = (2 - rest) / self.shear
        return np.tanh(t / self.shear) + rest * (slope * (1 - t) + 2 - t) * t

    @cached_property
    def _bulk_share(self) -> float:  # type: ignore[override]
        return _mean_over_layer(self._shape, 1 / self.shear)


@dataclass(frozen=True)
class LawOfTheWallProfile(MeanFlow):
    r"""Fully developed turbulent flow between smooth walls, scaled to a bulk Mach number.

    .. math:: u^+ = \frac1\kappa \ln\left[1 + \kappa y^+ \frac{1 + r}{1 + r^2}\right]
        + C\left[1 - e^{-y^+/11} - \frac{y^+}{11} e^{-y^+/3}\right], \quad r = |2y/H - 1|,

    with y+ = y u_tau/nu from the nearer wall, kappa = 0.4, C = 7.8: u+ = y+ at the wall, 2.5 ln y+ + 5.5 above it. The
    friction velocity is the one that gives the bulk Mach number.

    Args:
        bulk_mach, duct_height, sound_speed: as for ``UniformProfile``.
        kinematic_viscosity: nu, m2/s; default air at 20 C.
    Raises:
        ValueError: as ``UniformProfile``, or a friction Reynolds number u_tau H/(2 nu) below 180.
    Source: Reichardt (1951), Z. angew. Math. Mech. 31, 208. Departure from print: his factor for pipes,
        1.5 (1 + r)/(1 + 2 r^2), leaves a kink on the centreline, 1.2 wall units above the channels of Hoyas & Jimenez
        (2006); the factor here is within 0.9 of them, 0.3 there.
    """

    bulk_mach: float
    duct_height: float
    sound_speed: float = 343.2
    kinematic_viscosity: float = AIR_VISCOSITY

    def __post_init__(self) -> None:
        require_positive("profile kinematic_viscosity", self.kinematic_viscosity)
        lowest = self._bulk_mach_of(LOWEST)
        if 0 <= self.bulk_mach < lowest:
            raise ValueError(
                f"profile bulk_mach is {self.bulk_mach:g}, below {lowest:.3g}, where the friction Reynolds number is "
                f"{LOWEST:g}, the lowest the law of the wall is taken at; use ParabolicProfile"
            )
        super().__post_init__()

    @cached_property
    def friction_reynolds(self) -> float:
        """Re_tau = u_tau H/(2 nu)."""
        ends = math.log(LOWEST) - 1e-9, math.log(HIGHEST)
        return math.exp(brentq(lambda s: self._bulk_mach_of(math.exp(s)) - self.bulk_mach, *ends, xtol=1e-14))

    @property
    def friction_velocity(self) -> float:
        """u_tau, m/s."""
        return 2 * self.kinematic_viscosity * self.friction_reynolds / self.duct_height

    def _bulk_mach_of(self, reynolds: float) -> float:
        bulk = _mean_over_layer(lambda t: _velocity_plus(t, reynolds), reynolds)
        return 2 * self.kinematic_viscosity * reynolds / self.duct_height * bulk / self.sound_speed

    def _shape(self, t: Any) -> Any:
        return _velocity_plus(t, self.friction_reynolds) / _velocity_plus(np.ones(()), self.friction_reynolds)

    @cached_property
    def _bulk_share(self) -> float:  # type: ignore[override]
        return _mean_over_layer(self._shape, self.friction_reynolds)


def _velocity_plus(t: Any, reynolds: float) -> Any:
    """u+ over t = 1 - r."""
    height = reynolds * t
    factor = (2 - t) / (1 + (1 - t) ** 2)
    buffer = -np.expm1(-height / SUBLAYER) - height / SUBLAYER * np.exp(-height / BUFFER_DECAY)
    return np.log1p(KARMAN * height * factor) / KARMAN + BUFFER * buffer


def _mean_over_layer(shape: Callable[[Any], Any], scale: float) -> float:
    """Mean over t = 0..1 of what changes within t = 1/scale: Gauss over ln(1 + scale t), in which it is smooth."""
    span = math.log1p(scale)
    s = span * (1 + NODES) / 2
    return float(np.sum(WEIGHTS * shape(np.expm1(s) / scale) * np.exp(s)) * span / (2 * scale))
