"""Impedance lines as netCDF-4 and as CSV; docs/ldv.md names the variables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from torchliner.io.csv_rows import Rows, rows_of
from torchliner.io.hdf5 import (
    is_there,
    open_file,
    read_attribute,
    read_references,
    read_texts,
    write_index,
    write_references,
    write_texts,
)
from torchliner.io.result_file import (
    interval_table,
    read_interval,
    read_level_check,
    result_kind,
    write_level_check,
)
from torchliner.io.result_writers import ResultFile
from torchliner.io.tables import (
    Sizes,
    cartesian,
    described,
    impedance,
    numbers,
    read_variables,
    real,
    write_variables,
)
from torchliner.records import ImpedanceLine, LineAverage

KIND = result_kind("torchliner line 1", "impedance line", flags=(), dropped=(), station_notes=())
STATIONS = ("flags", "dropped", "station_notes")  # attributes with one entry a station
FULL, EACH, STATION = ("station", "segment", "frequency"), ("station", "frequency"), ("station",)
LINE = ("frequency",)
MEAN = {"long_name": "mean over the segments"}
TEXTS = {
    "frequency": "frequency of the tone",
    "segment_start": "time at which a segment begins",
    "reflection": "{part} part of the reflection coefficient of each segment",
    "segment_impedance": "normalised {part} of each segment",
    "x": "streamwise coordinate", "y": "distance from the liner", "z": "spanwise coordinate",
    "mean_velocity": "time mean of the velocity away from the liner",
    "velocity_rms": "rms of the velocity about its mean",
    "rate": "bursts in a second", "grid_rate": "sampling rate of the uniform grid",
    "longest_gap": "longest time without a burst",
    "received": "bursts received", "bursts": "bursts kept",
    "used": "1 where a station counts in averages",
    "coherence": "squared coherence of the velocity with the tone",
    "corrected": "1 where the attenuation of the tone was made good",
    "phase_held": "share of the segments in which the phase rule was used",
    "velocity_amplitude": "{part} part of the peak amplitude of the velocity into the liner",
    "attenuation": "{part} part of the factor by which the grid attenuates the tone",
    "inferred_incident_level": "level of the incident wave that gives the coherent velocity, "
                               "re 20 uPa rms",
    "wall": "1 where a station counts as wall",
    "goodrich": "normalised {part} of the liner without sound under the flow, by Goodrich",
    "mach": "bulk Mach number",
    "incident_level": "stated level of the incident wave, re 20 uPa rms",
}  # fmt: skip
FREQUENCY = described((real("frequency", "Hz", LINE),), TEXTS)
FIELDS = described((
    *(real(axis, "m", STATION) for axis in "xyz"),
    real("segment_start", "s", ("station", "segment")),
    cartesian("reflection", "segment_reflection", FULL),
    impedance("segment_impedance", "segment_", FULL, derived=True),
    impedance("impedance", "", EACH, derived=True,
              attributes={"long_name": "mean over the segments, eq. (5.1)"}),
    impedance("segment_spread", "segment_spread_", EACH, derived=True,
              attributes={"long_name": "standard deviation over the segments"}),
    cartesian("admittance", "admittance", EACH, derived=True, attributes=MEAN),
    real("mean_velocity", "m/s", STATION),
    real("velocity_rms", "m/s", STATION),
    real("rate", "1/s", STATION),
    real("grid_rate", "Hz", STATION),
    real("longest_gap", "s", STATION),
    real("received", "1", STATION),
    real("bursts", "1", STATION),
    real("used", "1", STATION, flag=True),
    real("coherence", "1", EACH),
    real("corrected", "1", EACH, flag=True),
    real("phase_held", "1", EACH),
    cartesian("velocity_amplitude", "velocity_amplitude", EACH, unit="m/s"),
    cartesian("attenuation", "attenuation", EACH),
    real("inferred_incident_level", "dB", EACH, derived=True),
    real("wall", "1", EACH, flag=True, optional=True),
    impedance("goodrich", "goodrich_", LINE, optional=True),
), TEXTS)  # fmt: skip
INTERVAL = interval_table("", EACH)
NUMBERS = described(numbers({"mach": "1", "incident_level": "dB"}), TEXTS)
AVERAGE = tuple(
    impedance(field, stem, LINE, attributes={"long_name": words})
    for field, stem, words in (
        ("impedance", "line_", "1 over the mean of 1/Z, eq. (5.2)"),
        ("monte_carlo", "line_monte_carlo_", "mean of the draws of (5.2)"),
        ("monte_carlo_spread", "line_monte_carlo_spread_",
         "standard deviation over the draws of (5.2), no uncertainty of the mean"),
        ("spatial_spread", "line_spatial_spread_",
         "standard deviation over the stations: how Z differs along the line"),
    )
)  # fmt: skip
AVERAGE_INTERVAL = interval_table("line_", LINE)


def write_line(line: ImpedanceLine, path: str | Path) -> None:
    """Write a line by the ending of ``path``, as ``ImpedanceLine.write``."""
    FILE.write(line, path)


def _fill(file: h5py.File, line: ImpedanceLine) -> None:
    write_variables(file, line, FREQUENCY)
    write_index(file, "station", line.stations)
    write_index(file, "segment", line.segment_start.shape[1])
    write_texts(file, "station_name", line.names, "station")
    file["station_name"].attrs["long_name"] = "title of the station"
    write_variables(file, line, FIELDS)
    if line.interval is not None:
        level = 100 * float(line.choices["interval"])
        words = f"{level:g} % statistical, moving blocks over segments"
        write_variables(file, line.interval, INTERVAL, words=words)
    write_variables(file, line, NUMBERS)
    write_references(file, line.reference)
    if line.level_check is not None:
        write_level_check(file, line.level_check, "station")
    if line.average is not None:
        _write_average(file, line.average)


def _write_average(file: h5py.File, found: LineAverage) -> None:
    write_variables(file, found, AVERAGE)
    file.attrs["stations_that_count"] = found.stations
    if found.interval is not None:
        words = "statistical, segments resampled, stations independent"
        write_variables(file, found.interval, AVERAGE_INTERVAL, words=words)


def _read_average(file: h5py.File, path: Path, sizes: Sizes) -> LineAverage | None:
    if not is_there(file, AVERAGE[0].names[0], path):
        return None
    return LineAverage(
        **read_variables(file, AVERAGE, path, sizes=sizes),
        interval=read_interval(file, AVERAGE_INTERVAL, path, sizes),
        stations=int(read_attribute(file, "stations_that_count", path)),
    )


def read_line(path: str | Path) -> ImpedanceLine:
    """Read a line written by ``ImpedanceLine.write`` as netCDF-4.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: not a line of this schema.
    """
    path = Path(path)
    with open_file(path) as file:
        KIND.require(file, path)
        sizes: Sizes = {}
        table = (*FREQUENCY, *FIELDS, *NUMBERS)
        fields = {"wall": None, **read_variables(file, table, path, sizes=sizes)}
        names = tuple(read_texts(file, "station_name", path))
        head = KIND.read_head(file, path)
        for key, each in {"station_name": names, **{k: head[k] for k in STATIONS}}.items():
            if (len(each),) != sizes["station"]:
                raise ValueError(f"{path}: {key} has {len(each)} values for {sizes['station'][0]} stations")
        return ImpedanceLine(
            **fields,
            **head,
            interval=read_interval(file, INTERVAL, path, sizes),
            names=names,
            average=_read_average(file, path, sizes),
            reference=read_references(file, path),
            level_check=read_level_check(file, path, sizes, "station"),
        )


def line_rows(line: ImpedanceLine) -> Rows:
    """One row a station and frequency: Z of (5.1), its interval, the spread over the segments."""
    shape = (line.stations, len(line.frequency))
    columns: dict[str, Any] = {f"{axis} (m)": getattr(line, axis)[:, None] for axis in "xyz"}
    columns["frequency (Hz)"] = line.frequency
    for part, word in (("real", "resistance"), ("imag", "reactance")):
        columns[word] = getattr(line.impedance, part)
        if line.interval is not None:
            columns |= {f"{word} {end}": getattr(getattr(line.interval, end), part)
                        for end in ("low", "high")}  # fmt: skip
        columns[f"{word} spread over segments"] = getattr(line.segment_spread, part)
        columns[f"admittance {part}"] = getattr(line.admittance, part)
    columns |= {
        "mean velocity (m/s)": line.mean_velocity[:, None],
        "velocity rms (m/s)": line.velocity_rms[:, None],
        "coherent velocity peak (m/s)": line.velocity_level,
        "coherence": line.coherence,
        "inferred incident level (dB)": line.inferred_incident_level,
        "attenuation": line.attenuation.abs(),
        "segments": line.segments[:, None],
        "bursts": line.bursts[:, None],
        "rate (1/s)": line.rate[:, None],
        "counts": line.used[:, None].int(),
        "wall": "" if line.wall is None else line.wall.int(),
        "flags": [[len(flags)] for flags in line.flags],
    }
    if line.level_check is not None:
        columns["level check (dB)"] = line.level_check.cells.level[0]
    names = [name for name in line.names for _ in range(shape[1])]
    return [{"station": name, **row}
            for name, row in zip(names, rows_of(columns, shape), strict=True)]  # fmt: skip


FILE = ResultFile(KIND, _fill, {"stations": line_rows}, {"end": "\n"})
