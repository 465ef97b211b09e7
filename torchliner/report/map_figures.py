"""Maps over (x, z): colours, what lies beyond their ends, cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import ImpedanceMap
from torchliner.report.figure import PARTS, finish, label_axes, panels_of, style_width, styled
from torchliner.report.hole_figures import draw_borders, draw_holes
from torchliner.report.numbers import height_label

ENDS = (1, 99)  # %, of the probes: single ones over a hard spot would hide the rest
FLAT = 1e-6  # mm, within which places lie on a line
LONG_SIDE = 4  # medians, above which a triangle bridges a gap
Limits = Mapping[str, tuple[float, float]]
EXTEND = {(False, False): "neither", (True, False): "min", (False, True): "max",
          (True, True): "both"}  # fmt: skip


def map_limits(results: Sequence[ImpedanceMap], frequency_index: int = 0) -> Limits:
    """Ends of the colours of maps to be compared: 1 and 99 % of the values of all of them."""
    found = {}
    for part, _ in PARTS:
        values = [getattr(one, part)[..., frequency_index].detach().cpu().numpy().ravel()
                  for one in results]  # fmt: skip
        low, high = np.nanpercentile(np.concatenate(values), ENDS)
        found[part] = float(low), float(high)
    return found


@styled
def draw_plane(
    result: ImpedanceMap, path: str | Path | None, frequency_index: int, given: Any,
    limits: Limits | None,
) -> Any:  # fmt: skip
    """Both parts over (x, z); colours between ``limits``, default those of this map alone."""
    shape = result.mean_velocity.shape
    x, z = _millimetres(result.x, shape[-1]), _millimetres(result.z, shape[0])
    mesh = mesh_of(result, frequency_index)
    unit = "mm" if result.x is not None else "index"
    span = (np.ptp(z) + 1e-9) / (np.ptp(x) + 1e-9)
    figure, axes = panels_of(2, min(5.4, 1.7 + 0.45 * style_width() * span), given)
    limits, notes = limits or map_limits([result], frequency_index), []
    for axis, (part, label) in zip(axes, PARTS, strict=False):
        values = getattr(result, part)[..., frequency_index].detach().cpu().numpy()
        low, high = limits[part]
        style: Any = {"cmap": "cividis", "rasterized": True, "vmin": low, "vmax": high}
        if mesh is None:
            drawn = axis.pcolormesh(x, z, values, shading="nearest", **style)
        else:
            drawn = axis.tripcolor(mesh, values[np.isfinite(values)], shading="gouraud", **style)
            axis.plot(x, z, ".", color="k", markersize=1)
        # Without the layout of our own figures a bar below would lie on the labels.
        bar: Any = {"location": "bottom", "aspect": 30, "pad": 0.03} if given is None else {}
        beyond = int((values < low).sum()), int((values > high).sum())
        extend = EXTEND[beyond[0] > 0, beyond[1] > 0]
        note = f"{sum(beyond)} of {np.isfinite(values).sum()} probes beyond" if any(beyond) else ""
        axis.figure.colorbar(drawn, ax=axis, extend=extend, label=f"{label}\n{note}".strip(), **bar)
        notes.append(f"{label.split(',')[0]} {beyond[0]} below and {beyond[1]} above")
        draw_borders(axis, result, x, z)
        if result.x is not None:
            draw_holes(axis, result.holes)
        axis.set_aspect("equal")
        label_axes(axis, f"$x$ ({unit})", f"$z$ ({unit})")
    ends = f"probes beyond the ends of the colours (arrows): {'; '.join(notes)}"
    return finish(figure, path, f"{_caption(result, frequency_index)}; {ends}", 2, given)


def mesh_of(result: ImpedanceMap, frequency_index: int) -> Any:
    """Triangles between scattered probes that have a value, in mm, without those across gaps; None
    where they lie on a line or on a grid."""
    x, z = result.x, result.z
    if result.mean_velocity.ndim != 1 or x is None or z is None:
        return None
    from matplotlib.tri import Triangulation

    there = np.isfinite(result.resistance[:, frequency_index].detach().cpu().numpy())
    places = 1e3 * np.stack([x.numpy(), z.numpy()], 1)[there]
    if len(places) < 3 or np.linalg.matrix_rank(places - places.mean(0), tol=FLAT) < 2:
        return None
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
    return "; ".join(filter(None, parts))
