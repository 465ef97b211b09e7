"""Turbulent channel flow by a composite law of the wall."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq

from torchliner.duct.flow_profiles import SymmetricProfile, mean_over_layer

KARMAN, BUFFER = 0.4, 7.8  # Reichardt's; B = BUFFER + ln(KARMAN)/KARMAN = 5.5
SUBLAYER, BUFFER_DECAY = 11.0, 3.0  # y+
LOWEST, HIGHEST = 180.0, 1e7  # friction Reynolds number
AIR_VISCOSITY = 1.813e-5 / 1.204  # m2/s, 20 C


@dataclass(frozen=True)
class LawOfTheWallProfile(SymmetricProfile):
    r"""Fully developed turbulent flow between smooth walls, scaled to a bulk Mach number.

    .. math:: u^+ = \frac1\kappa \ln\left[1 + \kappa y^+ \frac{1 + r}{1 + r^2}\right]
        + C\left[1 - e^{-y^+/11} - \frac{y^+}{11} e^{-y^+/3}\right], \quad r = |2y/H - 1|,

    with y+ = y u_tau/nu from the nearer wall, kappa = 0.4, C = 7.8: u+ = y+ at the wall, 2.5 ln y+ + 5.5 above it. The
    friction velocity is the one that gives the bulk Mach number (200 Gauss points over ln(1 + y+): 1e-12).

    Args:
        bulk_mach: mean of U over the height, divided by c; 0 to 1.  duct_height: H, m.
        sound_speed: c, m/s.  kinematic_viscosity: nu, m2/s; default air at 20 C.
    Raises:
        ValueError: bulk or centreline Mach number not below 1, or a friction Reynolds number
            u_tau H/(2 nu) below 180, where a channel is not turbulent enough for the law.
    Source: Reichardt (1951), Z. angew. Math. Mech. 31, 208. Departure from print: his factor for pipes is
        1.5 (1 + r)/(1 + 2 r^2), over the 1 too; it leaves a kink on the centreline and puts it 1.2 wall units above the
        channels of Hoyas & Jimenez (2006), Re_tau 550 to 2000, from which the factor here differs by at most 0.9 (y+
        150 to 250), 0.3 there.
    """

    bulk_mach: float
    duct_height: float
    sound_speed: float = 343.2
    kinematic_viscosity: float = AIR_VISCOSITY

    def __post_init__(self) -> None:
        self._check_scale("kinematic_viscosity")
        lowest = self._bulk_mach_of(LOWEST)
        if self.bulk_mach < lowest:
            raise ValueError(
                f"profile bulk_mach is {self.bulk_mach:g}, below {lowest:.3g}, where the friction Reynolds number is "
                f"{LOWEST:g}, the lowest the law of the wall is taken at; use ParabolicProfile"
            )
        self._check_centreline()

    @cached_property
    def friction_reynolds(self) -> float:
        """Re_tau = u_tau H/(2 nu)."""
        low, high = math.log(LOWEST) - 1e-9, math.log(HIGHEST)
        return math.exp(
            float(brentq(lambda s: self._bulk_mach_of(math.exp(s)) - self.bulk_mach, low, high, xtol=1e-14))
        )

    @property
    def friction_velocity(self) -> float:
        """u_tau, m/s."""
        return 2 * self.kinematic_viscosity * self.friction_reynolds / self.duct_height

    def _bulk_mach_of(self, reynolds: float) -> float:
        return 2 * self.kinematic_viscosity * reynolds / self.duct_height * _bulk_plus(reynolds) / self.sound_speed

    def _shape(self, t: Any) -> Any:
        return _velocity_plus(t, self.friction_reynolds) / self._centre_plus

    @cached_property
    def _centre_plus(self) -> float:
        return float(_velocity_plus(np.ones(()), self.friction_reynolds))

    @property
    def _bulk_share(self) -> float:
        return _bulk_plus(self.friction_reynolds) / self._centre_plus


def _velocity_plus(t: Any, reynolds: float) -> Any:
    """u+ over t = 1 - r."""
    height = reynolds * t
    factor = (2 - t) / (1 + (1 - t) ** 2)
    buffer = -np.expm1(-height / SUBLAYER) - height / SUBLAYER * np.exp(-height / BUFFER_DECAY)
    return np.log1p(KARMAN * height * factor) / KARMAN + BUFFER * buffer


def _bulk_plus(reynolds: float) -> float:
    """Mean of u+ over t."""
    return mean_over_layer(lambda t: _velocity_plus(t, reynolds), reynolds)
