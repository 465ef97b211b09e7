"""Pictures of stations of bursts: impedance along a line, moments, rates and intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.bursts.stations import Station
from torchliner.records import ImpedanceLine
from torchliner.report import figure as look
from torchliner.report.numbers import Curves

WIDTHS_OF_SEGMENTS = 3.0  # standard deviations over the segments in the paper's coloured areas
REACH, BINS = 8.0, 32  # of the histogram of the intervals of bursts, in mean intervals


def place_along(line: ImpedanceLine) -> tuple[np.ndarray, str]:
    """x in mm, or the number of the station where x is unknown."""
    x = line.x.numpy()
    known = np.isfinite(x).all()
    return (1e3 * x, look.X_MM) if known else (np.arange(1, len(x) + 1, dtype=float), "station")


@look.styled
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
    figure, panels = look.impedance_panels(3.5, place_along(lines[0])[1], axes)
    before = look.drawn_before([axis for axis, _ in panels], len(lines))
    for i, line in enumerate(lines, before):
        x, z, out = place_along(line)[0], line.impedance[:, f], ~line.used
        wide, name = WIDTHS_OF_SEGMENTS * line.segment_spread[:, f], line.title or f"line {i + 1}"
        style = look.colour_of(i, labels[i - before] if labels else name, marker=look.MARKERS[i], markersize=2.5)
        look.draw_impedance(panels, x, z, (z - wide, z + wide), **style)
        if line.interval is not None:
            ends = line.interval.low[:, f], line.interval.high[:, f]
            look.draw_impedance(panels, x, z, ends, color=look.COLOURS[i])
        label = "not in averages" if out.any() else ""
        look.draw_impedance(panels, x[out], z[out], color="k", marker="x", linestyle="none", label=label)
    if not before:
        look.entry(panels[0][0], "3 standard deviations over segments", color="0.85", **look.BAND)
        if lines[0].interval is not None:
            words = f"{100 * float(lines[0].choices['interval']):g} % interval"
            look.entry(panels[0][0], words, color="0.6", **look.BAND)
    caption = title or f"{lines[0].title} {float(lines[0].frequency[f]):g} Hz"
    return look.finish(figure, path, caption, 3, axes)


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


@look.styled
def draw_stations(stations: Sequence[Station], path: str | Path | None = None) -> look.Figure:
    """Mean and rms both ways, rate, and intervals beside the exponential law."""
    place, across = _places(stations)
    flagged = np.array([bool(station.flags) for station in stations])
    components = {"wall_normal": "v", "streamwise": "u"}
    name = next(n for n in components if any(n in station.moments.components for station in stations))
    short, (figure, axes) = components[name], look.subplots(2, 2, 4.6)
    symbols = {"mean": f"mean ${short}$", "rms": rf"${short}'_{{\mathrm{{rms}}}}$"}
    for axis, (key, text) in zip(axes[0], symbols.items(), strict=True):
        for i, (each, words) in enumerate({key: "arithmetic", f"weighted_{key}": "by transit time"}.items()):
            values = np.array([moment_of(station, name, each) for station in stations])
            axis.plot(place, values, **look.colour_of(i, words, marker=look.MARKERS[i]))
        axis.plot(place[flagged], values[flagged], "kx", label="flagged" if flagged.any() else "")
        axis.set(xlabel=across, ylabel=rf"{text} (m s$^{{-1}}$)")
    axes[1, 0].plot(place, [station.moments.rate for station in stations], "o-", color=look.COLOURS[0])
    axes[1, 0].set(xlabel=across, ylabel=r"rate (s$^{-1}$)", ylim=(0, None))
    curves, axis = intervals_of(stations), axes[1, 1]
    law, *densities = (np.where(density > 0, density, np.nan) for density in curves.values.values())
    for density in densities:
        axis.plot(curves.at, density, color="0.65", linewidth=0.7, label="intervals, a line a station")
    axis.plot(curves.at, law, "k--", label="exponential law")
    axis.set(yscale="log", xlabel="interval times rate", ylabel="density times mean interval")
    look.legend_below(figure, [axes[0, 0], axis], 3)
    return look.finish(figure, path, "stations of bursts")


def _places(stations: Sequence[Station]) -> tuple[np.ndarray, str]:
    """Where the stations lie, for a figure: x (mm), else y or z, else their number."""
    for key in "xyz":
        values = [getattr(station.kept, key) for station in stations]
        if None not in values and len(set(values)) == len(values) > 1:
            return 1e3 * np.array(values, dtype=float), f"${key}$ (mm)"
    return np.arange(1, len(stations) + 1, dtype=float), "station"
