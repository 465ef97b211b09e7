"""Drawing of lines of stations: impedance along x."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import ImpedanceLine
from torchliner.report.figure import (
    COLOURS,
    LINES,
    MARKERS,
    Figure,
    draw_band,
    entry,
    finish,
    impedance_panels,
    styled,
)
from torchliner.report.numbers import part_of

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
    axes: Any = None,
) -> Figure:
    """Resistance and reactance along the line (figures 10, 11).

    Area: three standard deviations over the segments, as in the paper. Dark band: the statistical
    interval of the mean. Crosses: stations that do not count in averages.
    """
    lines = [lines] if isinstance(lines, ImpedanceLine) else lines
    figure, panels = impedance_panels(3.5, place_along(lines[0])[1], axes)
    names = labels_of(lines, labels)
    for axis, part in panels:
        for i, line in enumerate(lines):
            _draw_line(axis, line, part, frequency_index, i, names[i])
    first, f = lines[0], float(lines[0].frequency[frequency_index])
    entry(panels[0][0], f"{PAPER_WIDTHS:g} standard deviations over segments", width=5, color="0.85")
    if first.interval is not None:
        share = 100 * float(first.choices["interval"])
        entry(panels[0][0], f"{share:g} % statistical interval of the mean", width=5, color="0.5")
    if any(not bool(line.used.all()) for line in lines):
        entry(panels[0][0], "not in averages", "x", markersize=6)
    shared = first.title if len({line.title for line in lines}) == 1 else ""
    return finish(figure, path, title or ", ".join(filter(None, (shared, f"{f:g} Hz"))), 3, axes)


def _draw_line(axis: Any, line: ImpedanceLine, part: str, f: int, i: int, label: str) -> None:
    x, _ = place_along(line)
    middle, wide = (part_of(value[:, f], part) for value in (line.impedance, line.segment_spread))
    draw_band(axis, x, middle - PAPER_WIDTHS * wide, middle + PAPER_WIDTHS * wide, COLOURS[i], 0.18)
    if line.interval is not None:
        low, high = (part_of(end[:, f], part) for end in (line.interval.low, line.interval.high))
        draw_band(axis, x, low, high, COLOURS[i], 0.5)
    style = {"linewidth": 0.8, "linestyle": LINES[i], "marker": MARKERS[i], "markersize": 2.5 if len(x) > 40 else 4}
    axis.plot(x, middle, color=COLOURS[i], label=label, **style)
    left_out = ~line.used.numpy()
    axis.plot(x[left_out], middle[left_out], "x", color="k", markersize=6, zorder=5)


def labels_of(lines: Sequence[ImpedanceLine], labels: Sequence[str] | None) -> list[str]:
    """For legends: as given, or their titles, or numbers."""
    if labels is not None:
        return list(labels)
    return [line.title or f"line {i}" for i, line in enumerate(lines, 1)]
