"""Results of other methods beside a map: their numbers, and black symbols in its figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import torch

from torchliner.conversions import impedance_from_admittance
from torchliner.records import ImpedanceMap, PointImpedances
from torchliner.report.numbers import COMPLEX_PART, Curves, height_label, over_z, part_of
from torchliner.report.table import format_bounds, format_complex

ORDERS = (("", "admittance over points"), ("_pressure_first", "pressure first"))  # of averaging


def points_along_x(found: PointImpedances, frequency_index: int = 0) -> Curves:
    """Resistance and reactance of another method along x: admittance averaged over equal x."""
    value = found.point_impedance[:, frequency_index]
    known = torch.isfinite(value.real)
    place = found.point_x[known] if bool(torch.isfinite(found.point_x).all()) else None
    x, average = over_z(place, 1 / value[known])
    impedance = impedance_from_admittance(average)
    return Curves(x, {part: part_of(impedance, part) for part in COMPLEX_PART}, found.name)


def alongside_at(results: Sequence[ImpedanceMap], frequency_index: int) -> list[tuple[PointImpedances, int]]:
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


def differences(results: Sequence[ImpedanceMap], frequency_index: int) -> list[dict[str, Any]]:
    """Answer of each map less what the other methods found, with its joint statistical interval.

    Half-widths add as independent ones. Where only the map has an interval, ``of_map_alone``.
    """
    found = []
    for result in results:
        for other, index in alongside_at([result], frequency_index):
            for end, order in ORDERS:
                value = complex(getattr(other, f"liner_impedance{end}")[index])
                mine = result.bounds_of_liner(result.averaging, frequency_index)
                theirs = other.bounds_of_liner(end, index)
                row: dict[str, Any] = {
                    "height": result.height,
                    "frequency": float(result.frequency[frequency_index]),
                    "between": f"{result.averaging} less {other.name}, {order}",
                    "difference": complex(result.answer[frequency_index]) - value,
                    "low": None,
                    "high": None,
                    "differs": None,
                    "of_map_alone": theirs is None,
                }
                if mine is not None:
                    row |= joint_bounds(mine, theirs or (value, value))
                found.append(row)
    return found


def joint_bounds(mine: tuple[complex, complex], theirs: tuple[complex, complex]) -> dict[str, complex | bool]:
    """Bounds of the difference, infinite where either has no bound, and whether 0 lies outside
    those of R or of X."""
    ends = []
    for part in ("real", "imag"):
        (a, b), (c, d) = ([getattr(end, part) for end in pair] for pair in (mine, theirs))
        reach = math.hypot(b - a, d - c) / 2
        middle = (a + b - c - d) / 2 if reach < math.inf else 0.0  # else inf less inf
        ends.append((middle - reach, middle + reach))
    low, high = (complex(ends[0][i], ends[1][i]) for i in (0, 1))
    return {"low": low, "high": high, "differs": any(a > 0 or b < 0 for a, b in ends)}


def difference_lines(results: Sequence[ImpedanceMap]) -> list[str]:
    """One line a map, frequency and value that stands beside it."""
    lines = []
    for i in range(len(results[0].frequency)):
        for row in differences(results, i):
            text = f"{row['frequency']:g} Hz, {height_label(row['height']) or 'map'}: "
            text += f"{row['between']}: {format_complex(row['difference'])}"
            if row["low"] is not None:
                of = "the map's alone" if row["of_map_alone"] else "joint"
                verdict = "they differ" if row["differs"] else "no difference is shown"
                text += f" (statistical interval, {of}: "
                text += f"{format_bounds((row['low'], row['high']))}): {verdict}"
            lines.append(text)
    return lines


def draw_alongside(axis: Any, results: Sequence[ImpedanceMap], part: str, frequency_index: int) -> None:
    """Other methods at the cells' centres: black symbols, as in figure 17."""
    for other, index in alongside_at(results, frequency_index):
        draw_cells(axis, other, part, index, f"{other.name}, ")


def draw_cells(axis: Any, found: PointImpedances, part: str, index: int, label: str) -> None:
    """Cell values, filled: admittance over points; open, larger and below: pressure first."""
    for (end, order), face, size in zip(ORDERS, ("black", "white"), (5, 9), strict=True):
        values = part_of(getattr(found, f"cell_impedance{end}")[:, index], part)
        axis.plot(
            1e3 * found.cell_x.numpy(),
            values,
            "X",
            markersize=size,
            markerfacecolor=face,
            markeredgecolor="black",
            markeredgewidth=0.7,
            zorder=9 - 0.1 * size,
            label=f"{label}{order}",
        )
