"""Pictures of stations of bursts: impedance along a line, moments, rates and intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.bursts.stations import Station
from torchliner.records import ImpedanceLine
from torchliner.report.figure import (
    COLOURS,
    LINES,
    MARKERS,
    Figure,
    draw_band,
    drawn_before,
    entry,
    finish,
    impedance_panels,
    label_axes,
    place_legend,
    plain_label,
    styled,
    subplots,
)
from torchliner.report.numbers import Curves, part_of

WIDTHS_OF_SEGMENTS = 3.0  # standard deviations over the segments in the paper's coloured areas
REACH, BINS = 8.0, 32  # of the histogram of the intervals of bursts, in mean intervals
FEWEST_IN_BIN = 5  # intervals the law expects in a bin that is drawn: fewer only scatter


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
    frequency_index: int | None = 0,
    labels: Sequence[str] | None = None,
    title: str | None = None,
    axes: Any = None,
) -> Figure:
    """Resistance and reactance along the line (figures 10, 11).

    Area: three standard deviations over the segments, as in the paper. Dark band: the statistical interval of the mean.
    Crosses: stations that do not count in averages.
    """
    lines, f = [lines] if isinstance(lines, ImpedanceLine) else lines, frequency_index or 0
    figure, panels = impedance_panels(3.5, place_along(lines[0])[1], axes)
    before = drawn_before([axis for axis, _ in panels], len(lines))
    names = labels or [line.title or f"line {i}" for i, line in enumerate(lines, before + 1)]
    for axis, part in panels:
        for i, line in enumerate(lines, before):
            x, _ = place_along(line)
            middle, wide = (part_of(value[:, f], part) for value in (line.impedance, line.segment_spread))
            ends = middle - WIDTHS_OF_SEGMENTS * wide, middle + WIDTHS_OF_SEGMENTS * wide
            draw_band(axis, x, *ends, COLOURS[i], 0.18)
            if line.interval is not None:
                low, high = (part_of(end[:, f], part) for end in (line.interval.low, line.interval.high))
                draw_band(axis, x, low, high, COLOURS[i], 0.5)
            style: Any = {"linewidth": 0.8, "linestyle": LINES[i], "marker": MARKERS[i], "color": COLOURS[i]}
            style |= {"markersize": 2.5 if len(x) > 40 else 4}
            axis.plot(x, middle, label=plain_label(names[i - before]), **style)
            left_out = ~line.used.numpy()
            axis.plot(x[left_out], middle[left_out], "x", color="k", markersize=6, zorder=5)
    if not before:
        entry(panels[0][0], "3 standard deviations over segments", width=5, color="0.85")
        if lines[0].interval is not None:
            entry(panels[0][0], f"{100 * float(lines[0].choices['interval']):g} % interval", width=5, color="0.5")
        if any(not bool(line.used.all()) for line in lines):
            entry(panels[0][0], "not in averages", "x", markersize=6)
    shared = lines[0].title if len({line.title for line in lines}) == 1 else ""
    caption = title or ", ".join(filter(None, (shared, f"{float(lines[0].frequency[f]):g} Hz")))
    return finish(figure, path, caption, 3, axes)


def moment_of(station: Station, component: str, key: str) -> float:
    """Of a velocity component, m/s; nan where it was not measured."""
    value = getattr(station.moments.components.get(component), key, None)
    return math.nan if value is None else float(value)


def intervals_of(stations: Sequence[Station]) -> Curves:
    """Density of the intervals of each station in units of its own mean interval, and the law's."""
    edges = np.linspace(0, REACH, BINS + 1)
    values = {"exponential": -np.diff(np.exp(-edges)) / np.diff(edges)}
    for i, station in enumerate(stations, 1):
        density = np.full(BINS, np.nan)
        steps = station.kept.arrival_time.diff().numpy() * station.moments.rate
        if station.moments.rate > 0 and (steps >= 0).all():
            density = np.histogram(steps[steps < REACH], edges)[0] / (len(steps) * np.diff(edges))
        values[f"{i} {station.name}"] = density
    return Curves((edges[1:] + edges[:-1]) / 2, values, "", "interval times rate")


@styled
def draw_stations(stations: Sequence[Station], path: str | Path | None = None) -> Figure:
    """Mean and rms both ways, rate, and intervals beside the exponential law."""
    place, label = _places(stations)
    flagged = np.array([bool(station.flags) for station in stations])
    components = {"wall_normal": "v", "streamwise": "u"}
    name = next(n for n in components if any(n in station.moments.components for station in stations))
    short, (figure, axes) = components[name], subplots(2, 2, 4.6)
    symbols = {"mean": f"mean ${short}$", "rms": rf"${short}'_{{\mathrm{{rms}}}}$"}
    for axis, (key, text) in zip(axes[0], symbols.items(), strict=True):
        for i, (each, words) in enumerate(((key, "arithmetic"), (f"weighted_{key}", "by transit time"))):
            values = np.array([moment_of(station, name, each) for station in stations])
            face = COLOURS[0] if i == 0 else "white"
            axis.plot(place, values, MARKERS[i] + "-", color=COLOURS[i], markerfacecolor=face, label=words)
        marked: Any = {"color": "k", "markersize": 7, "linestyle": "none", "label": "flagged"}
        if flagged.any():
            axis.plot(place[flagged], values[flagged], "x", **marked)
        label_axes(axis, label, rf"{text} (m s$^{{-1}}$)")
    axes[1, 0].plot(place, [station.moments.rate for station in stations], "o-", color=COLOURS[0])
    label_axes(axes[1, 0], label, r"rate (s$^{-1}$)")
    axes[1, 0].set_ylim(bottom=0)
    _draw_intervals(axes[1, 1], stations)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    more = axes[1, 1].get_legend_handles_labels()
    place_legend(figure, handles + more[0], labels + more[1], 3)
    return finish(figure, path, "stations of bursts")


def _places(stations: Sequence[Station]) -> tuple[np.ndarray, str]:
    """Where the stations lie, for a figure: x (mm), else y or z, else their number."""
    for key in "xyz":
        values = [getattr(station.kept, key) for station in stations]
        if None not in values and len(set(values)) == len(values) > 1:
            return 1e3 * np.array(values, dtype=np.float64), f"${key}$ (mm)"
    return np.arange(1, len(stations) + 1, dtype=np.float64), "station"


def _draw_intervals(axis: Any, stations: Sequence[Station]) -> None:
    """Each station scaled by its own rate, in bins where the law expects some, and the law."""
    curves = intervals_of(stations)
    law, *columns = curves.values.values()
    for station, density in zip(stations, columns, strict=True):
        drawn = (station.kept.bursts * law * REACH / BINS >= FEWEST_IN_BIN) & (density > 0)
        style = ":" if station.flags else "-"
        axis.plot(curves.at, np.where(drawn, density, np.nan), color="0.65", linewidth=0.7, linestyle=style)
    entry(axis, "intervals, a line a station", color="0.65", linewidth=0.7)
    if any(station.flags for station in stations):
        entry(axis, "those of flagged stations", color="0.65", linewidth=0.7, linestyle=":")
    span = np.linspace(0, REACH, 50)
    axis.plot(span, np.exp(-span), color="k", linestyle="--", label="exponential law")
    axis.set_yscale("log")
    label_axes(axis, "interval times rate", "density times mean interval")
