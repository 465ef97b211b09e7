"""Drawings. No physics here: what is drawn comes from ``numbers`` and from the records."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.names import ORDERS
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.impedance_map import ENDS
from torchliner.reduction.moments import Moments
from torchliner.report.alongside import alongside_surfaces, draw_alongside
from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    ONE_ROW,
    PARTS,
    WIDTH,
    Figure,
    draw_band,
    draw_curve,
    finish,
    impedance_panels,
    label_axes,
    panels_of,
    styled,
    subplots,
)  # fmt: skip
from torchliner.report.numbers import (
    Curves,
    against_height,
    case_title,
    height_label,
    impedance_along_x,
    impedance_over_frequency,
    interval_words,
    part_of,
    velocity_along_x,
)

BARS = 15  # statistical intervals along a spectrum, about
FACES = {ORDERS[0]: "grey", ORDERS[1]: "white", ORDERS[2]: "yellow"}
FLAT = 1e-6  # mm, within which places lie on a line
LONG_SIDE = 4  # medians, above which a triangle bridges a gap
REFERENCE_STYLES = ("-", "--", ":", "-.")


def draw_map(
    result: ImpedanceMap, path: str | Path | None = None, frequency_index: int = 0, axes: Any = None
) -> Figure:
    """Resistance and reactance over (x, z), of planes and of scattered probes, or along x for a
    line; returns the figure, or the axes that were given."""
    if over_surface(result, frequency_index):
        return _draw_plane(result, path, frequency_index, axes)
    return draw_along_x([result], path, frequency_index, axes)


def over_surface(result: ImpedanceMap, frequency_index: int = 0) -> bool:
    """Whether there is a picture over (x, z): of rows and columns, or of scattered probes."""
    grid = result.mean_velocity.ndim == 2 and min(result.mean_velocity.shape) > 1
    return grid or _mesh(result, frequency_index) is not None


@styled
def _draw_plane(
    result: ImpedanceMap, path: str | Path | None, frequency_index: int, given: Any
) -> Any:
    shape = result.mean_velocity.shape
    x, z = _millimetres(result.x, shape[-1]), _millimetres(result.z, shape[0])
    mesh = _mesh(result, frequency_index)
    unit = "mm" if result.x is not None else "index"
    span = (np.ptp(z) + 1e-9) / (np.ptp(x) + 1e-9)
    figure, axes = panels_of(2, min(5.0, 1.5 + 0.45 * WIDTH * span), given)
    for axis, (part, label) in zip(axes, PARTS, strict=False):
        values = getattr(result, part)[..., frequency_index].detach().cpu().numpy()
        # Single points over a hard spot reach extremes that would hide the rest.
        low, high = np.nanpercentile(values, [1, 99])
        style: Any = {"cmap": "cividis", "rasterized": True, "vmin": low, "vmax": high}
        if mesh is None:
            drawn = axis.pcolormesh(x, z, values, shading="nearest", **style)
        else:
            drawn = axis.tripcolor(mesh, values[np.isfinite(values)], shading="gouraud", **style)
            axis.plot(x, z, ".", color="k", markersize=1)
        # Without the layout of our own figures a bar below would lie on the labels.
        bar: Any = {"location": "bottom", "aspect": 30, "pad": 0.03} if given is None else {}
        axis.figure.colorbar(drawn, ax=axis, extend="both", label=label, **bar)
        axis.set_aspect("equal")
        label_axes(axis, f"$x$ ({unit})", f"$z$ ({unit})")
    return finish(figure, path, _caption(result, frequency_index), given=given)


def _mesh(result: ImpedanceMap, frequency_index: int) -> Any:
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


@styled
def draw_along_x(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, frequency_index: int = 0,
    axes: Any = None,
) -> Any:  # fmt: skip
    """R and X along x at several heights, with cell averages and references (figures 10, 17)."""
    ordered = sorted(results, key=lambda r: r.height or 0.0)
    figure, panels = impedance_panels(
        3.0, "$x$ (mm)" if ordered[0].x is not None else "probe", axes
    )
    for axis, part in panels:
        for i, result in enumerate(ordered):
            profile = impedance_along_x(result, frequency_index)
            scale = 1.0 if result.x is None else 1e3
            label = profile.label or "educed"
            draw_curve(axis, profile, part, COLOURS[i], scale, label=label)
            _draw_cells(axis, result, part, frequency_index, MARKERS[i], COLOURS[i])
        for i, (name, value) in enumerate(_references(ordered, frequency_index).items()):
            axis.axhline(part_of(value, part), color="k", linewidth=0.9,
                         linestyle=REFERENCE_STYLES[i % 4], label=name)  # fmt: skip
        draw_alongside(axis, ordered, part, frequency_index)
    others = (f"{FACES[each]}, {each}" for each in ordered[0].orders if each != ordered[0].order)
    cells = f"cells: filled, {ordered[0].order}; {'; '.join(others)}"
    words = interval_words(ordered[0])
    bands = f"\nbands, bars: {words}" if words else ""
    title = f"{_family(ordered, frequency_index)}; {cells}{bands}"
    return finish(figure, path, title, 4, axes)


def _draw_cells(
    axis: Any, result: ImpedanceMap, part: str, frequency_index: int, marker: str, colour: str
) -> None:
    """All orders of averaging at the cells' centres, that of the answer filled."""
    found, x = result.uncertainty, 1e3 * result.cell_x.numpy()
    for order in sorted(result.orders, key=lambda each: each == result.order):
        face = FACES[order] if order != result.order else colour
        interval = None if found is None else getattr(found, f"cells{ENDS[order]}")
        if interval is not None:
            ends = (part_of(end[:, frequency_index], part) for end in (interval.low, interval.high))
            axis.vlines(x, *ends, color=colour, linewidth=1.2, zorder=2)
        axis.plot(
            x, part_of(result.of_cells(order)[:, frequency_index], part), marker,
            markerfacecolor=face, markeredgecolor="k" if face == colour else colour,
            markeredgewidth=0.6, zorder=3,
        )  # fmt: skip


def _references(results: Sequence[ImpedanceMap], frequency_index: int) -> dict[str, complex]:
    """Independent impedances of the case, "true" first, and Goodrich's where the flow is known."""
    seen: dict[str, complex] = {}
    for result in results:
        seen.update(result.reference)
        if result.goodrich is not None:
            seen["Goodrich (2.7), linear liner"] = complex(result.goodrich[frequency_index])
    return dict(sorted(seen.items(), key=lambda item: item[0] != "true"))


@styled
def draw_against_height(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, frequency_index: int = 0
) -> Figure:
    """Z in the complex plane at several heights, all orders of averaging (figure 19a's trend)."""
    figure, axes = subplots(1, 1, 3.6)
    axis = axes[0, 0]
    frequency = float(results[0].frequency[frequency_index])
    rows = [row for row in against_height(results) if row.frequency == frequency]
    orders = list(reversed(results[0].orders))
    names = [order.replace(" ", "_") for order in orders]
    shown = [getattr(row, name) for row in rows for name in names]
    references = _references(results, frequency_index)
    references |= alongside_surfaces(results, frequency_index)
    shown += references.values()
    span = max(np.ptp(np.real(shown)), np.ptp(np.imag(shown)))
    for i, (name, label) in enumerate(zip(names, orders, strict=True)):
        values = np.array([getattr(row, name) for row in rows])
        axis.plot(
            values.real, values.imag, MARKERS[i] + "-", color=COLOURS[i], label=label, zorder=3
        )
        for row, value in zip(rows, values, strict=True):
            _draw_cross(axis, value, getattr(row, f"interval{ENDS[label]}"), COLOURS[i])
        _label_heights(axis, rows, values, COLOURS[i], 0.05 * span, above=i == 0)
    for i, (name, value) in enumerate(references.items()):
        axis.plot(
            value.real, value.imag, "*x+1234"[i % 7], color="k", markersize=9 if i == 0 else 7,
            label=name, linestyle="none",
        )  # fmt: skip
    axis.margins(0.15)
    label_axes(axis, PARTS[0][1], PARTS[1][1])
    axis.legend(loc="best")
    axis.set_title(f"{_family(results, frequency_index)}; numbers: height $y$ (mm)")
    return finish(figure, path)


def _draw_cross(axis: Any, value: complex, interval: Any, colour: str) -> None:
    """The statistical intervals of resistance and reactance."""
    if interval is not None:
        low, high = interval
        axis.plot([low.real, high.real], [value.imag] * 2, color=colour, linewidth=0.8, zorder=2)
        axis.plot([value.real] * 2, [low.imag, high.imag], color=colour, linewidth=0.8, zorder=2)


def _label_heights(
    axis: Any, rows: Any, values: Any, colour: str, close: float, above: bool
) -> None:
    """Heights in mm beside the points; points on top of each other share one label."""
    last = 0
    for i in range(1, len(rows) + 1):
        if i < len(rows) and abs(values[i] - values[last]) < close:
            continue
        heights = [row.height for row in rows[last:i] if row.height is not None]
        text = " to ".join(f"{1e3 * h:.2g}" for h in sorted({min(heights), max(heights)}))
        axis.annotate(
            text, (values[last].real, values[last].imag), textcoords="offset points",
            xytext=(5, 5 if above else -10), fontsize=7, color=colour,
        )  # fmt: skip
        last = i


@styled
def draw_velocity(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane], path: str | Path | None = None,
    axes: Any = None,
) -> Any:  # fmt: skip
    """v0, v' and u' along x (figures 9 and 16); u' only where it is stored."""
    several = list(planes) if isinstance(planes, Sequence) else [planes]
    cases = [each.plane if isinstance(each, Moments) else each for each in several]
    rising = sorted(range(len(several)), key=lambda i: cases[i].height or 0)
    profiles = [velocity_along_x(several[i]) for i in rising]
    labels = {"v0 (m/s)": "$v_0$ (m s$^{-1}$)", "v' rms (m/s)": "$v'_{rms}$ (m s$^{-1}$)",
              "u' rms (m/s)": "$u'_{rms}$ (m s$^{-1}$)"}  # fmt: skip
    kept = [name for name in labels if any(name in profile.values for profile in profiles)]
    figure, panels = panels_of(len(kept), 2.7, axes)
    for axis, name in zip(panels, kept, strict=False):
        for profile, colour in zip(profiles, COLOURS, strict=False):
            if name in profile.values:
                draw_curve(axis, profile, name, colour, 1e3)
        label_axes(axis, "$x$ (mm)", labels[name])
        if name != "v0 (m/s)":
            axis.set_ylim(bottom=0)
    return finish(figure, path, case_title(cases[0]), ONE_ROW, axes)


@styled
def draw_liner(profiles: Sequence[Curves], title: str, path: str | Path | None = None) -> Figure:
    """Resistance and reactance over frequency, one curve per speed (figure 3)."""
    figure, panels = impedance_panels(2.9, "frequency $f$ (Hz)")
    for axis, part in panels:
        for i, profile in enumerate(profiles):
            draw_curve(axis, profile, part, COLOURS[i], linestyle=REFERENCE_STYLES[i % 4])
        axis.axhline(0, color="0.7", linewidth=0.6, zorder=0)
        axis.set_xlim(profiles[0].at[0], profiles[0].at[-1])
    panels[1][0].set_ylim(-6, 6)
    return finish(figure, path, title, legend=ONE_ROW)


@styled
def draw_spectrum(results: Sequence[ImpedanceMap], path: str | Path | None = None) -> Any:
    """R and X over frequency at several heights: spread over probes shaded, intervals as bars."""
    figure, panels = impedance_panels(3.0, r"$f$ (kHz)")
    ordered = sorted(results, key=lambda r: r.height or 0.0)
    for axis, part in panels:
        drawn = []
        for i, result in enumerate(ordered):
            numbers = impedance_over_frequency(result)
            colour, kilohertz = COLOURS[i], numbers.at / 1e3
            axis.plot(
                kilohertz, numbers.values[part], color=colour, label=numbers.label or "educed"
            )
            drawn.append(numbers.values[part])
            for other, style in zip(_others(result), ("--", ":"), strict=False):
                axis.plot(kilohertz, numbers.values[f"{part}, {other}"], style, color=colour)
                drawn.append(numbers.values[f"{part}, {other}"])
            low, high = (numbers.values[f"{part}, {share} % of probes"] for share in (25, 75))
            draw_band(axis, kilohertz, low, high, colour)
            if f"{part} low" in numbers.values:
                some = slice(i, None, max(1, len(kilohertz) // BARS))
                ends = (numbers.values[f"{part} {end}"][some] for end in ("low", "high"))
                axis.vlines(kilohertz[some], *ends, color=colour, linewidth=1.2, zorder=3)
        # A cavity's antiresonance, where Z has a pole, would hide all the rest.
        low, high = np.nanpercentile(np.concatenate(drawn), [5, 90])
        margin = 0.5 * (high - low) + 1e-9
        axis.set_ylim(low - margin, high + margin)
    panels[1][0].axhline(0, color="0.6", linewidth=0.6, zorder=0)
    title = case_title(ordered[0]) or "educed impedance"
    words = interval_words(ordered[0])
    kinds = map("".join, zip(("dashed: ", "dotted: "), _others(ordered[0]), strict=False))
    title += f"; solid: {ordered[0].order}, {', '.join(kinds)}\nshaded: middle half of the "
    title += f"probes; bars: {words}" if words else "probes"
    return finish(figure, path, title, legend=4)


def _others(result: ImpedanceMap) -> list[str]:
    return [order for order in result.orders if order != result.order]


def _millimetres(values: Any, count: int) -> Any:
    return np.arange(count) if values is None else 1e3 * values.numpy()


def _family(results: Sequence[ImpedanceMap], frequency_index: int) -> str:
    """What several results share: the title up to the height, the frequency, the null test."""
    title = case_title(results[0]) or "educed impedance"
    hard = any(result.choices.get("surface") == "hard wall" for result in results)
    frequency = float(results[0].frequency[frequency_index])
    return f"{title}{' (null test)' * hard}, {frequency:g} Hz"


def _caption(result: ImpedanceMap, frequency_index: int) -> str:
    frequency = float(result.frequency[frequency_index])
    parts = [result.title or height_label(result.height), f"{frequency:g} Hz"]
    liner = result.choices.get("liner", {})
    if isinstance(liner, dict) and liner.get("name"):
        null = result.choices.get("surface") == "hard wall"
        parts.append(f"{'null test,' if null else 'liner'} model {liner['name']}")
    return "; ".join(filter(None, parts))
