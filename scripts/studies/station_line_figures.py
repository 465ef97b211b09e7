"""Lines of stations: velocity along x, averages side by side (figures 9 and 12)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torchliner.records import ImpedanceLine
from torchliner.report.bursts import WIDTHS_OF_SEGMENTS, place_along
from torchliner.report.figure import (
    COLOURS,
    LINES,
    PARTS,
    V_RMS,
    Figure,
    finish,
    legend_below,
    part_of,
    styled,
    subplots,
)

SHIFT = 0.14  # of bars side by side


@styled
def draw_line_velocity(
    lines: Sequence[ImpedanceLine],
    path: str | Path | None = None,
    labels: Sequence[str] | None = None,
    title: str | None = None,
) -> Figure:
    """Mean and rms of the wall-normal velocity along the line (figure 9)."""
    figure, axes = subplots(1, 2, 3.2)
    names = labels or [line.title for line in lines]
    panels = (("mean_velocity", "$v_0$ (m s$^{-1}$)"), ("velocity_rms", f"{V_RMS} (m s$^{{-1}}$)"))
    for axis, (key, text) in zip(axes[0], panels, strict=True):
        for i, line in enumerate(lines):
            x, _ = place_along(line)
            values = getattr(line, key).numpy()
            axis.plot(x, values, color=COLOURS[i], linewidth=0.9, linestyle=LINES[i], label=names[i])
        axis.set(xlabel=place_along(lines[0])[1], ylabel=text)
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

    Right of the symbol the statistical interval, the paper's three standard deviations of the draws
    and the spread along the line.
    """
    figure, axes = subplots(1, 2, 3.4)
    names = labels or [line.title for line in lines]
    known = references or [None] * len(lines)
    for axis, (part, text) in zip(axes[0], PARTS, strict=True):
        for i, (line, published) in enumerate(zip(lines, known, strict=True)):
            if line.average is not None:
                _draw_average(axis, line, i, part, frequency_index)
            if line.average is not None and published is not None:
                axis.plot(
                    i - 2 * SHIFT,
                    part_of(published, part),
                    "*",
                    color=COLOURS[3],
                    markersize=8,
                    zorder=4,
                    label="paper",
                )
        axis.set_xticks(range(len(lines)), names, fontsize=7)
        axis.set_xlim(-0.5, len(lines) - 0.5)
        axis.set(xlabel="configuration", ylabel=text)
    legend_below(figure, axes[0, 0], 3)
    return finish(figure, path, title)


def _draw_average(axis: Any, line: ImpedanceLine, i: int, part: str, f: int) -> None:
    """One line at place ``i``: its mean and three widths."""
    found = line.average
    assert found is not None
    value = float(part_of(found.impedance[f], part))
    if found.interval is not None:
        low, high = (float(part_of(end[f], part)) for end in (found.interval.low, found.interval.high))
        level = f"{100 * float(line.choices['interval']):g} % interval"
        _bar(axis, i - SHIFT, low, high, COLOURS[0], "-", level)
    drawn = WIDTHS_OF_SEGMENTS * float(part_of(found.monte_carlo_spread[f], part))
    words = "3 standard deviations of the draws of (5.2)"
    _bar(axis, i, value - drawn, value + drawn, COLOURS[1], "-", words)
    along = float(part_of(found.spatial_spread[f], part))
    words = "spread along the line"
    _bar(axis, i + SHIFT, value - along, value + along, COLOURS[2], "--", words)
    axis.plot(i - 2 * SHIFT, value, "o", color="k", markersize=3, zorder=4, label="$Z_\\mathrm{mean}$")


def _bar(axis: Any, place: float, low: float, high: float, colour: str, style: str, label: str) -> None:
    axis.plot([place, place], [low, high], color=colour, linestyle=style, linewidth=1.8, label=label)
    for end in (low, high):
        axis.plot([place - 0.05, place + 0.05], [end, end], color=colour, linewidth=1.2)
