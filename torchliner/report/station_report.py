"""Contents and usability of stations of bursts: table, JSON, CSV and figure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.bursts.stations import Station
from torchliner.report.figure import (
    COLOURS,
    Figure,
    finish,
    label_axes,
    place_legend,
    styled,
    subplots,
)
from torchliner.report.numbers import Curves
from torchliner.report.table import Column, Table

HISTOGRAM_REACH, HISTOGRAM_BINS = 8.0, 32  # of the intervals, in mean intervals
FEWEST_IN_BIN = 5  # intervals the law expects in a bin that is drawn: fewer only scatter
WEIGHTINGS = (
    ("", COLOURS[0], "o", "arithmetic"),
    ("weighted_", COLOURS[1], "s", "by transit time"),
)
SHORT = {"wall_normal": "v", "streamwise": "u"}
STATISTICS = ("duration", "rate", "longest_gap", "irregularity")
HEAD = (
    Column("station", "name", "station"),
    *(Column(f"{key} (m)", f"kept.{key}", f"{key} mm", ".3f", 1e3) for key in "xyz"),
    Column("received", "kept.received"),
    Column("bursts", "kept.bursts", "bursts", "d"),
    Column("", lambda one: one.kept.received - one.kept.bursts, "dropped", "d"),
    Column("", "moments.duration", "T s", ".3f"),
    Column("rate (1/s)", "moments.rate", "rate /s", ".1f"),
    Column("longest gap (s)", "moments.longest_gap", "gap ms", ".2f", 1e3),
)
FLAGS = (
    Column("flags", lambda one: len(one.flags)),
    Column("", lambda one: len(one.flags) or "", "flags"),
)


def station_table(stations: Sequence[Station]) -> Table:
    """One row per station; CSV has the same columns for all, the text those that were measured."""
    parts = []
    for name, short in SHORT.items():
        shown = any(station.component(name) for station in stations)
        headings = (f"{short} mean", f"{short} rms", "weighted mean", "weighted rms")
        keys = ("mean", "rms", "weighted_mean", "weighted_rms")
        parts += [
            Column(f"{short} {key} (m/s)", _moment(name, key), heading if shown else "", ".3f")
            for key, heading in zip(keys, headings, strict=True)
        ]
        parts.append(Column(f"{short} zero share", _zeros(name), f"{short}=0 %" if shown else "",
                            ".1f", 100))  # fmt: skip
    return Table(stations, (*HEAD, *parts, *FLAGS))


def _moment(name: str, key: str) -> Callable[[Station], float | None]:
    return lambda one: getattr(one.component(name), key, None)


def _zeros(name: str) -> Callable[[Station], float | None]:
    return lambda one: one.zero_shares.get(name)


def plain_station(station: Station) -> dict[str, Any]:
    """Facts by name, SI units; for JSON."""
    kept, moments = station.kept, station.moments
    return {
        "name": station.name,
        **{key: getattr(kept, key) for key in (*"xyz", "received", "bursts")},
        "dropped": dict(kept.dropped),
        "zero_shares": station.zero_shares,
        **{key: getattr(moments, key) for key in STATISTICS},
        "transit_time_weighted": moments.weighted,
        "components": {
            name: {**vars(found), "velocity_bias": found.velocity_bias} for name, found in moments.components.items()
        },
        "flags": station.flags,
        "notes": list(kept.notes),
    }


def format_stations(stations: Sequence[Station]) -> str:
    """One row per station, then what was dropped and why, notes and flags."""
    lines = [station_table(stations).as_text()]
    if any(not station.moments.weighted for station in stations):
        lines.append("No transit times at some stations: there weighted is not weighted")
    for station in stations:
        dropped = station.kept.dropped.items()
        messages = [f"{count} dropped: {reason}" for reason, count in dropped]
        messages += station.kept.notes
        messages += [f"FLAGGED: {flag}" for flag in station.flags]
        lines += [f"{station.name}: {message}" for message in messages]
    count = sum(1 for station in stations if station.flags)
    lines.append(f"{count} of {len(stations)} stations are flagged" if count else "no flags")
    return "\n".join(lines)


def place_of(stations: Sequence[Station]) -> tuple[np.ndarray, str]:
    """Where the stations lie, for a figure: x (mm), else y or z, else their number."""
    for key in "xyz":
        values = [getattr(station.kept, key) for station in stations]
        if all(value is not None for value in values) and len(set(values)) == len(values) > 1:
            return 1e3 * np.array(values, dtype=np.float64), f"${key}$ (mm)"
    return np.arange(1, len(stations) + 1, dtype=np.float64), "station"


@styled
def draw_stations(stations: Sequence[Station], path: str | Path | None = None) -> Figure:
    """Mean and rms both ways, rate, and intervals beside the exponential law."""
    place, label = place_of(stations)
    flagged = np.array([bool(station.flags) for station in stations])
    name = next(n for n in SHORT if any(station.component(n) for station in stations))
    short = SHORT[name]
    figure, axes = subplots(2, 2, 4.6)
    panels = (("mean", rf"mean ${short}$ (m s$^{{-1}}$)"),
              ("rms", rf"${short}'_{{\mathrm{{rms}}}}$ (m s$^{{-1}}$)"))  # fmt: skip
    for axis, (part, text) in zip(axes[0], panels, strict=True):
        for prefix, colour, marker, weighting in WEIGHTINGS:
            values = np.array([*map(_moment(name, prefix + part), stations)], dtype=np.float64)
            axis.plot(place, values, color=colour, marker=marker, label=weighting,
                      markerfacecolor=colour if not prefix else "white")  # fmt: skip
            axis.plot(place[flagged], values[flagged], "x", color="k", markersize=7, zorder=5,
                      label="flagged" if prefix and flagged.any() else None)  # fmt: skip
        label_axes(axis, label, text)
    axis = axes[1, 0]
    rate = np.array([station.moments.rate for station in stations])
    axis.plot(place, rate, color=COLOURS[0], marker="o")
    axis.plot(place[flagged], rate[flagged], "x", color="k", markersize=7, zorder=5)
    label_axes(axis, label, r"rate (s$^{-1}$)")
    axis.set_ylim(bottom=0)
    _draw_intervals(axes[1, 1], stations)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    more = axes[1, 1].get_legend_handles_labels()
    place_legend(figure, handles + more[0], labels + more[1], 3)
    return finish(figure, path)


def intervals_of(stations: Sequence[Station]) -> Curves:
    """Density of the intervals of each station in units of its own mean interval, and the law's."""
    values: dict[str, np.ndarray] = {}
    edges = np.linspace(0, HISTOGRAM_REACH, HISTOGRAM_BINS + 1)
    survival = np.exp(-edges)
    values["exponential"] = (survival[:-1] - survival[1:]) / np.diff(edges)
    for i, station in enumerate(stations, 1):
        density = np.full(HISTOGRAM_BINS, np.nan)
        steps = station.kept.arrival_time.diff().numpy() * station.moments.rate
        if station.moments.rate > 0 and (steps >= 0).all():
            density = np.histogram(steps[steps < HISTOGRAM_REACH], edges)[0] / (len(steps) * np.diff(edges))
        values[f"{i} {station.name}"] = density
    return Curves((edges[1:] + edges[:-1]) / 2, values, "", "interval times rate")


def _draw_intervals(axis: Any, stations: Sequence[Station]) -> None:
    """Each station scaled by its own rate, in bins where the law expects some, and the law."""
    curves = intervals_of(stations)
    law, *columns = curves.values.values()
    width = HISTOGRAM_REACH / HISTOGRAM_BINS
    for station, density in zip(stations, columns, strict=True):
        drawn = (station.kept.bursts * law * width >= FEWEST_IN_BIN) & (density > 0)
        axis.plot(curves.at, np.where(drawn, density, np.nan), color="0.65", linewidth=0.7,
                  linestyle=":" if station.flags else "-")  # fmt: skip
    for style, label in (("-", "intervals, a line a station"), (":", "those of flagged stations")):
        axis.plot([], [], color="0.65", linewidth=0.7, linestyle=style, label=label)
    span = np.linspace(0, HISTOGRAM_REACH, 50)
    axis.plot(span, np.exp(-span), color="k", linestyle="--", label="exponential law")
    axis.set_yscale("log")
    label_axes(axis, "interval times rate", "density times mean interval")
