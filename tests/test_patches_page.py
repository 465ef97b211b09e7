"""Appendix A.1 in docs/duct.md, like for like, from the numbers of its figure."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

FIGURES = Path(__file__).resolve().parent.parent / "docs" / "figures"
PATCHES, HOMOGENEOUS = "patches of 1 mm", "homogeneous wall, Z = 0.8"


def above(wall: str, window: str) -> tuple[np.ndarray, np.ndarray]:
    """Heights, mm, and Z there."""
    with (FIGURES / "figure_20_21.csv").open(newline="") as file:
        rows = [r for r in csv.DictReader(file) if (r["wall"], r["window"]) == (wall, window)]
    z = [complex(float(r["resistance"]), float(r["reactance"])) for r in rows]
    return np.array([float(r["y (mm)"]) for r in rows]), np.array(z)


@pytest.mark.parametrize(
    ("window", "homogeneous", "patches"),
    [
        ("all of the liner", 0.023 + 0.023j, 0.022 + 0.024j),
        ("middle 100 mm", 0.015 + 0.022j, 0.015 + 0.023j),
    ],
)
def test_a_homogeneous_wall_has_the_same_slope_in_the_same_window(window, homogeneous, patches):
    """Above 1 mm, a millimetre: as printed. The patches' mass is in the value, not in the slope."""
    for wall, wanted in ((HOMOGENEOUS, homogeneous), (PATCHES, patches)):
        y, z = above(wall, window)
        slope = np.polyfit(y[y >= 1], z[y >= 1], 1)[0]
        assert abs(slope - wanted) < 8e-4
    mass = above(PATCHES, window)[1] - above(HOMOGENEOUS, window)[1]
    assert mass[y >= 1].imag == pytest.approx(0.04, abs=6e-3)


def test_the_slope_from_the_wall_to_5_mm_holds_the_mass():
    """(A1) as it is written, a secant: 0.022+0.031j with patches, 0.023+0.023j without."""
    for wall, wanted in ((PATCHES, 0.022 + 0.031j), (HOMOGENEOUS, 0.023 + 0.023j)):
        y, z = above(wall, "all of the liner")
        assert y[-1] == 5
        assert abs((z[-1] - 0.8) / 5 - wanted) < 8e-4
