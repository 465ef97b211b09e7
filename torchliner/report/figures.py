"""Drawings. No physics here: what is drawn comes from ``numbers`` and from the records."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.engine.moments import Moments
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.report.alongside import alongside_at, alongside_surfaces, draw_alongside
from torchliner.report.cell_figures import draw_cells
from torchliner.report.figure import (
    COLOURS,
    LINES,
    MARKERS,
    ONE_ROW,
    PARTS,
    REFERENCES,
    U_RMS,
    V_RMS,
    Figure,
    draw_band,
    draw_curve,
    entry,
    finish,
    frame,
    impedance_panels,
    label_axes,
    panels_of,
    styled,
    subplots,
)  # fmt: skip
from torchliner.report.hole_figures import mark_borders, shade_holes
from torchliner.report.map_figures import Limits, draw_plane, mesh_of
from torchliner.report.numbers import (
    Curves,
    against_height,
    case_title,
    impedance_along_x,
    impedance_over_frequency,
    interval_words,
    part_of,
    velocity_along_x,
)

CORNERS = ((4, -9), (4, 4), (-4, 4))  # pt, of labels beside points, by averaging
BARS = 15  # statistical intervals along a spectrum, about


def draw_map(
    result: ImpedanceMap, path: str | Path | None = None, frequency_index: int = 0,
    axes: Any = None, limits: Limits | None = None,
) -> Figure:  # fmt: skip
    """Resistance and reactance over (x, z), of planes and of scattered probes, or along x for a
    line; returns the figure, or the axes that were given.

    ``limits``: ends of the colours by part, of ``map_limits`` where maps are to be compared.
    """
    if over_surface(result, frequency_index):
        return draw_plane(result, path, frequency_index, axes, limits)
    return draw_along_x([result], path, frequency_index, axes)


def over_surface(result: ImpedanceMap, frequency_index: int = 0) -> bool:
    """Whether there is a picture over (x, z): of rows and columns, or of scattered probes."""
    grid = result.mean_velocity.ndim == 2 and min(result.mean_velocity.shape) > 1
    return grid or mesh_of(result, frequency_index) is not None


@styled
def draw_along_x(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, frequency_index: int = 0,
    axes: Any = None,
) -> Any:  # fmt: skip
    """R and X along x at several heights, with cell averages and references (figures 10, 17).

    The axes show curves, cells and references; of wider intervals what lies near them.
    """
    ordered = sorted(results, key=lambda r: r.height or 0.0)
    figure, panels = impedance_panels(3.0, "$x$ (mm)" if ordered[0].x is not None else "probe", axes)
    cut = False
    for axis, part in panels:
        shown: list[Any] = []
        bands: list[Any] = []
        for i, result in enumerate(ordered):
            profile = impedance_along_x(result, frequency_index)
            scale = 1.0 if result.x is None else 1e3
            label = profile.label or "educed"
            draw_curve(axis, profile, part, COLOURS[i], scale, label=label, linestyle=LINES[i])
            shown.append(profile.values[part])
            bands += [profile.values[key] for key in profile.values if key.startswith(f"{part} ")]
        shown += draw_cells(axis, ordered, part, frequency_index)
        for i, (name, value) in enumerate(_references(ordered, frequency_index).items()):
            axis.axhline(part_of(value, part), **{"label": name} | REFERENCES[i % 4])
            shown.append([part_of(value, part)])
        draw_alongside(axis, ordered, part, frequency_index)
        shown += [part_of(other.cell_impedance[:, j], part)
                  for other, j in alongside_at(ordered, frequency_index)]  # fmt: skip
        cut |= frame(axis, np.concatenate(shown), *bands)
        if ordered[0].x is not None:
            shade_holes(axis, ordered[0].holes)
            mark_borders(axis, ordered[0])
    words = interval_words(ordered[0])
    if words:
        entry(panels[0][0], words, width=5, color="0.8")
    caption = _family(ordered, frequency_index)
    caption += "; intervals go on beyond the axes" * cut
    return finish(figure, path, caption, 4, axes)


def _references(results: Sequence[ImpedanceMap], frequency_index: int) -> dict[str, complex]:
    """Independent impedances of the case, "true" first, and Goodrich's where the flow is known."""
    seen: dict[str, complex] = {}
    for result in results:
        seen.update(result.reference_at(frequency_index))
        if result.goodrich is not None:
            seen["Goodrich (2.7), linear liner"] = complex(result.goodrich[frequency_index])
    return dict(sorted(seen.items(), key=lambda item: item[0] != "true"))


@styled
def draw_against_height(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, frequency_index: int = 0
) -> Figure:
    """Z in the complex plane at several heights, all averagings (figure 19a's trend).

    Raises:
        ValueError: no result states a height.
    """
    frequency = float(results[0].frequency[frequency_index])
    rows = [
        row for row in against_height(results)
        if row.frequency == frequency and row.height is not None
    ]  # fmt: skip
    if not rows:
        raise ValueError(
            f"{results[0].title or 'the result'} states no height; a figure over height needs one, "
            "in m, with the plane (height=)"
        )
    figure, axes = subplots(1, 1, 3.3)
    axis = axes[0, 0]
    averagings = results[0].averagings
    shown = [row.impedance[averaging] for row in rows for averaging in averagings]
    references = _references(results, frequency_index)
    references |= alongside_surfaces(results, frequency_index)
    shown += references.values()
    span = max(np.ptp(np.real(shown)), np.ptp(np.imag(shown)))
    for i, averaging in enumerate(averagings):
        values = np.array([row.impedance[averaging] for row in rows])
        axis.plot(values.real, values.imag, MARKERS[i] + "-", color=COLOURS[i], label=averaging, zorder=3)
        for row, value in zip(rows, values, strict=True):
            _draw_cross(axis, value, row.interval[averaging], COLOURS[i])
        _label_heights(axis, rows, values, i, 0.05 * span)
    for i, (name, value) in enumerate(references.items()):
        axis.plot(
            value.real, value.imag, "*x+1234"[i % 7], color="k", markersize=9 if i == 0 else 7,
            label=name, linestyle="none",
        )  # fmt: skip
    cut = _around(axis, np.array(shown))
    label_axes(axis, PARTS[0][1], PARTS[1][1])
    caption = f"{_family(results, frequency_index)}; numbers: height y in mm"
    words = interval_words(results[0])
    caption += f"; crosses: {words}{', beyond the axes' * cut}" if words else ""
    return finish(figure, path, caption, legend=ONE_ROW)


def _around(axis: Any, shown: Any) -> bool:
    """Limits about the values, whatever the length of their crosses; whether some are cut off."""
    cut = False
    for values, get, put in ((shown.real, axis.get_xlim, axis.set_xlim),
                             (shown.imag, axis.get_ylim, axis.set_ylim)):  # fmt: skip
        low, high = np.nanmin(values), np.nanmax(values)
        margin = 0.5 * (high - low) or 0.1
        ends = max(get()[0], low - margin), min(get()[1], high + margin)
        cut |= bool(ends[0] > get()[0] or ends[1] < get()[1])
        put(*ends)
    return cut


def _draw_cross(axis: Any, value: complex, interval: Any, colour: str) -> None:
    """The statistical intervals of resistance and reactance."""
    if interval is not None:
        low, high = interval
        axis.plot([low.real, high.real], [value.imag] * 2, color=colour, linewidth=0.8, zorder=2)
        axis.plot([value.real] * 2, [low.imag, high.imag], color=colour, linewidth=0.8, zorder=2)


def _label_heights(axis: Any, rows: Any, values: Any, number: int, close: float) -> None:
    """Heights in mm beside the points of an averaging; points on top of each other share one label."""
    (across, up), last = CORNERS[number % len(CORNERS)], 0
    for i in range(1, len(rows) + 1):
        if i < len(rows) and abs(values[i] - values[last]) < close:
            continue
        heights = [1e3 * row.height for row in rows[last:i]]
        text = " to ".join(f"{h:.3g}" for h in sorted({min(heights), max(heights)}))
        place = (values[last].real, values[last].imag)
        axis.annotate(
            text,
            place,
            textcoords="offset points",
            xytext=(across, up),
            fontsize=7,
            color=COLOURS[number],
            ha="left" if across > 0 else "right",
            zorder=5,
        )
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
    labels = {"v0 (m/s)": "$v_0$ (m s$^{-1}$)", "v' rms (m/s)": f"{V_RMS} (m s$^{{-1}}$)",
              "u' rms (m/s)": f"{U_RMS} (m s$^{{-1}}$)"}  # fmt: skip
    kept = [name for name in labels if any(name in profile.values for profile in profiles)]
    figure, panels = panels_of(len(kept), 2.7, axes)
    for axis, name in zip(panels, kept, strict=False):
        for profile, colour, line in zip(profiles, COLOURS, LINES, strict=False):
            if name in profile.values:
                draw_curve(axis, profile, name, colour, 1e3, linestyle=line)
        label_axes(axis, "$x$ (mm)", labels[name])
        shade_holes(axis, cases[0].holes)
        if name != "v0 (m/s)":
            axis.set_ylim(bottom=0)
    return finish(figure, path, case_title(cases[0]), ONE_ROW, axes)


@styled
def draw_liner(profiles: Sequence[Curves], title: str, path: str | Path | None = None) -> Figure:
    """Resistance and reactance over frequency, one curve per speed (figure 3)."""
    figure, panels = impedance_panels(2.7, "$f$ (kHz)")
    for axis, part in panels:
        for i, profile in enumerate(profiles):
            draw_curve(axis, profile, part, COLOURS[i], 1e-3, linestyle=LINES[i])
        axis.axhline(0, color="0.7", linewidth=0.6, zorder=0)
        axis.set_xlim(1e-3 * profiles[0].at[0], 1e-3 * profiles[0].at[-1])
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
            axis.plot(kilohertz, numbers.values[part], color=colour, label=numbers.label or "educed")
            drawn.append(numbers.values[part])
            for other, style in zip(_others(result), ("--", ":"), strict=False):
                axis.plot(kilohertz, numbers.values[f"{part}, {other}"], style, color=colour)
                drawn.append(numbers.values[f"{part}, {other}"])
            low, high = (numbers.values[f"{part}, {share} % of probes"] for share in (25, 75))
            draw_band(axis, kilohertz, low, high, colour)
            if f"{part} low" in numbers.values:
                step = max(1, len(kilohertz) // BARS)
                some = slice(i % step, None, step)
                ends = (numbers.values[f"{part} {end}"][some] for end in ("low", "high"))
                axis.vlines(kilohertz[some], *ends, color=colour, linewidth=1.2, zorder=3)
        # A cavity's antiresonance, where Z has a pole, would hide all the rest.
        low, high = np.nanpercentile(np.concatenate(drawn), [5, 90])
        margin = 0.5 * (high - low) + 1e-9
        axis.set_ylim(low - margin, high + margin)
    panels[1][0].axhline(0, color="0.6", linewidth=0.6, zorder=0)
    caption = f"{case_title(ordered[0]) or 'educed impedance'}; the axes end before a pole of Z"
    axis = panels[0][0]
    averagings = (ordered[0].averaging, *_others(ordered[0]))
    for averaging, style in zip(averagings, ("-", "--", ":"), strict=False):
        entry(axis, averaging, linestyle=style)
    entry(axis, "middle half of the probes", width=5, color="0.8")
    if words := interval_words(ordered[0]):
        entry(axis, words, "|", markersize=9, markeredgewidth=1.2)
    return finish(figure, path, caption, legend=4)


def _others(result: ImpedanceMap) -> list[str]:
    return [averaging for averaging in result.averagings if averaging != result.averaging]


def _family(results: Sequence[ImpedanceMap], frequency_index: int) -> str:
    """What several results share: the title up to the height, the frequency, the null test."""
    title = case_title(results[0]) or "educed impedance"
    hard = any(result.choices.get("surface") == "hard wall" for result in results)
    frequency = float(results[0].frequency[frequency_index])
    return f"{title}{' (null test)' * hard}, {frequency:g} Hz"
