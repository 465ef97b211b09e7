"""Pressures around a liner, one file: HDF5 that is valid netCDF-4 at once (docs/formats.md).

The facesheet's pressure is (time, z, x), (time, x) or (time, probe), the backplate's (time),
(time, cell) or like the facesheet's, the microphones' (time, microphone).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchliner.io.axes import read_clock, read_coordinate, read_signal
from torchliner.io.hdf5 import get_dataset, is_there, open_file, place, text_attribute, tiles
from torchliner.io.own_file import take
from torchliner.io.own_writer import fill, write_times
from torchliner.io.stored_values import read_values
from torchliner.io.tables import new_file, require_schema, write_row
from torchliner.records import PressureRecord
from torchliner.records.declared import Part, table_of
from torchliner.records.pressure_record import SIGNALS

COMPRESSED_ROWS = 2048
SIGNAL_TABLE = table_of(PressureRecord, *SIGNALS)


def write_pressure(record: PressureRecord, path: str | Path) -> None:
    """Write a record; signals are compressed in tiles, times stand for rate and start.

    Raises:
        ValueError: a single sample: a file's sampling rate is that of its times.
    """
    with new_file(path) as file:
        write_times(file, record)
        fill(file, record, unsaid=(*SIGNALS, "sampling_rate", "start", "name"))
        for row in SIGNAL_TABLE:
            if (values := getattr(record, row.field)) is not None:
                shape = (values.shape[-1], *values.shape[:-1])
                write_row(file, row, values, record.axes, **tiles(shape, COMPRESSED_ROWS))


def read_pressure(path: str | Path) -> PressureRecord:
    """A record from a file of ours, or of anyone who follows the schema.

    Args:
        path: .h5, .hdf5 or .nc.
    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: not of this schema; a variable is missing, has another shape, unit or size than it can have. The
            message names FILE:/variable.
    """
    path = Path(path)
    with open_file(path) as file:
        if "schema" in file.attrs:
            require_schema(file, path, PressureRecord.SCHEMA)
        there = [row for row in SIGNAL_TABLE if is_there(file, row.names[0], path)]
        if not there:
            get_dataset(file, "facesheet_pressure", path)  # says what is there instead
        rate, samples, start = read_clock(file, path)
        known: dict[str, Any] = dict.fromkeys(SIGNALS)
        known |= {row.field: read_signal(file, row.names[0], row.unit, samples, path) for row in there}
        shape = () if known["facesheet"] is None else known["facesheet"].shape[:-1]
        known |= {key: read_coordinate(file, key, shape, path) for key in ("x", "z")}
        known |= {"sampling_rate": rate, "start": start, "name": str(path)}
        known |= {"title": text_attribute(file, "title") or path.stem, "probe_cell": None}
        if is_there(file, "probe_cell", path):
            known["probe_cell"] = read_values(file["probe_cell"], place(file, "probe_cell", path), path)
        made: PressureRecord = take(file, PressureRecord, path, known, Part())
        return made
