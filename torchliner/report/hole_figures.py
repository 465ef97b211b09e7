"""Holes and cells of the liner below, drawn over maps and under curves along x."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchliner.records import ImpedanceMap
from torchliner.records.holes import Holes, merged_bands
from torchliner.report.figure import entry

SHADE = "0.88"  # of the bands over holes
EDGE: Any = {"edgecolor": "w", "facecolor": "none"}


def outlined(width: float) -> dict[str, Any]:
    """A dark rim, with which white lines are seen on every colour of a map and on paper."""
    from matplotlib.patheffects import withStroke

    return {"path_effects": [withStroke(linewidth=width + 0.9, foreground="k")]}


def shade_holes(axis: Any, holes: Holes | None) -> None:
    """Bands of x, mm, over the holes, behind all else, with a row in the legend."""
    if holes is None:
        return
    from matplotlib.collections import PolyCollection

    bands = [[(1e3 * x, y) for x, y in ((low, 0), (high, 0), (high, 1), (low, 1))]
             for low, high in merged_bands(holes)]  # fmt: skip
    axis.add_collection(
        PolyCollection(bands, facecolor=SHADE, linewidth=0, zorder=0,
                       transform=axis.get_xaxis_transform()), autolim=False,
    )  # fmt: skip
    entry(axis, "slit" if holes.z is None else "hole", width=5, color=SHADE)


def draw_holes(axis: Any, holes: Holes | None) -> None:
    """Circles over a map in mm, or the two sides of slits, with a row in the legend."""
    if holes is None:
        return
    from matplotlib.collections import EllipseCollection, LineCollection

    style: Any = {"linewidth": 1.0} | outlined(1.0)
    if holes.z is None:
        sides = np.ravel(merged_bands(holes))
        axis.add_collection(
            LineCollection([[(1e3 * x, 0), (1e3 * x, 1)] for x in sides], color="w",
                           transform=axis.get_xaxis_transform(), **style), autolim=False,
        )  # fmt: skip
        entry(axis, "slit", color="w", **style)
        return
    places = 1e3 * np.stack([holes.x, holes.z], 1)
    size = 1e3 * np.asarray(holes.diameter)
    axis.add_collection(
        EllipseCollection(size, size, 0 * size, units="xy", offsets=places,
                          offset_transform=axis.transData, **EDGE, **style), autolim=False,
    )  # fmt: skip
    entry(axis, "hole", "o", markersize=6, markerfacecolor="none", markeredgecolor="w",
          markeredgewidth=1.0, **outlined(1.0))  # fmt: skip


def _half_pitch(result: ImpedanceMap) -> float | None:
    """Half of a cell, mm, where pitch and places are known; none over a hard wall."""
    liner = result.choices.get("liner")
    pitch = liner.get("cell_pitch") if isinstance(liner, dict) else None
    if not pitch or result.x is None or result.choices.get("surface") == "hard wall":
        return None
    return 500 * float(pitch)


def mark_borders(axis: Any, result: ImpedanceMap) -> None:
    """Thin lines at the borders of cells that lie within curves along x, mm, and a row for them."""
    half = _half_pitch(result)
    if half is None or result.x is None:
        return
    centres = 1e3 * result.cell_x.cpu().numpy()
    borders = np.unique(np.round(np.concatenate([centres - half, centres + half]), 6))
    ends = 1e3 * float(result.x.min()), 1e3 * float(result.x.max())
    inside = borders[(ends[0] < borders) & (borders < ends[1])]
    for border in inside:
        axis.axvline(border, color="0.6", linewidth=0.5, zorder=0)
    if len(inside):
        entry(axis, "border of cells", color="0.6", linewidth=0.5)


def draw_borders(axis: Any, result: ImpedanceMap, x: Any, z: Any) -> None:
    """Borders of the cells of a map over ``x`` and ``z``, mm, where pitch and places are known."""
    half = _half_pitch(result)
    if half is None:
        return
    from matplotlib.collections import LineCollection

    style: Any = {"color": "w", "linewidth": 0.6} | outlined(0.6)
    ends = (x.min(), x.max()), (z.min(), z.max())
    centres = np.stack([1e3 * result.cell_x.cpu().numpy(), 1e3 * result.cell_z.cpu().numpy()])
    sides = [[np.where(np.isfinite(at), at + half * sign, end[sign > 0]) for sign in (-1, 1)]
             for at, end in zip(centres, ends, strict=True)]  # fmt: skip
    (left, right), (low, high) = sides
    corners = np.stack([[left, right, right, left, left], [low, low, high, high, low]], -1)
    axis.add_collection(LineCollection(list(corners.swapaxes(0, 1)), **style), autolim=False)
    if any(((end[0] < side) & (side < end[1])).any()
           for end, two in zip(ends, sides, strict=True) for side in two):  # fmt: skip
        entry(axis, "border of cells", **style)
