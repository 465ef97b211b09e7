"""Results of other methods beside a map: their numbers, and black symbols in its figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from torchliner.conversions import impedance_from_admittance
from torchliner.in_situ_method.every_method import ORDERS
from torchliner.records import ImpedanceMap, PointImpedances
from torchliner.report.curves import COMPLEX_PART, Curves, part_of
from torchliner.report.numbers import over_z


def points_along_x(found: PointImpedances, frequency_index: int = 0) -> Curves:
    """Resistance and reactance of another method along x: admittance averaged over equal x."""
    known = torch.isfinite(found.point_impedance[:, frequency_index].real)
    place = found.point_x if bool(torch.isfinite(found.point_x).all()) else None
    x, average = over_z(
        None if place is None else place[known], 1 / found.point_impedance[known, frequency_index]
    )
    impedance = impedance_from_admittance(average)
    values = {part: part_of(impedance, part) for part in COMPLEX_PART}
    return Curves(x, values, found.name)


def alongside_at(
    results: Sequence[ImpedanceMap], frequency_index: int
) -> list[tuple[PointImpedances, int]]:
    """Results of other methods at the maps' frequency: each method once, with its index there."""
    seen: dict[str, tuple[PointImpedances, int]] = {}
    for result in results:
        for other in result.alongside:
            index = other.at(float(result.frequency[frequency_index]))
            if index is not None:
                seen.setdefault(other.name, (other, index))
    return list(seen.values())


def alongside_surfaces(results: Sequence[ImpedanceMap], frequency_index: int) -> dict[str, complex]:
    """Whole-surface values of the other methods, in both orders, by name."""
    return {
        f"{other.name}, {order}": complex(getattr(other, f"liner_impedance{end}")[index])
        for other, index in alongside_at(results, frequency_index)
        for end, order in ORDERS
    }


def draw_alongside(
    axis: Any, results: Sequence[ImpedanceMap], part: str, frequency_index: int
) -> None:
    """Other methods at the cells' centres: black symbols, as in figure 17."""
    for other, index in alongside_at(results, frequency_index):
        draw_cells(axis, other, part, index, f"{other.name}, ")


def draw_cells(axis: Any, found: PointImpedances, part: str, index: int, label: str) -> None:
    """Cell values, filled: admittance over points; open, larger and below: pressure first."""
    for (end, order), face, size in zip(ORDERS, ("black", "white"), (5, 9), strict=True):
        values = part_of(getattr(found, f"cell_impedance{end}")[:, index], part)
        axis.plot(
            1e3 * found.cell_x.numpy(), values, "X",
            markersize=size, markerfacecolor=face, markeredgecolor="black", markeredgewidth=0.7,
            zorder=9 - 0.1 * size, label=f"{label}{order}",
        )  # fmt: skip
