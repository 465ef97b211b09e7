"""Impedance lines as netCDF-4 and as CSV; docs/ldv_line.md lists the variables."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

from torchliner.io.hdf5 import (
    get_dataset,
    open_file,
    read_json,
    read_scalars,
    require_schema,
    to_json,
    write_dimension,
    write_references,
    write_scalars,
    write_variable,
    written_whole,
)
from torchliner.io.result_file import (
    CARTESIAN,
    IMPEDANCE,
    Variables,
    plain,
    read_heading,
    read_interval,
    write_heading,
    write_interval,
    write_pair,
)
from torchliner.records import ImpedanceLine, LineAverage

SCHEMA = "torchliner line 1"
SCALARS = {"mach": ("number", "1"), "incident_level": ("level", "dB")}
OF_STATION = {
    "x": "m", "y": "m", "z": "m", "mean_velocity": "m/s", "velocity_rms": "m/s", "rate": "1/s",
    "grid_rate": "Hz", "longest_gap": "s", "received": "1", "bursts": "1", "used": "1",
}  # fmt: skip
OF_LINE = {"coherence": "1", "corrected": "1", "phase_held": "1"}  # of station and frequency
COMPLEX = {"velocity_amplitude": "m/s", "attenuation": "1"}
LISTS = ("flags", "dropped", "station_notes")
SPREADS = {
    "monte_carlo_spread": "standard deviation over the draws of (5.2), no uncertainty of the mean",
    "spatial_spread": "standard deviation over the stations: how Z differs along the line",
}


def write_line(line: ImpedanceLine, path: str | Path) -> None:
    """Write a line: netCDF-4, or CSV (one row a station and frequency) for .csv.

    The old file, if any, is replaced only when the new one is whole.
    """
    if Path(path).suffix.lower() == ".csv":
        write_line_csv(line, path)
        return
    with written_whole(path) as temporary, h5py.File(temporary, "w") as file:
        write_heading(file, line, SCHEMA)
        for key in LISTS:
            file.attrs[key] = to_json(getattr(line, key))
        write_dimension(file, "frequency", plain(line.frequency), "Hz")
        write_dimension(file, "station", np.arange(line.stations), "1")
        write_dimension(file, "segment", np.arange(line.segment_start.shape[1]), "1")
        file.create_dataset("station_name", data=list(line.names), dtype=h5py.string_dtype())
        file["station_name"].dims[0].attach_scale(file["station"])
        _write_fields(file, line)
        write_scalars(file, line, SCALARS)
        write_references(file, line.reference)
        if line.average is not None:
            _write_average(file, line.average)


def _write_fields(file: h5py.File, line: ImpedanceLine) -> None:
    full, each = ("station", "segment", "frequency"), ("station", "frequency")
    write_variable(file, "segment_start", plain(line.segment_start), "s", full[:2])
    write_pair(file, "segment_reflection", line.reflection, full, CARTESIAN)
    write_pair(file, "segment_", line.segment_impedance, full, IMPEDANCE)
    write_pair(file, "", line.impedance, each, IMPEDANCE, "mean over the segments, eq. (5.1)")
    spread = "standard deviation over the segments"
    write_pair(file, "segment_spread_", line.segment_spread, each, IMPEDANCE, spread)
    write_pair(file, "admittance", line.admittance, each, CARTESIAN, "mean over the segments")
    for key, unit in OF_STATION.items():
        write_variable(file, key, plain(getattr(line, key)), unit, ("station",))
    for key, unit in OF_LINE.items():
        write_variable(file, key, plain(getattr(line, key)), unit, each)
    for key, unit in COMPLEX.items():
        write_pair(file, key, getattr(line, key), each, CARTESIAN, unit=unit)
    level = plain(line.inferred_incident_level)
    write_variable(file, "inferred_incident_level", level, "dB", each)
    if line.wall is not None:
        write_variable(file, "wall", plain(line.wall), "1", each)
    if line.goodrich is not None:
        write_pair(file, "goodrich_", line.goodrich, ("frequency",), IMPEDANCE)
    if line.interval is not None:
        write_interval(file, line.interval, "", each, _words(line))


def _words(line: ImpedanceLine) -> str:
    return f"{100 * float(line.choices['interval']):g} % statistical, moving blocks over segments"


def _write_average(file: h5py.File, found: LineAverage) -> None:
    where = ("frequency",)
    write_pair(
        file, "line_", found.impedance, where, IMPEDANCE, "1 over the mean of 1/Z, eq. (5.2)"
    )
    write_pair(
        file, "line_monte_carlo_", found.monte_carlo, where, IMPEDANCE, "mean of the draws of (5.2)"
    )
    for key, words in SPREADS.items():
        write_pair(file, f"line_{key}_", getattr(found, key), where, IMPEDANCE, words)
    file.attrs["stations_that_count"] = found.stations
    if found.interval is not None:
        words = "statistical, segments resampled, stations independent"
        write_interval(file, found.interval, "line_", where, words)


def read_line(path: str | Path) -> ImpedanceLine:
    """Read a line written by ``ImpedanceLine.write`` as netCDF-4.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: not a line of this schema.
    """
    path = Path(path)
    with open_file(path) as file:
        require_schema(file, SCHEMA, "impedance line", path)
        variables = Variables(file, path)
        real, both = variables.real, variables.both
        known: dict[str, Any] = {key: real(key) for key in OF_STATION}
        known |= {key: real(key) for key in OF_LINE}
        known |= {key: both(key, CARTESIAN) for key in COMPLEX}
        for key in ("used", "corrected"):
            known[key] = known[key].to(torch.bool)
        for key in LISTS:
            values = read_json(file, key, path, [])
            known[key] = tuple(v if isinstance(v, dict) else tuple(v) for v in values)
        average = None
        if "line_resistance" in file:
            average = LineAverage(
                impedance=both("line_"), monte_carlo=both("line_monte_carlo_"),
                interval=read_interval(file, "line_", path),
                stations=int(file.attrs["stations_that_count"]),
                **{key: both(f"line_{key}_") for key in SPREADS},
            )  # fmt: skip
        return ImpedanceLine(
            frequency=real("frequency"),
            reflection=both("segment_reflection", CARTESIAN),
            segment_start=real("segment_start"),
            wall=real("wall").to(torch.bool) if "wall" in file else None,
            interval=read_interval(file, "", path),
            names=tuple(get_dataset(file, "station_name", path).asstr()[()]),
            average=average,
            goodrich=both("goodrich_") if "goodrich_resistance" in file else None,
            **read_heading(file, path),
            **read_scalars(file, SCALARS, path),
            **known,
        )


def write_line_csv(line: ImpedanceLine, path: str | Path) -> None:
    """Write a line as CSV; the old file is replaced when the new one is whole."""
    with written_whole(path) as temporary, temporary.open("w", newline="") as file:
        rows = line_rows(line)
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def line_rows(line: ImpedanceLine) -> list[dict[str, Any]]:
    """One row a station and frequency: Z of (5.1), its interval, the spread over the segments."""
    rows = []
    middle, spread, admittance = line.impedance, line.segment_spread, line.admittance
    level = line.inferred_incident_level
    for n, name in enumerate(line.names):
        for f, frequency in enumerate(line.frequency.tolist()):
            row: dict[str, Any] = {"station": name}
            row |= {f"{key} (m)": float(getattr(line, key)[n]) for key in "xyz"}
            row |= {"frequency (Hz)": frequency}
            for part, word in (("real", "resistance"), ("imag", "reactance")):
                row[word] = float(getattr(middle[n, f], part))
                if line.interval is not None:
                    for end in ("low", "high"):
                        row[f"{word} {end}"] = float(
                            getattr(getattr(line.interval, end)[n, f], part)
                        )
                row[f"{word} spread over segments"] = float(getattr(spread[n, f], part))
                row[f"admittance {part}"] = float(getattr(admittance[n, f], part))
            row |= {
                "mean velocity (m/s)": float(line.mean_velocity[n]),
                "velocity rms (m/s)": float(line.velocity_rms[n]),
                "coherent velocity peak (m/s)": float(line.velocity_level[n, f]),
                "coherence": float(line.coherence[n, f]),
                "inferred incident level (dB)": float(level[n, f]),
                "attenuation": float(line.attenuation[n, f].abs()),
                "segments": int(line.segments[n]),
                "bursts": int(line.bursts[n]),
                "rate (1/s)": float(line.rate[n]),
                "counts": int(line.used[n]),
                "wall": "" if line.wall is None else int(line.wall[n, f]),
                "flags": len(line.flags[n]),
            }
            rows.append(row)
    return rows
