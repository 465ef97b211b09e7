"""What stations of bursts hold and whether they can be used: table, JSON, CSV and figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import BurstRecord
from torchliner.report.figure import COLOURS, Figure, finish, styled, subplots
from torchliner.report.table import Table
from torchliner.signals.burst_flags import station_flags, zero_shares
from torchliner.signals.burst_moments import (
    HISTOGRAM_BINS,
    HISTOGRAM_REACH,
    BurstMoments,
    burst_moments,
    interval_histogram,
)
from torchliner.signals.burst_validation import BurstFilters, validate_bursts

FEWEST_IN_BIN = 5  # intervals the law expects in a bin that is drawn: fewer only scatter
WEIGHTINGS = (
    ("", COLOURS[0], "o", "arithmetic"),
    ("weighted_", COLOURS[1], "s", "by transit time"),
)
SHORT = {"wall_normal": "v", "streamwise": "u"}


@dataclass(frozen=True)
class Station:
    """One station as read, as kept, its moments, and its doubts in words."""

    raw: BurstRecord
    kept: BurstRecord
    moments: BurstMoments
    flags: list[str]

    def plain(self) -> dict[str, Any]:
        """Facts by name, SI units; for JSON."""
        parts = {}
        for name, found in self.moments.components.items():
            parts[name] = {**vars(found), "velocity_bias": found.velocity_bias}
        return {
            "name": self.kept.title or self.kept.name,
            **{key: getattr(self.kept, key) for key in "xyz"},
            "received": self.kept.received,
            "bursts": self.kept.bursts,
            "dropped": dict(self.kept.dropped),
            "zero_shares": zero_shares(self.raw),
            "duration": self.moments.duration,
            "rate": self.moments.rate,
            "longest_gap": self.moments.longest_gap,
            "irregularity": self.moments.irregularity,
            "transit_time_weighted": self.moments.weighted,
            "components": parts,
            "flags": self.flags,
            "notes": list(self.kept.notes),
        }

    def row(self) -> dict[str, Any]:
        """One row of numbers for CSV; the same columns for every station."""
        row: dict[str, Any] = {"station": self.kept.title or self.kept.name}
        row |= {f"{key} (m)": getattr(self.kept, key) for key in "xyz"}
        row |= {"received": self.kept.received, "bursts": self.kept.bursts,
                "rate (1/s)": self.moments.rate,
                "longest gap (s)": self.moments.longest_gap}  # fmt: skip
        for name, short in SHORT.items():
            found = self.moments.components.get(name)
            for key in ("mean", "rms", "weighted_mean", "weighted_rms"):
                row[f"{short} {key} (m/s)"] = None if found is None else getattr(found, key)
            row[f"{short} zero share"] = zero_shares(self.raw).get(name)
        return row | {"flags": len(self.flags)}


def inspect_stations(
    records: Sequence[BurstRecord], filters: BurstFilters | None = None
) -> list[Station]:
    """Validate each station, take its moments and judge it.

    Args:
        records: stations as read.
        filters: what is dropped before moments are taken.
    """
    stations = []
    for raw in records:
        kept = validate_bursts(raw, filters)
        found = burst_moments(kept)
        stations.append(Station(raw, kept, found, station_flags(raw, kept, found)))
    return stations


def format_stations(stations: Sequence[Station]) -> str:
    """A text table: one line a station, then what was dropped and why, then the doubts."""
    names = [n for n in SHORT if any(n in s.moments.components for s in stations)]
    width = max(7, *(len(station.kept.title or "") for station in stations))
    head = (f"{'station':{width}s} {'x mm':>8s} {'y mm':>8s} {'z mm':>8s} {'bursts':>7s} "
            f"{'dropped':>7s} {'T s':>7s} {'rate /s':>8s} {'gap ms':>7s}")  # fmt: skip
    for name in names:
        short = SHORT[name]
        head += (f" {short + ' mean':>8s} {'weighted':>8s} {short + ' rms':>8s} {'weighted':>8s} "
                 f"{short + '=0 %':>6s}")  # fmt: skip
    lines = [f"{head} flags"]
    for station in stations:
        lines.append(_line(station, names, width))
    if any(not station.moments.weighted for station in stations):
        lines.append("No transit times at some stations: there weighted is not weighted")
    for station in stations:
        said = station.kept.title or station.kept.name
        for reason, count in station.kept.dropped.items():
            lines.append(f"{said}: {count} dropped: {reason}")
        lines += [f"{said}: {note}" for note in station.kept.notes]
        lines += [f"{said}: FLAGGED: {flag}" for flag in station.flags]
    count = sum(1 for station in stations if station.flags)
    lines.append(f"{count} of {len(stations)} stations are flagged" if count else "no flags")
    return "\n".join(lines)


def _line(station: Station, names: Sequence[str], width: int) -> str:
    kept, found = station.kept, station.moments
    places = [f"{'-' if v is None else format(1e3 * v, '.3f'):>8s}"
              for v in (kept.x, kept.y, kept.z)]  # fmt: skip
    line = (f"{kept.title or '-':{width}s} {' '.join(places)} {kept.bursts:7d} "
            f"{kept.received - kept.bursts:7d} {found.duration:7.3f} {found.rate:8.1f} "
            f"{1e3 * found.longest_gap:7.2f}")  # fmt: skip
    zeros = zero_shares(station.raw)
    for name in names:
        part = found.components.get(name)
        if part is None:
            line += " " + " ".join(["       -"] * 4) + "      -"
            continue
        line += (f" {part.mean:8.3f} {part.weighted_mean:8.3f} {part.rms:8.3f} "
                 f"{part.weighted_rms:8.3f} {100 * zeros[name]:6.1f}")  # fmt: skip
    return f"{line} {len(station.flags) or ''}".rstrip()


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
    name = next(n for n in SHORT if any(n in s.moments.components for s in stations))
    short = SHORT[name]
    figure, axes = subplots(2, 2, 4.6)
    panels = (("mean", rf"mean ${short}$ (m s$^{{-1}}$)"),
              ("rms", rf"$\sigma_{short}$ (m s$^{{-1}}$)"))  # fmt: skip
    for axis, (part, text) in zip(axes[0], panels, strict=True):
        for prefix, colour, marker, said in WEIGHTINGS:
            values = np.array([
                getattr(s.moments.components[name], prefix + part)
                if name in s.moments.components else np.nan for s in stations
            ])  # fmt: skip
            axis.plot(place, values, color=colour, marker=marker, label=said,
                      markerfacecolor=colour if not prefix else "white")  # fmt: skip
            axis.plot(place[flagged], values[flagged], "x", color="k", markersize=7, zorder=5,
                      label="flagged" if prefix and flagged.any() else None)  # fmt: skip
        axis.set_xlabel(label)
        axis.set_ylabel(text)
    axis = axes[1, 0]
    rate = np.array([station.moments.rate for station in stations])
    axis.plot(place, rate, color=COLOURS[0], marker="o")
    axis.plot(place[flagged], rate[flagged], "x", color="k", markersize=7, zorder=5)
    axis.set_xlabel(label)
    axis.set_ylabel(r"rate (s$^{-1}$)")
    axis.set_ylim(bottom=0)
    _draw_intervals(axes[1, 1], stations)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    more = axes[1, 1].get_legend_handles_labels()
    figure.legend(handles + more[0], labels + more[1], loc="outside lower center", ncols=3)
    return finish(figure, path)


def intervals_of(stations: Sequence[Station]) -> Table:
    """Density of the intervals of each station in units of its own mean interval, and the law's."""
    values: dict[str, np.ndarray] = {}
    edges = np.linspace(0, HISTOGRAM_REACH, HISTOGRAM_BINS + 1)
    survival = np.exp(-edges)
    values["exponential"] = (survival[:-1] - survival[1:]) / np.diff(edges)
    for i, station in enumerate(stations, 1):
        density = np.full(HISTOGRAM_BINS, np.nan)
        if station.moments.rate > 0 and bool((station.kept.arrival_time.diff() >= 0).all()):
            density = interval_histogram(station.kept).density.numpy() / station.moments.rate
        values[f"{i} {station.kept.title or station.kept.name}"] = density
    return Table((edges[1:] + edges[:-1]) / 2, values, "", "interval times rate")


def _draw_intervals(axis: Any, stations: Sequence[Station]) -> None:
    """Each station scaled by its own rate, in bins where the law expects some, and the law."""
    table = intervals_of(stations)
    law, *columns = table.values.values()
    width = HISTOGRAM_REACH / HISTOGRAM_BINS
    for station, density in zip(stations, columns, strict=True):
        drawn = (station.kept.bursts * law * width >= FEWEST_IN_BIN) & (density > 0)
        axis.plot(table.at, np.where(drawn, density, np.nan), color="0.65", linewidth=0.7,
                  linestyle=":" if station.flags else "-")  # fmt: skip
    for style, label in (("-", "intervals, a line a station"), (":", "those of flagged stations")):
        axis.plot([], [], color="0.65", linewidth=0.7, linestyle=style, label=label)
    span = np.linspace(0, HISTOGRAM_REACH, 50)
    axis.plot(span, np.exp(-span), color="k", linestyle="--", label="exponential law")
    axis.set_yscale("log")
    axis.set_xlabel("interval times rate")
    axis.set_ylabel("density times mean interval")
