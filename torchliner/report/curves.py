"""Pictures of curves: resistance and reactance along x and over frequency, differences, velocities along x."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.engine.moments import Moments
from torchliner.records import ImpedanceMap, PointImpedances, VelocityPlane
from torchliner.report import figure as look
from torchliner.report import numbers
from torchliner.report.maps import draw_map, mark_cells, mark_holes, over_surface

ORDERS = (("", "admittance over points"), ("_pressure_first", "pressure first"))  # of averaging, in situ
ASIDE = 0.3  # mm, between markers at one cell
VELOCITIES = {
    "v0 (m/s)": "$v_0$ (m s$^{-1}$)",
    "v' rms (m/s)": f"{look.V_RMS} (m s$^{{-1}}$)",
    "u' rms (m/s)": f"{look.U_RMS} (m s$^{{-1}}$)",
}


def draw_result(
    result: ImpedanceMap, path: str | Path | None = None, frequency_index: int | None = None, axes: Any = None
) -> Any:
    """Resistance and reactance of a map at one frequency, over (x, z) or along x; of several frequencies, with None,
    over frequency. Returns the figure, or the axes that were given."""
    if frequency_index is None and len(result.frequency) > 1:
        return draw_spectrum([result], path, axes)
    if over_surface(result):
        return draw_map(result, path, frequency_index or 0, axes)
    return draw_along_x([result], path, frequency_index or 0, axes)


@look.styled
def draw_along_x(
    results: Sequence[ImpedanceMap],
    path: str | Path | None = None,
    frequency_index: int = 0,
    axes: Any = None,
    labels: Sequence[str] | None = None,
) -> Any:
    """R and X along x of several runs, with cell averages and references (figures 10, 17).

    One run has a colour an averaging; of several each has its own, and the cells of the answer's averaging.
    """
    first, names, words = results[0], labels or numbers.labels_of(results), numbers.interval_words(results[0])
    figure, panels = look.impedance_panels(3.0, look.X_MM if first.x is not None else "probe", axes)
    before = look.drawn_before([axis for axis, _ in panels], len(results))
    alone = len(results) == 1 and not before
    for i, (result, name) in enumerate(zip(results, names, strict=True), before):
        curve = numbers.impedance_along_x(result, frequency_index)
        for axis, part in panels:
            look.draw_curve(axis, curve, part, **look.colour_of(i, "probes" if alone else name))
        for k, averaging in enumerate(result.averagings if alone else [result.averaging]):
            colour, aside = (look.AVERAGINGS[averaging], k - 1) if alone else (look.COLOURS[i], i - len(results) / 2)
            _draw_cells(panels, result, averaging, frequency_index, colour, look.MARKERS[k if alone else i], aside)
    look.draw_references(panels, {} if before else references_of(results, frequency_index))
    for other, index in alongside_at(results, frequency_index):
        _draw_points_of_cells(panels, other, index, f"{other.name}, ")
    for axis, _ in panels:
        look.frame(axis)
        if first.x is not None and not before:
            mark_holes(axis, first.holes)
            mark_cells(axis, first)
    if words and not before:
        look.entry(panels[0][0], words, color="0.8", **look.BAND)
    return look.finish(figure, path, f"{family(results, frequency_index)}; bands and bars: {words or 'none'}", 4, axes)


def _draw_cells(
    panels: Any, result: ImpedanceMap, averaging: str, index: int, colour: str, marker: str, aside: float
) -> None:
    """Averages of the cells that have a place, filled in the averaging of the answer."""
    x, cells = 1e3 * result.cell_x.cpu().numpy() + ASIDE * aside, result.cells[averaging]
    ends = None if cells.interval is None else (cells.interval.low[:, index], cells.interval.high[:, index])
    face = colour if averaging == result.averaging else "white"
    style: Any = {"color": colour, "marker": marker, "markerfacecolor": face, "linestyle": "none", "zorder": 4}
    if np.isfinite(x).any():
        label = f"cells, {averaging}"
        look.draw_impedance(panels, x, cells.impedance[:, index].cpu(), ends, bars=True, label=label, **style)


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


def _draw_points_of_cells(panels: Any, found: PointImpedances, index: int, label: str) -> None:
    """Cell values of another method, filled: admittance over points; open and larger: pressure first."""
    for (end, order), face, size in zip(ORDERS, ("k", "white"), (5, 8), strict=True):
        style: Any = {"color": "k", "marker": "X", "linestyle": "none", "zorder": 9 - 0.1 * size, "markersize": size}
        values = getattr(found, f"cell_impedance{end}")[:, index]
        words = look.plain_label(f"{label}{order}")
        look.draw_impedance(panels, 1e3 * found.cell_x, values, label=words, markerfacecolor=face, **style)


def family(results: Sequence[ImpedanceMap], frequency_index: int) -> str:
    """What several results share: the title up to the height, the frequency, the null test."""
    hard = any(result.choices.get("surface") == "hard wall" for result in results)
    title = f"{numbers.case_title(results[0]) or 'educed impedance'}{' (null test)' * hard}"
    return f"{title}, {float(results[0].frequency[frequency_index]):g} Hz"


@look.styled
def draw_comparison(found: Any, path: str | Path | None = None, frequency: float | None = None) -> look.Figure:
    """What ``compare`` found: by how much the liner and its cells differ, with intervals."""
    frequency = frequency or found.rows[0].frequency
    liner, *cells = [row for row in found.rows if row.frequency == frequency]
    x = 1e3 * np.array([row.x for row in cells], dtype=float)
    known = bool(np.isfinite(x).all())
    figure, panels = look.impedance_panels(3.0, look.X_MM if known else "cell")
    for axis, part in panels:
        axis.set_ylabel(f"difference of {axis.get_ylabel()}")
        axis.axhline(0, color="0.6", linewidth=0.6, zorder=0)
        axis.axhline(numbers.part_of(liner.difference, part), color="k", linestyle="--", label="liner")
        if liner.low is not None:
            axis.axhspan(*(numbers.part_of(end, part) for end in (liner.low, liner.high)), color="0.88", zorder=0)
    ends = None if liner.low is None else [[row[end] for row in cells] for end in ("low", "high")]
    style: Any = {"color": look.COLOURS[0], "marker": "o", "linestyle": "none", "label": "cells"}
    values = [row.difference for row in cells]
    look.draw_impedance(panels, x if known else range(len(x)), values, ends, bars=True, **style)
    words = f"second minus first, {frequency:g} Hz, averaging {found.averaging}; {found.words}"
    return look.finish(figure, path, words, 4)


@look.styled
def draw_spectrum(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, axes: Any = None, labels: Any = None
) -> Any:
    """R and X over frequency with intervals: of one run in all averagings, of several the answer of each."""
    figure, panels = look.impedance_panels(3.0, look.KHZ, axes)
    before = look.drawn_before([axis for axis, _ in panels], len(results))
    alone = len(results) == 1 and not before
    for i, (result, name) in enumerate(zip(results, labels or numbers.labels_of(results), strict=True), before):
        for averaging in result.averagings if alone else [result.averaging]:
            found, mine = result.liner[averaging], averaging == result.averaging
            ends = (found.interval.low, found.interval.high) if found.interval is not None and mine else None
            style = look.colour_of(i, averaging if alone else name)
            style |= {"color": look.AVERAGINGS[averaging], "linestyle": "-" if mine else "--"} if alone else {}
            look.draw_impedance(panels, 1e-3 * result.frequency, found.impedance.cpu(), ends, **style)
    for axis, _ in panels:
        look.frame(axis, poles=True)
    words = f"{numbers.case_title(results[0])}; bands: {numbers.interval_words(results[0]) or 'none'}"
    return look.finish(figure, path, words, 4, axes)


@look.styled
def draw_liner(profiles: Sequence[numbers.Curves], title: str, path: str | Path | None = None) -> look.Figure:
    """Resistance and reactance over frequency, one curve per speed (figure 3)."""
    figure, panels = look.impedance_panels(2.7, look.KHZ)
    for axis, part in panels:
        axis.axhline(0, color="0.7", linewidth=0.6, zorder=0)
        for i, profile in enumerate(profiles):
            look.draw_curve(axis, profile, part, **look.colour_of(i) | {"label": profile.label})
        look.frame(axis, poles=True)
    return look.finish(figure, path, title, 6)


@look.styled
def draw_velocity(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane], path: str | Path | None = None, axes: Any = None
) -> Any:
    """v0, v' and u' along x (figures 9 and 16); u' only where it is stored."""
    several = list(planes) if isinstance(planes, Sequence) else [planes]
    cases = [each.plane if isinstance(each, Moments) else each for each in several]
    profiles = [numbers.velocity_along_x(each) for each in several]
    kept = [name for name in VELOCITIES if any(name in profile.values for profile in profiles)]
    figure, panels = look.panels_of(len(kept), 2.7, axes)
    before = look.drawn_before(panels, len(several))
    for axis, quantity in zip(panels, kept, strict=False):
        for i, (profile, name) in enumerate(zip(profiles, numbers.labels_of(cases), strict=True), before):
            if quantity in profile.values:
                look.draw_curve(axis, profile, quantity, **look.colour_of(i, name))
        axis.set(xlabel=look.X_MM, ylabel=VELOCITIES[quantity], ylim=(None if quantity == "v0 (m/s)" else 0, None))
        mark_holes(axis, None if before else cases[0].holes)
    return look.finish(figure, path, numbers.case_title(cases[0]), 6, axes)


@look.styled
def draw_points(
    found: PointImpedances, path: str | Path | None = None, true: complex | None = None, title: str = "", f: int = 0
) -> look.Figure:
    """R and X of another method along x: points, cells in both ways of averaging, and a reference."""
    known, curve = bool(torch.isfinite(found.point_x).all()), numbers.points_along_x(found, f)
    figure, panels = look.impedance_panels(3.0, look.X_MM if known else "point")
    for axis, part in panels:
        look.draw_curve(axis, curve, part, **look.colour_of(0, "points"))
    if known:
        _draw_points_of_cells(panels, found, f, "cells, ")
    look.draw_references(panels, {} if true is None else {"reference": true})
    return look.finish(figure, path, f"{title or found.name}, {float(found.frequency[f]):g} Hz", 4)
