"""Contents and usability of stations of bursts: one list of columns for text, JSON and CSV, and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.bursts.stations import Station
from torchliner.report.figure import COLOURS, Figure, finish, label_axes, place_legend, styled, subplots
from torchliner.report.numbers import Curves
from torchliner.report.table import Column, Table

REACH, BINS = 8.0, 32  # of the histogram of the intervals, in mean intervals
FEWEST_IN_BIN = 5  # intervals the law expects in a bin that is drawn: fewer only scatter
SHORT = {"wall_normal": "v", "streamwise": "u"}
MOMENTS = {"mean": "mean", "rms": "rms", "weighted_mean": "weighted mean", "weighted_rms": "weighted rms"}
HEAD = (
    Column("station", "name", "station"),
    *(Column(f"{key} (m)", f"kept.{key}", f"{key} mm", ".3f", 1e3) for key in "xyz"),
    Column("received", "kept.received"),
    Column("bursts", "kept.bursts", "bursts", "d"),
    Column("", lambda one: one.kept.received - one.kept.bursts, "dropped", "d"),
    Column("duration (s)", "moments.duration", "T s", ".3f"),
    Column("rate (1/s)", "moments.rate", "rate /s", ".1f"),
    Column("longest gap (s)", "moments.longest_gap", "gap ms", ".2f", 1e3),
    Column("irregularity", "moments.irregularity"),
)
FLAGS = (Column("flags", lambda one: len(one.flags)), Column("", lambda one: len(one.flags) or "", "flags"))


def _moment(component: str, key: str, station: Station) -> float | None:
    """Of a velocity component, m/s; None where it was not measured."""
    return getattr(station.moments.components.get(component), key, None)


def _zeros(component: str, station: Station) -> float | None:
    return station.zero_shares.get(component)


def station_table(stations: Sequence[Station]) -> Table:
    """One row per station; CSV and JSON have the same columns for all, the text those that were measured."""
    parts = []
    for name, short in SHORT.items():
        shown = any(name in station.moments.components for station in stations)
        for key, words in MOMENTS.items():
            heading = f"{short} {words}" if shown else ""
            parts.append(Column(f"{short} {key} (m/s)", partial(_moment, name, key), heading, ".3f"))
        parts.append(Column(f"{short} zero share", partial(_zeros, name), f"{short}=0 %" if shown else "", ".1f", 100))
    return Table(stations, (*HEAD, *parts, *FLAGS))


def plain_stations(stations: Sequence[Station]) -> list[dict[str, Any]]:
    """The rows of the table for JSON, with flags and notes in words, and what was dropped for which reason."""
    rows = station_table(stations).as_rows()
    return [
        row | {"flags": one.flags, "dropped": dict(one.kept.dropped), "notes": list(one.kept.notes)}
        for row, one in zip(rows, stations, strict=True)
    ]


def format_stations(stations: Sequence[Station]) -> str:
    """One row per station, then what was dropped and why, notes and flags."""
    lines = [station_table(stations).as_text()]
    if any(not station.moments.weighted for station in stations):
        lines.append("No transit times at some stations: there weighted is not weighted")
    for one in stations:
        dropped = [f"{count} dropped: {reason}" for reason, count in one.kept.dropped.items()]
        messages = [*dropped, *one.kept.notes, *(f"FLAGGED: {flag}" for flag in one.flags)]
        lines += [f"{one.name}: {message}" for message in messages]
    count = sum(1 for station in stations if station.flags)
    return "\n".join([*lines, f"{count} of {len(stations)} stations are flagged" if count else "no flags"])


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
    name = next(n for n in SHORT if any(n in station.moments.components for station in stations))
    short, (figure, axes) = SHORT[name], subplots(2, 2, 4.6)

    def draw(axis: Any, values: Any, colour: str, marked: str | None = None, **style: Any) -> None:
        numbers = np.array(list(values), dtype=np.float64)
        axis.plot(place, numbers, color=colour, **style)
        axis.plot(place[flagged], numbers[flagged], "x", color="k", markersize=7, zorder=5, label=marked)

    marked = "flagged" if flagged.any() else None
    symbols = {"mean": f"mean ${short}$", "rms": rf"${short}'_{{\mathrm{{rms}}}}$"}
    for axis, (key, text) in zip(axes[0], symbols.items(), strict=True):
        plain, weighted = (map(partial(_moment, name, each), stations) for each in (key, f"weighted_{key}"))
        draw(axis, plain, COLOURS[0], marker="o", label="arithmetic")
        draw(axis, weighted, COLOURS[1], marked, marker="s", markerfacecolor="white", label="by transit time")
        label_axes(axis, label, rf"{text} (m s$^{{-1}}$)")
    draw(axes[1, 0], (station.moments.rate for station in stations), COLOURS[0], marker="o")
    label_axes(axes[1, 0], label, r"rate (s$^{-1}$)")
    axes[1, 0].set_ylim(bottom=0)
    _draw_intervals(axes[1, 1], stations)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    more = axes[1, 1].get_legend_handles_labels()
    place_legend(figure, handles + more[0], labels + more[1], 3)
    return finish(figure, path)


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
    for style, label in (("-", "intervals, a line a station"), (":", "those of flagged stations")):
        axis.plot([], [], color="0.65", linewidth=0.7, linestyle=style, label=label)
    span = np.linspace(0, REACH, 50)
    axis.plot(span, np.exp(-span), color="k", linestyle="--", label="exponential law")
    axis.set_yscale("log")
    label_axes(axis, "interval times rate", "density times mean interval")
