"""Drawings of lines of stations: impedance and velocity along x, averages side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import ImpedanceLine
from torchliner.report.curves import part_of
from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    PARTS,
    Figure,
    draw_band,
    finish,
    impedance_panels,
    label_axes,
    styled,
    subplots,
)

SHIFT = 0.14  # of bars side by side
PAPER_WIDTHS = 3.0  # standard deviations over the segments in the paper's coloured areas


def place_along(line: ImpedanceLine) -> tuple[np.ndarray, str]:
    """x in mm, or the number of the station where x is unknown."""
    x = line.x.numpy()
    if np.isfinite(x).all():
        return 1e3 * x, "$x$ (mm)"
    return np.arange(1, len(x) + 1, dtype=np.float64), "station"


@styled
def draw_lines(
    lines: ImpedanceLine | Sequence[ImpedanceLine],
    path: str | Path | None = None,
    frequency_index: int = 0,
    labels: Sequence[str] | None = None,
    title: str | None = None,
) -> Figure:
    """Resistance and reactance along the line (figures 10, 11).

    Area: three standard deviations over the segments, as in the paper. Dark band: the statistical
    interval of the mean. Crosses: stations that do not count in averages.
    """
    if isinstance(lines, ImpedanceLine):
        lines = [lines]
    figure, panels = impedance_panels(3.5, place_along(lines[0])[1])
    names = _labels(lines, labels)
    for axis, part in panels:
        for i, line in enumerate(lines):
            _draw_line(axis, line, part, frequency_index, i, names[i])
    title = title or f"{_head(lines, frequency_index)}\n{_band_words(lines)}"
    return finish(figure, path, title, legend=3 if len(lines) > 1 else 0)


def _draw_line(axis: Any, line: ImpedanceLine, part: str, f: int, i: int, label: str) -> None:
    x, _ = place_along(line)
    colour = COLOURS[i]
    middle = part_of(line.impedance[:, f], part)
    wide = PAPER_WIDTHS * part_of(line.segment_spread[:, f], part)
    draw_band(axis, x, middle - wide, middle + wide, colour, 0.18)
    if line.interval is not None:
        ends = (part_of(end[:, f], part) for end in (line.interval.low, line.interval.high))
        draw_band(axis, x, *ends, colour, 0.5)
    axis.plot(x, middle, color=colour, linewidth=0.8, marker=MARKERS[i],
              markersize=2.5 if len(x) > 40 else 4, label=label)  # fmt: skip
    left_out = ~line.used.numpy()
    axis.plot(x[left_out], middle[left_out], "x", color="k", markersize=6, zorder=5)


def _band_words(lines: Sequence[ImpedanceLine]) -> str:
    first = lines[0]
    words = f"light: {PAPER_WIDTHS:g} standard deviations over segments"
    if first.interval is not None:
        words += f"; dark: {100 * float(first.choices['interval']):g} % interval of the mean"
    if any(not bool(line.used.all()) for line in lines):
        words += "; crosses: not in averages"
    return words


def _head(lines: Sequence[ImpedanceLine], f: int) -> str:
    title = lines[0].title if len({line.title for line in lines}) == 1 else ""
    frequency = f"{float(lines[0].frequency[f]):g} Hz"
    return f"{title}, {frequency}" if title else frequency


def _labels(lines: Sequence[ImpedanceLine], labels: Sequence[str] | None) -> list[str]:
    if labels is not None:
        return list(labels)
    return [line.title or f"line {i}" for i, line in enumerate(lines, 1)]


@styled
def draw_line_velocity(
    lines: Sequence[ImpedanceLine],
    path: str | Path | None = None,
    labels: Sequence[str] | None = None,
    title: str | None = None,
) -> Figure:
    """Mean and rms of the wall-normal velocity along the line (figure 9)."""
    figure, axes = subplots(1, 2, 3.2)
    names = _labels(lines, labels)
    panels = (("mean_velocity", "$v_0$ (m s$^{-1}$)"), ("velocity_rms", "$v'_{rms}$ (m s$^{-1}$)"))
    for axis, (key, text) in zip(axes[0], panels, strict=True):
        for i, line in enumerate(lines):
            x, _ = place_along(line)
            values = getattr(line, key).numpy()
            axis.plot(x, values, color=COLOURS[i], linewidth=0.9, label=names[i])
        label_axes(axis, place_along(lines[0])[1], text)
    axes[0, 1].set_ylim(bottom=0)
    return finish(figure, path, title, legend=3 if len(lines) > 1 else 0)


@styled
def draw_averages(
    lines: Sequence[ImpedanceLine],
    path: str | Path | None = None,
    frequency_index: int = 0,
    labels: Sequence[str] | None = None,
    title: str | None = None,
    references: Sequence[complex | None] | None = None,
) -> Figure:
    """Z of (5.2) of several lines, each with its three widths side by side (figure 12).

    Left of the symbol the statistical interval, at it the paper's three standard deviations of the
    draws, right of it the spread along the line.
    """
    figure, axes = subplots(1, 2, 3.4)
    names = _labels(lines, labels)
    known = references or [None] * len(lines)
    for axis, (part, text) in zip(axes[0], PARTS, strict=True):
        for i, (line, published) in enumerate(zip(lines, known, strict=True)):
            if line.average is not None:
                _draw_average(axis, line, i, part, frequency_index)
            if line.average is not None and published is not None:
                axis.plot(i, part_of(published, part), "*", color=COLOURS[3], markersize=8,
                          zorder=4, label="paper")  # fmt: skip
        axis.set_xticks(range(len(lines)), names, fontsize=7)
        axis.set_xlim(-0.5, len(lines) - 0.5)
        axis.set_ylabel(text)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=3)
    return finish(figure, path, title)


def _draw_average(axis: Any, line: ImpedanceLine, i: int, part: str, f: int) -> None:
    """One line at place ``i``: its mean and three widths."""
    found = line.average
    assert found is not None
    value = float(part_of(found.impedance[f], part))
    if found.interval is not None:
        low, high = (
            float(part_of(end[f], part)) for end in (found.interval.low, found.interval.high)
        )
        level = f"{100 * float(line.choices['interval']):g} % interval"
        _bar(axis, i - SHIFT, low, high, COLOURS[0], "-", level)
    drawn = PAPER_WIDTHS * float(part_of(found.monte_carlo_spread[f], part))
    words = "3 standard deviations of the draws of (5.2)"
    _bar(axis, i, value - drawn, value + drawn, COLOURS[1], "-", words)
    along = float(part_of(found.spatial_spread[f], part))
    words = "spread along the line"
    _bar(axis, i + SHIFT, value - along, value + along, COLOURS[2], "--", words)
    axis.plot(i, value, "o", color="k", markersize=4, zorder=4, label="$Z_{mean}$")


def _bar(
    axis: Any, place: float, low: float, high: float, colour: str, style: str, label: str
) -> None:
    axis.plot(
        [place, place], [low, high], color=colour, linestyle=style, linewidth=1.8, label=label
    )
    for end in (low, high):
        axis.plot([place - 0.05, place + 0.05], [end, end], color=colour, linewidth=1.2)
