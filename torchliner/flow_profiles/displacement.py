"""Displacement thickness of a measured profile."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import trapezoid

from torchliner.checks import plain_array


def displacement_thickness(
    y: ArrayLike, velocity: ArrayLike, centreline_velocity: float | None = None
) -> float:
    r"""Displacement thickness :math:`\delta^* = \int_0^{H/2} (1 - U/U_0)\,dy`, in metres.

    Args:
        y: distance from the wall, m, increasing from 0 to half the duct height, shape (N,).
        velocity: U(y), m/s, shape (N,).  centreline_velocity: U_0, m/s; default the last value.
    Raises:
        ValueError: fewer than two points, unequal lengths, y not increasing from the wall, or
            U_0 zero.
    Source: Roncen et al. (2026), eq. (2.8); trapezoidal rule, so its error is second order in the
        spacing.

    >>> round(tl.displacement_thickness([0.0, 0.01, 0.02], [0.0, 40.0, 40.0]), 6)  # a ramp of 10 mm
    0.005
    """
    heights, speeds = (np.asarray(plain_array(values, name), float)
                       for name, values in (("y", y), ("velocity", velocity)))  # fmt: skip
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
