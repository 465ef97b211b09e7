"""Impedance lines as a text table and as plain values."""

from __future__ import annotations

from typing import Any

from torchliner.io.line_file import line_rows
from torchliner.records import ImpedanceLine
from torchliner.report.table import format_complex


def format_line(line: ImpedanceLine) -> str:
    """A row a station and frequency, the averages, the choices."""
    parts = [_stations(line), _averages(line), _beside(line), _choices(line)]
    return "\n".join(part for part in parts if part)


def _stations(line: ImpedanceLine) -> str:
    width = max(7, *(len(name) for name in line.names))
    with_interval = line.interval is not None
    bounds = f"{f' {_level(line)} of R, of X':>32s}" if with_interval else ""
    head = (f"{'station':{width}s} {'x mm':>8s} {'y mm':>6s} {'f Hz':>7s} {'Z (5.1)':>14s}"
            f"{bounds} {'segments R, X':>14s} {'v0':>7s} {'v rms':>6s} {'v tone':>6s} "
            f"{'coher.':>6s} {'|G|':>5s} {'rate kHz':>8s} flags")  # fmt: skip
    lines = [head]
    middle, spread = line.impedance, line.segment_spread
    for n, name in enumerate(line.names):
        for f, frequency in enumerate(line.frequency.tolist()):
            bars = ""
            if line.interval is not None:
                low, high = complex(line.interval.low[n, f]), complex(line.interval.high[n, f])
                bars = f" {low.real:7.3f} {high.real:7.3f}, {low.imag:7.3f} {high.imag:7.3f}"
            wide = complex(spread[n, f])
            lines.append(
                f"{name:{width}s} {_millimetres(line.x[n]):>8s} {_millimetres(line.y[n]):>6s} "
                f"{frequency:7.1f} {format_complex(complex(middle[n, f])):>14s}{bars} "
                f"{wide.real:7.3f} {wide.imag:6.3f} {float(line.mean_velocity[n]):7.3f} "
                f"{float(line.velocity_rms[n]):6.3f} {float(line.velocity_level[n, f]):6.3f} "
                f"{float(line.coherence[n, f]):6.3f} {float(line.attenuation[n, f].abs()):5.3f} "
                f"{1e-3 * float(line.rate[n]):8.2f} {len(line.flags[n]) or ''}".rstrip()
            )
    return "\n".join(lines)


def _millimetres(value: Any) -> str:
    number = 1e3 * float(value)
    return "-" if number != number else f"{number:.2f}"


def _level(line: ImpedanceLine) -> str:
    return f"{100 * float(line.choices['interval']):g} %"


def _averages(line: ImpedanceLine) -> str:
    found = line.average
    if found is None:
        return ""
    lines = [f"\n{found.stations} of {line.stations} stations count; Z = 1/mean(1/Z), eq. (5.2)"]
    for f, frequency in enumerate(line.frequency.tolist()):
        text = f"{frequency:7.1f} Hz: {format_complex(complex(found.impedance[f]))}"
        if found.interval is not None:
            low, high = complex(found.interval.low[f]), complex(found.interval.high[f])
            text += (f"; {_level(line)} interval R {low.real:.4f} to {high.real:.4f}, "
                     f"X {low.imag:.4f} to {high.imag:.4f}")  # fmt: skip
        along, drawn = complex(found.spatial_spread[f]), complex(found.monte_carlo_spread[f])
        text += (f"; spread along the line R {along.real:.3f}, X {along.imag:.3f}; Monte Carlo "
                 f"{format_complex(complex(found.monte_carlo[f]))}, its spread R {drawn.real:.4f}, "
                 f"X {drawn.imag:.4f}")  # fmt: skip
        lines.append(text)
    return "\n".join(lines)


def _beside(line: ImpedanceLine) -> str:
    said = [f"{name}: {format_complex(value)}" for name, value in line.reference.items()]
    if line.goodrich is not None:
        said += [
            f"{f:g} Hz, Goodrich (2.7), linear liner: {format_complex(complex(z))}"
            for f, z in zip(line.frequency.tolist(), line.goodrich.tolist(), strict=True)
        ]
    return "\n".join(said)


def _choices(line: ImpedanceLine) -> str:
    names = ("method", "correction", "segment", "overlap", "phase", "drive", "kernel")
    said = ", ".join(f"{key} {line.choices[key]}" for key in names)
    flags = [f"{name}: FLAGGED: {flag}" for name, all_of in zip(line.names, line.flags, strict=True)
             for flag in all_of]  # fmt: skip
    return "\n".join([*flags, f"Z is p/(rho c v), exp(+jwt); {said}"])


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
                        "low": complex(found.interval.low[f]),
                        "high": complex(found.interval.high[f]),
                        "standard_error": complex(found.interval.standard_error[f]),
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
        "rows": line_rows(line),
        "stations": stations,
        "reference": dict(line.reference),
        "choices": dict(line.choices),
        "notes": list(line.notes),
    }
