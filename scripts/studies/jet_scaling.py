"""Jet height over jet velocity and over Mach number: the numbers of figure 22."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torchliner.duct.flow_profiles import TanhProfile
from torchliner.studies.jets import penetration_height


def fit_exponent(x: ArrayLike, y: ArrayLike) -> tuple[float, float]:
    """Exponent n and factor a of y = a x^n, by least squares of ln y over ln x.

    Args:
        x, y: above 0, equal lengths of at least two, (N,).
    Raises:
        ValueError: a value not above 0, or fewer than two different x.
    """
    inputs, outputs = np.asarray(x, np.float64), np.asarray(y, np.float64)
    if inputs.shape != outputs.shape or inputs.ndim != 1 or len(np.unique(inputs)) < 2:
        raise ValueError("an exponent needs x and y of one length with at least two different x")
    if not ((inputs > 0) & (outputs > 0)).all():
        raise ValueError("an exponent is fitted to logarithms; all values must be above 0")
    slope, offset = np.polyfit(np.log(inputs), np.log(outputs), 1)
    return float(slope), math.exp(float(offset))


@dataclass(frozen=True)
class JetScaling:
    """Jet height over jet velocity, and over the Mach number: figure 22 in numbers.

    Args:
        shear: of the profile.
        velocity: U_j, m/s, (N,).
        machs: M_b of the curves over U_j, (K,).
        height_over_velocity: H_j/d, (K, N).
        velocity_exponents: of H_j over U_j, (K,).
        mach: M_b, (M,).
        fixed_velocity: U_j of the curve over M_b, m/s.
        height_over_mach: H_j/d, (M,).
        mach_exponent: of H_j over M_b.
    """

    shear: float
    velocity: NDArray[np.float64]
    machs: tuple[float, ...]
    height_over_velocity: NDArray[np.float64]
    velocity_exponents: tuple[float, ...]
    mach: NDArray[np.float64]
    fixed_velocity: float
    height_over_mach: NDArray[np.float64]
    mach_exponent: float


def jet_scaling(
    shear: float = 0.05,
    *,
    velocities: tuple[float, float] = (1.0, 120.0),
    machs: Sequence[float] = (0.1, 0.2, 0.3, 0.4),
    fixed_velocity: float = 5.0,
    diameter: float = 1e-3,
    duct_height: float = 50e-3,
    points: int = 49,
) -> JetScaling:
    """The curves of figure 22 and the exponents of (A4) that come out.

    Args:
        shear: d of ``TanhProfile``.
        velocities: range of U_j, m/s; ``points`` values evenly in the logarithm.
        machs: M_b of the curves; the curve over M_b runs from the lowest to the highest.
        fixed_velocity: U_j of the curve over M_b, m/s.
        diameter, duct_height: m.

    H_j depends on U_j/M_b alone for a fixed shape of the profile, so at any one point the two
    exponents are equal and opposite: 2/5 where the jet stays in a linear shear layer, 2/3 in a
    uniform flow. The 0.4 and -0.5 of (A4) can only be means over different ranges.
    """
    jets = np.geomspace(*velocities, points)
    speeds = np.geomspace(min(machs), max(machs), points)
    heights = np.stack([penetration_height(jets, diameter, TanhProfile(m, duct_height, shear)) for m in machs])
    over_mach = np.array(
        [float(penetration_height(fixed_velocity, diameter, TanhProfile(m, duct_height, shear))) for m in speeds]
    )
    return JetScaling(
        shear, jets, tuple(machs), heights / diameter,
        tuple(fit_exponent(jets, row)[0] for row in heights),
        speeds, fixed_velocity, over_mach / diameter, fit_exponent(speeds, over_mach)[0],
    )  # fmt: skip
