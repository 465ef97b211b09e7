"""Pressures around a liner, one file: HDF5 that is valid netCDF-4 at once (docs/formats.md).

The facesheet's pressure is (time, z, x), (time, x) or (time, probe), the backplate's (time),
(time, cell) or like the facesheet's, the microphones' (time, microphone).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from torchliner.io.axes import (
    read_case,
    read_clock,
    read_coordinate,
    read_signal,
    write_case,
    write_coordinates,
    write_times,
)
from torchliner.io.hdf5 import (
    get_dataset,
    is_there,
    open_file,
    place,
    tiles,
    write_index,
    write_variable,
)
from torchliner.io.stored_values import read_values
from torchliner.io.tables import FileKind, Variable, numbers, real, write_variables
from torchliner.records import PressureRecord

KIND = FileKind("torchliner pressure 1", "pressure record", {"title": "", "provenance": {}})
COMPRESSED_ROWS = 2048
SIGNALS = (
    Variable("facesheet", ("facesheet_pressure",), "Pa", ("time", "facesheet"), optional=True),
    Variable("backplate", ("backplate_pressure",), "Pa", ("time", "backplate"), optional=True),
    Variable("microphones", ("microphone_pressure",), "Pa", ("time", "microphone"), optional=True),
    real("microphone_velocity", "m/s", ("time", "microphone"), optional=True,
         attributes={"positive": "away from the liner"}),
)  # fmt: skip
PLACES = (real("microphone_y", "m", ("microphone",), optional=True),)
NUMBERS = numbers(
    {"cavity_depth": "m", "cavity_porosity": "1", "cavity_hydraulic_radius": "m",
     "cell_pitch": "m", "microphone_mach": "1", "frequency": "Hz", "incident_level": "dB",
     "mach": "1"}
)  # fmt: skip


def write_pressure(record: PressureRecord, path: str | Path) -> None:
    """Write a record; the old file, if any, is replaced only when the new one is whole.

    Raises:
        ValueError: a single sample: a file's sampling rate is that of its times.
    """
    with KIND.created(path, record) as file:
        write_times(file, record)
        axes = _write_probes(file, record)
        for signal in SIGNALS:
            values = getattr(record, signal.field)
            if values is not None:
                shape = (values.shape[-1], *values.shape[:-1])
                write_variables(file, record, [signal], axes, **tiles(shape, COMPRESSED_ROWS))
        write_case(file, record, NUMBERS)


def _write_probes(file: h5py.File, record: PressureRecord) -> dict[str, tuple[str, ...]]:
    """Dimensions and coordinates; returns the dimensions of facesheet and backplate."""
    axes: dict[str, tuple[str, ...]] = {}
    if record.facesheet is not None:
        probes = write_coordinates(file, record.probe_shape, record.x, record.z)
        axes = {"facesheet": probes, "backplate": probes}
        if record.backplate.ndim == 1:
            axes["backplate"] = ()
        elif record.backplate.shape != record.facesheet.shape:
            write_index(file, "cell", len(record.backplate))
            axes["backplate"] = ("cell",)
        if record.probe_cell is not None:
            labels = record.probe_cell.numpy().reshape(record.probe_shape)
            write_variable(file, "probe_cell", labels, "1", probes)
    if record.microphones is not None:
        write_index(file, "microphone", len(record.microphones))
        write_variables(file, record, PLACES)
    return axes


def read_pressure(path: str | Path) -> PressureRecord:
    """Read a record written by ``PressureRecord.write`` or by anyone who follows the schema.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: a dataset is missing, has a wrong shape, another time base, or no or wrong
            units; a number is out of range. The message names FILE:/dataset.
    """
    path = Path(path)
    with open_file(path) as file:
        if "schema" in file.attrs:
            KIND.require(file, path)
        there = [signal for signal in SIGNALS if is_there(file, signal.names[0], path)]
        if not there:
            get_dataset(file, "facesheet_pressure", path)  # says what is there instead
        rate, samples, start = read_clock(file, path)
        fields: dict[str, Any] = {
            signal.field: read_signal(file, signal.names[0], signal.unit, samples, path) for signal in there
        }
        shape = fields["facesheet"].shape[:-1] if "facesheet" in fields else ()
        fields |= {key: read_coordinate(file, key, shape, path) for key in ("x", "z")}
        fields |= read_case(file, KIND, PLACES + NUMBERS, path)
        if is_there(file, "probe_cell", path):
            cells = get_dataset(file, "probe_cell", path)
            fields["probe_cell"] = read_values(cells, place(file, "probe_cell", path), path)
        return PressureRecord(**fields, sampling_rate=rate, start=start, name=str(path))
