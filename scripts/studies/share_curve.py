"""The curve of the share of the incoherent velocity that acts against the velocity ratio, fitted to resolved cases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import brute

from torchliner.velocity.sound import SCATTER, STRONG, WEAK, likely_share

NEAR = 0.02  # relative: the package states two digits


def fit_curve(rows: Sequence[dict[str, Any]]) -> tuple[float, float]:
    """Velocity ratios at which the share leaves 1 and reaches a half, by least squares."""

    def squares(ends: np.ndarray) -> float:
        low, width = math.exp(ends[0]), math.exp(abs(ends[1]))
        return sum((row["share"] - likely_share(row["velocity_ratio"], low, low * width)) ** 2 for row in rows)

    low, width = brute(squares, ((math.log(0.02), math.log(0.5)), (1e-3, math.log(20))), Ns=60)
    return math.exp(low), math.exp(low + abs(width))


def scatter_of(rows: Sequence[dict[str, Any]], weak: float, strong: float) -> float:
    """Standard deviation of the cases about a curve of two constants."""
    misses = [row["share"] - likely_share(row["velocity_ratio"], weak, strong) for row in rows]
    return math.sqrt(sum(miss**2 for miss in misses) / (len(rows) - 2))


def curve_of(rows: Sequence[dict[str, Any]]) -> tuple[float, float, float]:
    """The ends fitted to the cases in three dimensions, and the scatter of all cases about that curve."""
    ends = fit_curve([row for row in rows if row["dimensions"] == 3])
    return *ends, scatter_of(rows, *ends)


def differs(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The constants of the package that are not those of the fit."""
    stated = {"WEAK": WEAK, "STRONG": STRONG, "SCATTER": SCATTER}
    return [
        f"velocity_ratio.{name} is {value:g}, the fit gives {found:.4g}; state that"
        for (name, value), found in zip(stated.items(), curve_of(rows), strict=True)
        if abs(value / found - 1) > NEAR
    ]
