"""The two limits of a duct flow: a plug, which slips along the walls, and a parabola."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchliner.checks import require_positive
from torchliner.flow_profiles.mean_flow import SymmetricProfile


@dataclass(frozen=True)
class UniformProfile(SymmetricProfile):
    """One velocity from wall to wall, at the walls too; 0 is a duct without flow.

    Args:
        bulk_mach: U/c; 0 or above, below 1.  duct_height: H, m.  sound_speed: c, m/s.
    Raises:
        ValueError: a Mach number outside 0 to 1, or a length or speed not above 0.
    """

    bulk_mach: float
    duct_height: float
    sound_speed: float = 343.2

    def __post_init__(self) -> None:
        for name in ("duct_height", "sound_speed"):
            require_positive(f"profile {name}", getattr(self, name))
        if not 0 <= self.bulk_mach < 1:
            raise ValueError(
                f"profile bulk_mach is {self.bulk_mach:g}; it must be at least 0 and below 1 (a "
                "Mach number, not m/s; the flow runs along +x, so turn the duct round for the "
                "other direction)"
            )

    def _shape(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.ones_like(t)

    def _shape_slope(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.zeros_like(t)  # the step at the walls is left to the wall law

    @property
    def _bulk_share(self) -> float:
        return 1.0


@dataclass(frozen=True)
class ParabolicProfile(SymmetricProfile):
    r"""Laminar flow, :math:`U/U_0 = t(2 - t)`, scaled to a bulk Mach number; U_0 = 3/2 of the mean.

    Args:
        bulk_mach: mean of U over the height, divided by c; 0 to 2/3.  duct_height: H, m.
        sound_speed: c, m/s.
    Raises:
        ValueError: bulk or centreline Mach number not below 1.
    """

    bulk_mach: float
    duct_height: float
    sound_speed: float = 343.2

    def __post_init__(self) -> None:
        self._check_scale()
        self._check_centreline()

    def _shape(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        return t * (2 - t)

    def _shape_slope(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        return 2 * (1 - t)

    @property
    def _bulk_share(self) -> float:
        return 2 / 3
