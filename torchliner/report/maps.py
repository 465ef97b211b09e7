"""Pictures over (x, z): colours of resistance and reactance, holes and cells of the liner below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import ImpedanceMap
from torchliner.records.holes import Holes, merged_bands
from torchliner.report.figure import MOST_POINTS, PARTS, entry, finish, label_axes, panels_of, style_width, styled
from torchliner.report.numbers import COMPLEX_PART, height_label, part_of
from torchliner.report.table import Table, table_of

ENDS = (1, 99)  # %, of the probes: single ones over a hard spot would hide the rest
FLAT = 1e-6  # mm, within which places lie on a line
LONG_SIDE = 4  # medians, above which a triangle bridges a gap
EXTEND = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}
Limits = Mapping[str, tuple[float, float]]


def over_surface(result: ImpedanceMap, frequency_index: int = 0) -> bool:
    """Whether there is a picture over (x, z): of rows and columns, or of scattered probes."""
    grid = result.mean_velocity.ndim == 2 and min(result.mean_velocity.shape) > 1
    return grid or _scattered(result, frequency_index) is not None


def map_limits(results: Sequence[ImpedanceMap], frequency_index: int = 0) -> Limits:
    """Ends of the colours of maps to be compared: 1 and 99 % of the values of all of them."""
    found = {}
    for part, _ in PARTS:
        values = [getattr(one, part)[..., frequency_index].detach().cpu().numpy().ravel() for one in results]
        low, high = np.nanpercentile(np.concatenate(values), ENDS)
        found[part] = float(low), float(high)
    return found


@styled
def draw_map(
    result: ImpedanceMap,
    path: str | Path | None = None,
    frequency_index: int = 0,
    given: Any = None,
    limits: Limits | None = None,
) -> Any:
    """Both parts over (x, z); colours between ``limits``, default those of this map alone."""
    shape = result.mean_velocity.shape
    x, z = _millimetres(result.x, shape[-1]), _millimetres(result.z, shape[0])
    mesh = mesh_of(result, frequency_index)
    unit = "mm" if result.x is not None else "index"
    span = (np.ptp(z) + 1e-9) / (np.ptp(x) + 1e-9)
    figure, axes = panels_of(2, min(5.4, 1.7 + 0.45 * style_width() * span), given)
    limits = limits or map_limits([result], frequency_index)
    for axis, (part, label) in zip(axes, PARTS, strict=False):
        values = getattr(result, part)[..., frequency_index].detach().cpu().numpy()
        low, high = limits[part]
        style: Any = {"cmap": "cividis", "rasterized": True, "vmin": low, "vmax": high}
        if mesh is None:
            drawn = axis.pcolormesh(x, z, values, shading="nearest", **style)
        else:
            drawn = axis.tripcolor(mesh, values[np.isfinite(values)], shading="gouraud", **style)
            axis.plot(x, z, ".", color="k", markersize=1, rasterized=len(x) > MOST_POINTS)
        # Without the layout of our own figures a bar below would lie on the labels.
        bar: Any = {"location": "bottom", "aspect": 30, "pad": 0.03} if given is None else {}
        beyond = int((values < low).sum()), int((values > high).sum())
        note = f"{sum(beyond)} of {np.isfinite(values).sum()} probes beyond" if any(beyond) else ""
        extend = EXTEND[beyond[0] > 0, beyond[1] > 0]
        axis.figure.colorbar(drawn, ax=axis, extend=extend, label=f"{label}\n{note}".strip(), **bar)
        _draw_borders(axis, result, x, z)
        if result.x is not None:
            _draw_holes(axis, result.holes)
        axis.set_aspect("equal")
        label_axes(axis, f"$x$ ({unit})", f"$z$ ({unit})")
    return finish(figure, path, _caption(result, frequency_index), 2, given)


def _scattered(result: ImpedanceMap, frequency_index: int) -> Any:
    """Places (x, z) in mm of scattered probes that have a value; None where they lie on a line or on a grid."""
    x, z = result.x, result.z
    if result.mean_velocity.ndim != 1 or x is None or z is None:
        return None
    there = np.isfinite(result.resistance[:, frequency_index].detach().cpu().numpy())
    places = 1e3 * np.stack([x.numpy(), z.numpy()], 1)[there]
    flat = len(places) < 3 or np.linalg.matrix_rank(places - places.mean(0), tol=FLAT) < 2
    return None if flat else places


def mesh_of(result: ImpedanceMap, frequency_index: int) -> Any:
    """Triangles between scattered probes, without those across gaps; None where they lie on a line or on a grid."""
    places = _scattered(result, frequency_index)
    if places is None:
        return None
    from matplotlib.tri import Triangulation

    mesh = Triangulation(*places.T)
    corners = places[mesh.triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    mesh.set_mask(sides.max(1) > LONG_SIDE * np.median(sides))
    return mesh


def _millimetres(values: Any, count: int) -> Any:
    return np.arange(count) if values is None else 1e3 * values.numpy()


def _caption(result: ImpedanceMap, frequency_index: int) -> str:
    frequency = float(result.frequency[frequency_index])
    parts = [result.title or height_label(result.height), f"{frequency:g} Hz"]
    liner = result.choices.get("liner", {})
    if isinstance(liner, dict) and liner.get("name"):
        null = result.choices.get("surface") == "hard wall"
        parts.append(f"{'null test,' if null else 'liner'} model {liner['name']}")
    return "; ".join([*filter(None, parts), "colours from the 1st to the 99th percentile of the probes"])


def _outlined(width: float) -> dict[str, Any]:
    """A dark rim, with which white lines are seen on every colour of a map and on paper."""
    from matplotlib.patheffects import withStroke

    return {"path_effects": [withStroke(linewidth=width + 0.9, foreground="k")]}


def shade_holes(axis: Any, holes: Holes | None) -> None:
    """Bands of x, mm, over the holes, behind all else, with a row in the legend."""
    if holes is None:
        return
    ends = axis.get_xlim()
    for low, high in merged_bands(holes):
        axis.axvspan(1e3 * low, 1e3 * high, color="0.88", linewidth=0, zorder=0)
    axis.set_xlim(ends)
    entry(axis, "slit" if holes.z is None else "hole", width=5, color="0.88")


def _draw_holes(axis: Any, holes: Holes | None) -> None:
    """Circles over a map in mm, or the two sides of slits, with a row in the legend."""
    if holes is None:
        return
    from matplotlib.collections import EllipseCollection

    style: Any = {"linewidth": 1.0} | _outlined(1.0)
    if holes.z is None:
        ends = axis.get_xlim()
        for x in np.ravel(merged_bands(holes)):
            axis.axvline(1e3 * x, color="w", **style)
        axis.set_xlim(ends)
        entry(axis, "slit", color="w", **style)
        return
    places, size = 1e3 * np.stack([holes.x, holes.z], 1), 1e3 * np.asarray(holes.diameter)
    style |= {"edgecolor": "w", "facecolor": "none"}
    circles = EllipseCollection(
        size, size, 0 * size, units="xy", offsets=places, offset_transform=axis.transData, **style
    )
    axis.add_collection(circles, autolim=False)
    ring: Any = {"markersize": 6, "markerfacecolor": "none", "markeredgecolor": "w", "markeredgewidth": 1.0}
    entry(axis, "hole", "o", **ring, **_outlined(1.0))


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


def _draw_borders(axis: Any, result: ImpedanceMap, x: Any, z: Any) -> None:
    """Borders of the cells of a map over ``x`` and ``z``, mm, where pitch and places are known."""
    half = _half_pitch(result)
    if half is None:
        return
    from matplotlib.collections import LineCollection

    style: Any = {"color": "w", "linewidth": 0.6} | _outlined(0.6)
    ends = (x.min(), x.max()), (z.min(), z.max())
    sides = []
    for centre, end in zip((result.cell_x, result.cell_z), ends, strict=True):
        at = 1e3 * centre.cpu().numpy()
        sides.append([np.where(np.isfinite(at), at + half * sign, end[sign > 0]) for sign in (-1, 1)])
    (left, right), (low, high) = sides
    corners = np.stack([[left, right, right, left, left], [low, low, high, high, low]], -1)
    axis.add_collection(LineCollection(list(corners.swapaxes(0, 1)), **style), autolim=False)
    if any(((end[0] < s) & (s < end[1])).any() for end, two in zip(ends, sides, strict=True) for s in two):
        entry(axis, "border of cells", **style)


def probes_table(result: ImpedanceMap, index: int) -> Table:
    """A row a probe: x, z, R and X."""
    shape, x, z = tuple(result.mean_velocity.shape), result.x, result.z
    if len(shape) == 2:
        x = None if x is None else x.repeat(shape[0])
        z = None if z is None else z.repeat_interleave(shape[1])
    columns = {f"{axis} (m)": at.tolist() for axis, at in (("x", x), ("z", z)) if at is not None}
    for part in COMPLEX_PART:
        columns[part] = part_of(result.impedance[..., index], part).reshape(-1).tolist()
    return table_of([dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)])
