"""Impedance lines as a text table and for JSON, from the rows of their CSV."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from torchliner.io.line_file import line_rows
from torchliner.records import ImpedanceLine
from torchliner.report.level_check_report import level_check_lines, plain_level_check
from torchliner.report.table import Column, Table, format_bounds, format_complex, format_pair, format_references

CHOICES = ("method", "correction", "segment", "overlap", "window", "phase", "drive")


def _both(end: str = "") -> Callable[[dict[str, Any]], complex]:
    """R and X of a row as one number."""
    return lambda row: complex(row[f"resistance{end}"], row[f"reactance{end}"])


COLUMNS = (
    Column("", "station", "station"),
    Column("", "x (m)", "x mm", ".2f", 1e3),
    Column("", "y (m)", "y mm", ".2f", 1e3),
    Column("", "frequency (Hz)", "f Hz", ".1f"),
    Column("", _both(), "Z (5.1)", format_complex),
    Column("", _both(" spread over segments"), "segments R, X", format_pair),
    Column("", "mean velocity (m/s)", "v0", ".3f"),
    Column("", "velocity rms (m/s)", "v rms", ".3f"),
    Column("", "coherent velocity peak (m/s)", "v tone", ".3f"),
    Column("", "coherence", "coherence", ".3f"),
    Column("", "attenuation", "|G|", ".3f"),
    Column("", "rate (1/s)", "rate kHz", ".2f", 1e-3),
    Column("", lambda row: row["flags"] or "", "flags"),
)


def format_line(line: ImpedanceLine) -> str:
    """One row per station and frequency, the averages, references, flags, the choices."""
    columns = list(COLUMNS)
    if line.interval is not None:
        ends = [_both(" low"), _both(" high")]
        heading = f"{100 * float(line.choices['interval']):g} % statistical interval"
        columns.insert(5, Column("", lambda row: tuple(end(row) for end in ends), heading, format_bounds))
    text = [Table(line_rows(line), columns).as_text()]
    if line.average is not None:
        text.append(f"\n{line.average.stations} of {line.stations} stations count; Z = 1/mean(1/Z), eq. (5.2)")
        text += [_average_text(row) for row in _averages(line)]
    text += level_check_lines([line], [Column("", "frequency", "f Hz", ".1f")])
    text += format_references(line.reference)
    if line.goodrich is not None:
        text += [
            f"{f:g} Hz, Goodrich (2.7), linear liner: {format_complex(z)}"
            for f, z in zip(line.frequency.tolist(), line.goodrich.tolist(), strict=True)
        ]
    text += [f"{name}: FLAGGED: {flag}" for name, flags in zip(line.names, line.flags, strict=True) for flag in flags]
    choices = ", ".join(f"{key} {line.choices[key]}" for key in CHOICES)
    return "\n".join([*text, f"Z is p/(rho c v), exp(+jwt); {choices}"])


def _averages(line: ImpedanceLine) -> list[dict[str, Any]]:
    """A row each frequency: what is interval, spread along the line, spread of the draws has its own name."""
    found = line.average
    if found is None:
        return []
    rows: list[dict[str, Any]] = []
    for f, frequency in enumerate(line.frequency.tolist()):
        interval = None
        if found.interval is not None:
            interval = {end: complex(getattr(found.interval, end)[f]) for end in ("low", "high", "standard_error")}
        row = {
            "frequency": frequency,
            "impedance": complex(found.impedance[f]),
            "interval": interval,
            "spread_along_the_line": complex(found.spatial_spread[f]),
            "monte_carlo": complex(found.monte_carlo[f]),
            "monte_carlo_spread": complex(found.monte_carlo_spread[f]),
            "goodrich": None if line.goodrich is None else complex(line.goodrich[f]),
        }
        rows.append(row)
    return rows


def _average_text(row: dict[str, Any]) -> str:
    ends = row["interval"]
    interval = "" if ends is None else f"; interval {format_bounds((ends['low'], ends['high']), 4)}"
    return (
        f"{row['frequency']:7.1f} Hz: {format_complex(row['impedance'])}{interval}; spread along the line of R, X "
        f"{format_pair(row['spread_along_the_line'])}; Monte Carlo {format_complex(row['monte_carlo'])}, its spread "
        f"{format_pair(row['monte_carlo_spread'], 4)}"
    )


def plain_line(line: ImpedanceLine) -> dict[str, Any]:
    """For JSON."""
    stations = [
        {"flags": list(flags), "dropped": dict(dropped), "notes": list(notes)}
        for flags, dropped, notes in zip(line.flags, line.dropped, line.station_notes, strict=True)
    ]
    return {
        "title": line.title,
        "average": None if line.average is None else {"stations": line.average.stations, "rows": _averages(line)},
        "level_check": plain_level_check(line),
        "rows": line_rows(line),
        "stations": stations,
        "reference": dict(line.reference),
        "choices": dict(line.choices),
        "notes": [vars(note) for note in line.notes],
    }
