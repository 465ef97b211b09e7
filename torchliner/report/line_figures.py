"""Drawings of lines of stations: impedance and velocity along x, averages side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import ImpedanceLine
from torchliner.report.curves import COMPLEX_PART
from torchliner.report.figure import COLOURS, MARKERS, PARTS, Figure, finish, styled, subplots

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
    figure, axes = subplots(1, 2, 3.5)
    names = _labels(lines, labels)
    for axis, (part, text) in zip(axes[0], PARTS, strict=True):
        for i, line in enumerate(lines):
            _draw_line(axis, line, COMPLEX_PART[part], frequency_index, i, names[i])
        axis.set_xlabel(place_along(lines[0])[1])
        axis.set_ylabel(text)
    _legend(figure, axes[0, 0], len(lines))
    figure.suptitle(title or f"{_head(lines, frequency_index)}\n{_band_words(lines)}", fontsize=9)
    return finish(figure, path)


def _draw_line(axis: Any, line: ImpedanceLine, part: str, f: int, i: int, label: str) -> None:
    x, _ = place_along(line)
    colour = COLOURS[i % len(COLOURS)]
    middle = getattr(line.impedance[:, f], part).numpy()
    wide = PAPER_WIDTHS * getattr(line.segment_spread[:, f], part).numpy()
    axis.fill_between(x, middle - wide, middle + wide, color=colour, alpha=0.18, linewidth=0)
    if line.interval is not None:
        ends = [getattr(end[:, f], part).numpy() for end in (line.interval.low, line.interval.high)]
        axis.fill_between(x, *ends, color=colour, alpha=0.5, linewidth=0)
    axis.plot(x, middle, color=colour, linewidth=0.8, marker=MARKERS[i % len(MARKERS)],
              markersize=2.5 if len(x) > 40 else 4, label=label)  # fmt: skip
    left_out = ~line.used.numpy()
    axis.plot(x[left_out], middle[left_out], "x", color="k", markersize=6, zorder=5)


def _band_words(lines: Sequence[ImpedanceLine]) -> str:
    first = lines[0]
    said = f"light: {PAPER_WIDTHS:g} standard deviations over segments"
    if first.interval is not None:
        said += f"; dark: {100 * float(first.choices['interval']):g} % interval of the mean"
    if any(not bool(line.used.all()) for line in lines):
        said += "; crosses: not in averages"
    return said


def _head(lines: Sequence[ImpedanceLine], f: int) -> str:
    title = lines[0].title if len({line.title for line in lines}) == 1 else ""
    frequency = f"{float(lines[0].frequency[f]):g} Hz"
    return f"{title}, {frequency}" if title else frequency


def _labels(lines: Sequence[ImpedanceLine], labels: Sequence[str] | None) -> list[str]:
    if labels is not None:
        return list(labels)
    return [line.title or f"line {i}" for i, line in enumerate(lines, 1)]


def _legend(figure: Figure, axis: Any, count: int) -> None:
    if count > 1:
        handles, names = axis.get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=min(3, count))


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
            axis.plot(x, getattr(line, key).numpy(), color=COLOURS[i % len(COLOURS)],
                      linewidth=0.9, label=names[i])  # fmt: skip
        axis.set_xlabel(place_along(lines[0])[1])
        axis.set_ylabel(text)
    axes[0, 1].set_ylim(bottom=0)
    _legend(figure, axes[0, 0], len(lines))
    if title:
        figure.suptitle(title, fontsize=9)
    return finish(figure, path)


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
    f, shift = frequency_index, 0.14
    for axis, (part, text) in zip(axes[0], PARTS, strict=True):
        for i, line in enumerate(lines):
            found = line.average
            if found is None:
                continue
            kind = COMPLEX_PART[part]
            value = float(getattr(found.impedance[f], kind))
            drawn = PAPER_WIDTHS * float(getattr(found.monte_carlo_spread[f], kind))
            along = float(getattr(found.spatial_spread[f], kind))
            first = i == 0
            if found.interval is not None:
                low, high = (
                    float(getattr(end[f], kind))
                    for end in (found.interval.low, found.interval.high)
                )
                level = f"{100 * float(line.choices['interval']):g} % interval"
                _bar(axis, i - shift, low, high, COLOURS[0], "-", level if first else None)
            _bar(axis, i, value - drawn, value + drawn, COLOURS[1], "-",
                 "3 standard deviations of the draws of (5.2)" if first else None)  # fmt: skip
            _bar(axis, i + shift, value - along, value + along, COLOURS[2], "--",
                 "spread along the line" if first else None)  # fmt: skip
            axis.plot(i, value, "o", color="k", markersize=4, zorder=4,
                      label="$Z_{mean}$" if first else None)  # fmt: skip
            told = None if references is None else references[i]
            if told is not None:
                axis.plot(i, getattr(told, kind), "*", color=COLOURS[3], markersize=8, zorder=4,
                          label="paper")  # fmt: skip
        axis.set_xticks(range(len(lines)), names, fontsize=7)
        axis.set_xlim(-0.5, len(lines) - 0.5)
        axis.set_ylabel(text)
    handles, said = axes[0, 0].get_legend_handles_labels()
    unique = dict(zip(said, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=3)
    if title:
        figure.suptitle(title, fontsize=9)
    return finish(figure, path)


def _bar(
    axis: Any, place: float, low: float, high: float, colour: str, style: str, label: str | None
) -> None:
    axis.plot(
        [place, place], [low, high], color=colour, linestyle=style, linewidth=1.8, label=label
    )
    for end in (low, high):
        axis.plot([place - 0.05, place + 0.05], [end, end], color=colour, linewidth=1.2)
