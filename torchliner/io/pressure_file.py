"""Pressures around a liner, one file: HDF5 that is valid netCDF-4 at once (docs/formats.md).

The facesheet's pressure is (time, z, x), (time, x) or (time, probe), the backplate's (time),
(time, cell) or like the facesheet's, the microphones' (time, microphone).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from torchliner.io.axes import read_case, read_clock, read_coordinate, read_signal
from torchliner.io.fields import fill, line_axes, write_times
from torchliner.io.hdf5 import get_dataset, is_there, place, tiles
from torchliner.io.own_file import OwnFile
from torchliner.io.stored_values import read_values
from torchliner.io.tables import write_row
from torchliner.records import PressureRecord
from torchliner.records.declared import table_of, variables_of
from torchliner.records.pressure_record import SIGNALS

COMPRESSED_ROWS = 2048
SIGNAL_TABLE = table_of(PressureRecord, *SIGNALS)
FACTS = tuple(
    row for row in variables_of(PressureRecord) if row.field == "microphone_y" or not (row.dims or row.field == "start")
)


class PressureFile(OwnFile):
    """Signals are compressed in tiles; times stand for rate and start."""

    def fill(self, group: h5py.Group, record: PressureRecord) -> None:
        """Into an open file.

        Raises:
            ValueError: a single sample: a file's sampling rate is that of its times.
        """
        self.write_head(group, record)
        write_times(group, record)
        fill(group, record, axes=_axes(record), unsaid=(*SIGNALS, *self.unsaid, "probe_cell"))
        for row in SIGNAL_TABLE:
            values = getattr(record, row.field)
            if values is not None:
                shape = (values.shape[-1], *values.shape[:-1])
                write_row(group, row, values, _axes(record), **tiles(shape, COMPRESSED_ROWS))
        if record.probe_cell is not None:
            (row,) = table_of(PressureRecord, "probe_cell")
            write_row(group, row, record.probe_cell.reshape(record.probe_shape), _axes(record))

    def taken(self, group: h5py.File, path: str | Path, **known: Any) -> PressureRecord:
        """From an open file, also of anyone who follows the schema."""
        path = Path(path)
        if "schema" in group.attrs:
            self.require(group, path)
        there = [row for row in SIGNAL_TABLE if is_there(group, row.names[0], path)]
        if not there:
            get_dataset(group, "facesheet_pressure", path)  # says what is there instead
        rate, samples, start = read_clock(group, path)
        fields: dict[str, Any] = {row.field: read_signal(group, row.names[0], row.unit, samples, path) for row in there}
        shape = fields["facesheet"].shape[:-1] if "facesheet" in fields else ()
        fields |= {key: read_coordinate(group, key, shape, path) for key in ("x", "z")}
        fields |= read_case(group, self, FACTS, path)
        if is_there(group, "probe_cell", path):
            fields["probe_cell"] = read_values(group["probe_cell"], place(group, "probe_cell", path), path)
        return PressureRecord(**fields, sampling_rate=rate, start=start, name=str(path))


def _axes(record: PressureRecord) -> dict[str, tuple[str, ...]]:
    """Of facesheet and backplate."""
    axes = line_axes(record)
    probes = axes["probes"]
    if record.backplate is None or record.backplate.shape == record.facesheet.shape:
        return {**axes, "facesheet": probes, "backplate": probes}
    return {**axes, "facesheet": probes, "backplate": ("cell",) if record.backplate.ndim == 2 else ()}


FILE = PressureFile(
    "torchliner pressure 1",
    "pressure record",
    {"title": "", "source_side": "unknown", "liner": "", "provenance": {}},
    record=PressureRecord,
    unsaid=("sampling_rate", "start", "name"),
)
read_pressure, write_pressure = FILE.read, FILE.write
