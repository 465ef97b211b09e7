"""Impedance lines as a text table and for JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from torch import Tensor

from torchliner.io.line_file import line_rows
from torchliner.records import ImpedanceLine
from torchliner.report.level_check_report import level_check_lines, plain_level_check
from torchliner.report.table import (
    Column,
    Table,
    format_bounds,
    format_complex,
    format_pair,
    format_references,
)

At = tuple[int, int]  # station, frequency


def format_line(line: ImpedanceLine) -> str:
    """One row per station and frequency, the averages, references, flags, the choices."""
    goodrich = [] if line.goodrich is None else line.goodrich.tolist()
    names = ("method", "correction", "segment", "overlap", "window", "phase", "drive")
    choices = ", ".join(f"{key} {line.choices[key]}" for key in names)
    return "\n".join([
        _station_table(line).as_text(),
        *_averages(line),
        *level_check_lines([line], [Column("", "frequency", "f Hz", ".1f")]),
        *format_references(line.reference),
        *(f"{f:g} Hz, Goodrich (2.7), linear liner: {format_complex(z)}"
          for f, z in zip(line.frequency.tolist(), goodrich, strict=False)),
        *(f"{name}: FLAGGED: {flag}" for name, flags in zip(line.names, line.flags, strict=True)
          for flag in flags),
        f"Z is p/(rho c v), exp(+jwt); {choices}",
    ])  # fmt: skip


def _station_table(line: ImpedanceLine) -> Table:
    def station(values: Tensor) -> Callable[[At], float]:
        return lambda at: float(values[at[0]])

    def number(values: Tensor) -> Callable[[At], float]:
        return lambda at: float(values[at])

    columns = [
        Column("", lambda at: line.names[at[0]], "station"),
        Column("", station(line.x), "x mm", ".2f", 1e3),
        Column("", station(line.y), "y mm", ".2f", 1e3),
        Column("", lambda at: float(line.frequency[at[1]]), "f Hz", ".1f"),
        Column("", lambda at: complex(line.impedance[at]), "Z (5.1)", format_complex),
    ]
    if line.interval is not None:
        bounds, heading = line.interval.bounds, f"{_level(line)} interval"
        columns.append(Column("", lambda at: bounds(*at), heading, format_bounds))
    columns += [
        Column("", lambda at: complex(line.segment_spread[at]), "segments R, X", format_pair),
        Column("", station(line.mean_velocity), "v0", ".3f"),
        Column("", station(line.velocity_rms), "v rms", ".3f"),
        Column("", number(line.velocity_level), "v tone", ".3f"),
        Column("", number(line.coherence), "coherence", ".3f"),
        Column("", number(line.attenuation.abs()), "|G|", ".3f"),
        Column("", station(line.rate), "rate kHz", ".2f", 1e-3),
        Column("", lambda at: len(line.flags[at[0]]) or "", "flags"),
    ]
    everywhere = [(n, f) for n in range(line.stations) for f in range(len(line.frequency))]
    return Table(everywhere, columns)


def _level(line: ImpedanceLine) -> str:
    return f"{100 * float(line.choices['interval']):g} % statistical"


def _averages(line: ImpedanceLine) -> list[str]:
    found = line.average
    if found is None:
        return []
    lines = [f"\n{found.stations} of {line.stations} stations count; Z = 1/mean(1/Z), eq. (5.2)"]
    for f, frequency in enumerate(line.frequency.tolist()):
        text = f"{frequency:7.1f} Hz: {format_complex(complex(found.impedance[f]))}"
        if found.interval is not None:
            text += f"; {_level(line)} interval {format_bounds(found.interval.bounds(f), 4)}"
        along, drawn = complex(found.spatial_spread[f]), complex(found.monte_carlo_spread[f])
        lines.append(
            f"{text}; spread along the line of R, X {format_pair(along)}; Monte Carlo "
            f"{format_complex(complex(found.monte_carlo[f]))}, its spread {format_pair(drawn, 4)}"
        )
    return lines


def plain_line(line: ImpedanceLine) -> dict[str, Any]:
    """For JSON: what is interval, spread over segments, spread along the line has its own name."""
    found, average = line.average, None
    if found is not None:
        average = {
            "stations": found.stations,
            "rows": [
                {
                    "frequency": frequency,
                    "impedance": complex(found.impedance[f]),
                    "interval": None if found.interval is None else {
                        name: complex(getattr(found.interval, name)[f])
                        for name in ("low", "high", "standard_error")
                    },
                    "spread_along_the_line": complex(found.spatial_spread[f]),
                    "monte_carlo": complex(found.monte_carlo[f]),
                    "monte_carlo_spread": complex(found.monte_carlo_spread[f]),
                    "goodrich": None if line.goodrich is None else complex(line.goodrich[f]),
                }
                for f, frequency in enumerate(line.frequency.tolist())
            ],
        }  # fmt: skip
    stations = [
        {"flags": list(flags), "dropped": dict(dropped), "notes": list(notes)}
        for flags, dropped, notes in zip(line.flags, line.dropped, line.station_notes, strict=True)
    ]
    return {
        "title": line.title,
        "average": average,
        "level_check": plain_level_check(line),
        "rows": line_rows(line),
        "stations": stations,
        "reference": dict(line.reference),
        "choices": dict(line.choices),
        "notes": list(line.notes),
    }
