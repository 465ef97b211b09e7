"""Pictures of curves: resistance and reactance along x and over frequency, velocities along x."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.engine.moments import Moments
from torchliner.records import ImpedanceMap, PointImpedances, VelocityPlane
from torchliner.report.figure import (
    AVERAGINGS,
    COLOURS,
    LINES,
    MARKERS,
    ONE_ROW,
    PARTS,
    REFERENCES,
    U_RMS,
    V_RMS,
    Figure,
    break_at_poles,
    draw_band,
    draw_curve,
    drawn_before,
    entry,
    finish,
    frame,
    impedance_panels,
    label_axes,
    panels_of,
    plain_label,
    styled,
    subplots,
)
from torchliner.report.maps import draw_map, mark_borders, over_surface, shade_holes
from torchliner.report.numbers import (
    Curves,
    case_title,
    impedance_along_x,
    impedance_over_frequency,
    interval_words,
    labels_of,
    part_of,
    points_along_x,
    velocity_along_x,
)

ORDERS = (("", "admittance over points"), ("_pressure_first", "pressure first"))  # of averaging, in situ
SAME_PLACE = 1e-6  # m
ASIDE = 0.012  # of the axis, between the markers of neighbouring runs


def draw_result(
    result: ImpedanceMap,
    path: str | Path | None = None,
    frequency_index: int | None = None,
    axes: Any = None,
) -> Any:
    """Resistance and reactance of a map at one frequency, over (x, z) or along x; of several frequencies, with None,
    over frequency. Returns the figure, or the axes that were given."""
    if frequency_index is None and len(result.frequency) > 1:
        return draw_spectrum([result], path, axes)
    if over_surface(result, frequency_index or 0):
        return draw_map(result, path, frequency_index or 0, axes)
    return draw_along_x([result], path, frequency_index or 0, axes)


@styled
def draw_along_x(
    results: Sequence[ImpedanceMap],
    path: str | Path | None = None,
    frequency_index: int = 0,
    axes: Any = None,
    labels: Sequence[str] | None = None,
) -> Any:
    """R and X along x of several runs, with cell averages and references (figures 10, 17).

    One run has a colour an averaging; of several each has its own, and the cells of the answer's averaging. The axes
    show curves, cells and references; of wider intervals what lies near them.
    """
    first, names = results[0], labels or labels_of(results)
    figure, panels = impedance_panels(3.0, "$x$ (mm)" if first.x is not None else "probe", axes)
    before = drawn_before([axis for axis, _ in panels], len(results))
    alone, cut = len(results) == 1 and not before, False
    profiles = [impedance_along_x(result, frequency_index) for result in results]
    for axis, part in panels:
        shown: list[Any] = []
        bands: list[Any] = []
        for i, (result, profile) in enumerate(zip(results, profiles, strict=True)):
            colour = AVERAGINGS["admittance"] if alone else COLOURS[before + i]
            label = "probes" if alone else plain_label(names[i])
            scale = 1.0 if result.x is None else 1e3
            draw_curve(axis, profile, part, colour, scale, label=label, linestyle=LINES[before + i])
            shown.append(profile.values[part])
            bands += [profile.values[key] for key in profile.values if key.startswith(f"{part} ")]
            aside = 0.0 if alone else i - (len(results) - 1) / 2
            shown += _draw_cells(axis, result, part, frequency_index, None if alone else before + i, aside)
        references = {} if before else references_of(results, frequency_index)
        for i, (name, value) in enumerate(references.items()):
            axis.axhline(part_of(value, part), **{"label": plain_label(name)} | REFERENCES[i % 4])
            shown.append([part_of(value, part)])
        for other, index in alongside_at(results, frequency_index):
            draw_points_of_cells(axis, other, part, index, f"{plain_label(other.name)}, ")
            shown.append(part_of(other.cell_impedance[:, index], part))
        cut |= frame(axis, np.concatenate(shown), *bands)
        if first.x is not None and not before:
            shade_holes(axis, first.holes)
            mark_borders(axis, first)
    if (words := interval_words(first)) and not before:
        entry(panels[0][0], words, width=5, color="0.8")
    caption = (
        f"{family(results, frequency_index)}; bands and bars: {words}" if words else family(results, frequency_index)
    )
    return finish(figure, path, caption + ", cut off at the axes" * cut, 4, axes)


def _draw_cells(axis: Any, result: ImpedanceMap, part: str, index: int, run: int | None, aside: float) -> list[Any]:
    """Cell averages with their intervals: all averagings of one run, else those of the answer. Returns the values, none
    where no cell has a place."""
    x = 1e3 * result.cell_x.cpu().numpy()
    if not np.isfinite(x).any():
        return []
    left, right = axis.get_xlim()
    shown = []
    for number, averaging in enumerate(result.averagings if run is None else [result.averaging]):
        cells, colour = result.cells[averaging], AVERAGINGS[averaging] if run is None else COLOURS[run]
        place = x + (right - left) * ASIDE * (number - 1 if run is None else aside)
        values = part_of(cells.impedance[:, index], part)
        if cells.interval is not None:
            ends = (part_of(end[:, index], part) for end in (cells.interval.low, cells.interval.high))
            axis.vlines(place, *ends, color=colour, linewidth=1.2, zorder=2)
        mine = averaging == result.averaging
        style: Any = {"color": colour, "markerfacecolor": colour if mine else "white", "linestyle": "none", "zorder": 4}
        axis.plot(place, values, MARKERS[number if run is None else run], **style)
        shown.append(values)
        label = f"cells, {averaging}"
        if run is None:
            entry(axis, label, MARKERS[number], **style)
        elif label not in axis.get_legend_handles_labels()[1]:
            entry(axis, label, "o", color="k")
    return shown


def references_of(results: Sequence[ImpedanceMap], frequency_index: int) -> dict[str, complex]:
    """Independent impedances of the case, "true" first, and Goodrich's where the flow is known."""
    seen: dict[str, complex] = {}
    for result in results:
        seen.update(result.reference_at(frequency_index))
        if result.goodrich is not None:
            seen["Goodrich (2.7), linear liner"] = complex(result.goodrich[frequency_index])
    return dict(sorted(seen.items(), key=lambda item: item[0] != "true"))


def alongside_at(results: Sequence[ImpedanceMap], frequency_index: int) -> list[tuple[PointImpedances, int]]:
    """Results of other methods at the maps' frequency: each method once, with its index there."""
    seen: dict[str, tuple[PointImpedances, int]] = {}
    for result in results:
        for other in result.alongside:
            index = other.at(float(result.frequency[frequency_index]))
            if index is not None:
                seen.setdefault(other.name, (other, index))
    return list(seen.values())


def draw_points_of_cells(axis: Any, found: PointImpedances, part: str, index: int, label: str) -> None:
    """Cell values of another method, filled: admittance over points; open, larger and below: pressure first."""
    for (end, order), face, size in zip(ORDERS, ("black", "white"), (5, 9), strict=True):
        values = part_of(getattr(found, f"cell_impedance{end}")[:, index], part)
        style: Any = {"markersize": size, "markerfacecolor": face, "markeredgecolor": "black", "markeredgewidth": 0.7}
        axis.plot(1e3 * found.cell_x.numpy(), values, "X", zorder=9 - 0.1 * size, label=f"{label}{order}", **style)


def family(results: Sequence[ImpedanceMap], frequency_index: int) -> str:
    """What several results share: the title up to the height, the frequency, the null test."""
    title = case_title(results[0]) or "educed impedance"
    hard = any(result.choices.get("surface") == "hard wall" for result in results)
    frequency = float(results[0].frequency[frequency_index])
    return f"{title}{' (null test)' * hard}, {frequency:g} Hz"


@styled
def draw_difference(
    results: Sequence[ImpedanceMap], rows: Sequence[Any], path: str | Path | None = None, frequency_index: int = 0
) -> Figure:
    """Two runs: R and X along x, and below them the difference of their cells with its interval.

    Args:
        results: the two maps.
        rows: of ``compare(*results)``.
    """
    figure, axes = subplots(2, 2, 4.6)
    draw_along_x(results, None, frequency_index, list(axes[0]))
    frequency = float(results[0].frequency[frequency_index])
    mine = [row for row in rows if row.frequency == frequency]
    one, other = (impedance_along_x(result, frequency_index) for result in results)
    for above, axis, (part, label) in zip(axes[0], axes[1], PARTS, strict=True):
        if one.at.shape == other.at.shape and np.allclose(one.at, other.at, 0, SAME_PLACE):
            off, x = other.values[part] - one.values[part], 1e3 * one.at
            axis.plot(x, off, color=AVERAGINGS["admittance"], label="probes")
            if f"{part} low" in one.values and f"{part} low" in other.values:
                halves = [(each.values[f"{part} high"] - each.values[f"{part} low"]) / 2 for each in (one, other)]
                draw_band(axis, x, off - np.hypot(*halves), off + np.hypot(*halves), AVERAGINGS["admittance"])
        draw_differences(axis, mine, part)
        axis.set_xlim(above.get_xlim())
        label_axes(axis, "$x$ (mm)", f"difference of {label}")
    return finish(figure, path, f"{family(results, frequency_index)}; second minus first", 4)


def draw_differences(axis: Any, rows: Sequence[Any], part: str) -> None:
    """Cells along x, mm, or by number, and the whole liner as a line; intervals as bars and a band."""
    cells = [row for row in rows if row.place != "liner"]
    x = 1e3 * np.array([row.x for row in cells], dtype=float)
    x = np.where(np.isfinite(x).all(), x, np.arange(len(x)))
    axis.axhline(0, color="0.6", linewidth=0.6, zorder=0)
    for row in rows:
        if row.place == "liner":
            axis.axhline(part_of(row.difference, part), color="k", linewidth=0.9, label="liner")
            if row.low is not None:
                axis.axhspan(part_of(row.low, part), part_of(row.high, part), color="0.85", zorder=0)
    axis.plot(x, [part_of(row.difference, part) for row in cells], "o", color="k", label="cells")
    known = [i for i, row in enumerate(cells) if row.low is not None]
    axis.vlines(x[known], *([part_of(cells[i][end], part) for i in known] for end in ("low", "high")), color="k")


@styled
def draw_comparison(found: Any, path: str | Path | None = None, frequency: float | None = None) -> Figure:
    """Difference of two maps of which the rows of ``compare`` are left: liner and cells, with intervals."""
    frequency = frequency or found.rows[0].frequency
    figure, panels = impedance_panels(3.0, "$x$ (mm)")
    for axis, part in panels:
        draw_differences(axis, [row for row in found.rows if row.frequency == frequency], part)
    return finish(figure, path, f"second minus first, {frequency:g} Hz, averaging {found.averaging}", ONE_ROW)


@styled
def draw_spectrum(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, axes: Any = None, labels: Any = None
) -> Any:
    """R and X over frequency with intervals: of one run in all averagings, of several the answer of each."""
    figure, panels = impedance_panels(3.0, r"$f$ (kHz)", axes)
    before = drawn_before([axis for axis, _ in panels], len(results))
    alone, names = len(results) == 1 and not before, labels or labels_of(results)
    for axis, part in panels:
        drawn = []
        for i, result in enumerate(results):
            numbers = impedance_over_frequency(result)
            colour = AVERAGINGS[result.averaging] if alone else COLOURS[before + i]
            if alone:
                for other in (each for each in result.averagings if each != result.averaging):
                    values = numbers.values[f"{part}, {other}"]
                    axis.plot(numbers.at / 1e3, values, color=AVERAGINGS[other], linestyle=LINES[1], label=other)
                    drawn.append(values)
            label = result.averaging if alone else plain_label(names[i])
            draw_curve(axis, numbers, part, colour, 1e-3, label=label, linestyle=LINES[before + i])
            drawn.append(numbers.values[part])
        # A cavity's antiresonance, where Z has a pole, would hide all the rest.
        low, high = np.nanpercentile(np.concatenate(drawn), [5, 90])
        margin = 0.5 * (high - low) + 1e-9
        axis.set_ylim(low - margin, high + margin)
        break_at_poles(axis)
    panels[-1][0].axhline(0, color="0.6", linewidth=0.6, zorder=0)
    words = f"; bands: {interval_words(results[0])}" if results[0].level is not None else ""
    caption = f"{case_title(results[0]) or 'educed impedance'}{words}; the axes end before a pole of Z"
    return finish(figure, path, caption, 4, axes)


@styled
def draw_liner(profiles: Sequence[Curves], title: str, path: str | Path | None = None) -> Figure:
    """Resistance and reactance over frequency, one curve per speed (figure 3)."""
    figure, panels = impedance_panels(2.7, "$f$ (kHz)")
    for axis, part in panels:
        for i, profile in enumerate(profiles):
            draw_curve(axis, profile, part, COLOURS[i], 1e-3, label=profile.label, linestyle=LINES[i])
        axis.axhline(0, color="0.7", linewidth=0.6, zorder=0)
        axis.set_xlim(1e-3 * profiles[0].at[0], 1e-3 * profiles[0].at[-1])
    panels[1][0].set_ylim(-6, 6)
    for axis, _ in panels:
        break_at_poles(axis)
    return finish(figure, path, title, legend=ONE_ROW)


@styled
def draw_velocity(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane], path: str | Path | None = None, axes: Any = None
) -> Any:
    """v0, v' and u' along x (figures 9 and 16); u' only where it is stored."""
    several = list(planes) if isinstance(planes, Sequence) else [planes]
    cases = [each.plane if isinstance(each, Moments) else each for each in several]
    names = labels_of(cases)
    profiles = [velocity_along_x(each) for each in several]
    labels = {
        "v0 (m/s)": "$v_0$ (m s$^{-1}$)",
        "v' rms (m/s)": f"{V_RMS} (m s$^{{-1}}$)",
        "u' rms (m/s)": f"{U_RMS} (m s$^{{-1}}$)",
    }
    kept = [name for name in labels if any(name in profile.values for profile in profiles)]
    figure, panels = panels_of(len(kept), 2.7, axes)
    before = drawn_before(panels, len(several))
    for axis, quantity in zip(panels, kept, strict=False):
        for i, profile in enumerate(profiles, before):
            if quantity in profile.values:
                label = plain_label(names[i - before])
                draw_curve(axis, profile, quantity, COLOURS[i], 1e3, label=label, linestyle=LINES[i])
        label_axes(axis, "$x$ (mm)", labels[quantity])
        if not before:
            shade_holes(axis, cases[0].holes)
        if quantity != "v0 (m/s)":
            axis.set_ylim(bottom=0)
    return finish(figure, path, case_title(cases[0]), ONE_ROW, axes)


@styled
def draw_points(
    found: PointImpedances, path: str | Path | None = None, true: complex | None = None, title: str = "", f: int = 0
) -> Figure:
    """R and X of another method along x: points, cells in both ways of averaging, and a reference."""
    profile = points_along_x(found, f)
    known = bool(torch.isfinite(found.point_x).all())
    figure, panels = impedance_panels(3.0, "$x$ (mm)" if known else "point")
    for axis, part in panels:
        draw_curve(axis, profile, part, COLOURS[0], 1e3 if known else 1.0, label="points")
        if known:
            draw_points_of_cells(axis, found, part, f, "cells, ")
        if true is not None:
            axis.axhline(part_of(true, part), label="reference", **REFERENCES[0])
    return finish(figure, path, f"{title or found.name}, {float(found.frequency[f]):g} Hz", legend=ONE_ROW)
