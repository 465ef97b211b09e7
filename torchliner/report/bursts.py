"""Pictures of stations of bursts: impedance along a line, moments and rates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.bursts.stations import Station
from torchliner.records import ImpedanceLine
from torchliner.report import figure as look
from torchliner.report.table import Row

WIDTHS_OF_SEGMENTS = 3.0  # standard deviations over the segments in the paper's coloured areas


def place_along(line: ImpedanceLine) -> tuple[np.ndarray, str]:
    """x in mm, or the number of the station where x is unknown."""
    x = line.x.numpy()
    known = np.isfinite(x).all()
    return (1e3 * x, look.X_MM) if known else (np.arange(1, len(x) + 1, dtype=float), "station")


def draw_lines(
    lines: ImpedanceLine | Sequence[ImpedanceLine],
    path: str | Path | None = None,
    frequency_index: int | None = 0,
    labels: Sequence[str] | None = None,
    title: str | None = None,
    axes: Any = None,
) -> look.Figure:
    """Resistance and reactance along the line (figures 10, 11).

    Area: three standard deviations over the segments, as in the paper. Dark band: the statistical interval of the mean.
    Crosses: stations that do not count in averages.
    """
    lines, f = [lines] if isinstance(lines, ImpedanceLine) else lines, frequency_index or 0
    before, drawn = look.runs_in(axes), list[Row]()
    for i, line in enumerate(lines, before):
        x, z, out = place_along(line)[0], line.impedance[:, f], ~line.used
        wide, name = WIDTHS_OF_SEGMENTS * line.segment_spread[:, f], line.title or f"line {i + 1}"
        style = look.colour_of(i, labels[i - before] if labels else name, marker=look.MARKERS[i], markersize=2.5)
        drawn.append({"x": x, "y": z, "ends": (z - wide, z + wide)} | style)
        if line.interval is not None:
            ends = line.interval.low[:, f], line.interval.high[:, f]
            drawn.append({"x": x, "y": z, "ends": ends, "color": look.COLOURS[i]})
        drawn.append({"x": x[out], "y": z[out]} | look.dots("k", "x", "not in averages" if out.any() else ""))

    def more(axis: Any, part: str) -> None:
        if before or part == "reactance":
            return
        look.entry(axis, "3 standard deviations over segments", color="0.85", **look.BAND)
        if lines[0].interval is not None:
            words = f"{100 * float(lines[0].choices['interval']):g} % interval"
            look.entry(axis, words, color="0.6", **look.BAND)

    about = {"more": more, "poles": None, "height": 3.5, "legend": 3, "axes": axes, "runs": len(lines)}
    caption = title or f"{lines[0].title} {float(lines[0].frequency[f]):g} Hz"
    return look.draw_parts(drawn, place_along(lines[0])[1], path, caption, **about)


def moment_of(station: Station, component: str, key: str) -> float:
    """Of a velocity component, m/s; nan where it was not measured."""
    value = getattr(station.moments.components.get(component), key, None)
    return math.nan if value is None else float(value)


@look.styled
def draw_stations(rows: Sequence[Row], path: str | Path | None = None) -> look.Figure:
    """Rms both ways and rate of bursts, along x where it is known; crosses: flagged stations."""
    placed = None not in (x := [row["x"] for row in rows])
    place = 1e3 * np.array(x, dtype=float) if placed else np.arange(1, len(rows) + 1)
    flagged = np.array([bool(row["flags"]) for row in rows])
    short = "v" if any(math.isfinite(row["v rms (m/s)"]) for row in rows) else "u"
    symbol = look.V_RMS if short == "v" else look.U_RMS
    figure, (rms, rate) = look.panels_of(2, 2.9)
    for i, (each, words) in enumerate({"rms": "arithmetic", "weighted_rms": "by transit time"}.items()):
        values = np.array([row[f"{short} {each} (m/s)"] for row in rows])
        rms.plot(place, values, **look.colour_of(i, words, marker=look.MARKERS[i]))
    rms.plot(place[flagged], values[flagged], "kx", label="flagged" if flagged.any() else "")
    rate.plot(place, [row["rate"] for row in rows], "o-", color=look.COLOURS[0])
    rms.set(xlabel=look.X_MM if placed else "station", ylabel=f"{symbol} (m s$^{{-1}}$)")
    rate.set(xlabel=look.X_MM if placed else "station", ylabel=r"rate of bursts (s$^{-1}$)", ylim=(0, None))
    return look.finish(figure, path, "stations of bursts", 3)
