"""Pressures around a liner, one file: HDF5 that is valid netCDF-4 at once (docs/formats.md).

The facesheet's pressure is (time, z, x), (time, x) or (time, probe), the backplate's (time),
(time, cell) or like the facesheet's, the microphones' (time, microphone).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.io.axes import (
    find_time_axis,
    read_coordinate,
    read_fluid,
    read_times,
    write_coordinates,
    write_fluid,
)
from torchliner.io.hdf5 import (
    get_dataset,
    open_file,
    place,
    read_json,
    read_references,
    read_scalars,
    read_si,
    require_schema,
    text_attribute,
    to_json,
    write_dimension,
    write_references,
    write_scalars,
    write_variable,
    written_whole,
)
from torchliner.records import PressureRecord
from torchliner.units import si_factor

SCHEMA = "torchliner pressure 1"
COMPRESSED_ROWS, COMPRESSED_COLUMNS = 2048, 64
# name in the file -> field of the record, quantity, unit
SIGNALS = {
    "facesheet_pressure": ("facesheet", "pressure", "Pa"),
    "backplate_pressure": ("backplate", "pressure", "Pa"),
    "microphone_pressure": ("microphones", "pressure", "Pa"),
    "microphone_velocity": ("microphone_velocity", "velocity", "m/s"),
}
SCALARS = {
    "cavity_depth": ("length", "m"),
    "cavity_porosity": ("number", "1"),
    "cavity_hydraulic_radius": ("length", "m"),
    "cell_pitch": ("length", "m"),
    "microphone_mach": ("number", "1"),
    "frequency": ("frequency", "Hz"),
    "incident_level": ("level", "dB"),
    "mach": ("number", "1"),
}


def write_pressure(record: PressureRecord, path: str | Path) -> None:
    """Write a record; the old file, if any, is replaced only when the new one is whole.

    Raises:
        ValueError: a single sample: a file's sampling rate is that of its times.
    """
    if record.samples < 2:
        raise ValueError(f"{record.name} has 1 sample; at least two times are needed in a file")
    with written_whole(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["Conventions"] = "CF-1.8"
        file.attrs["schema"] = SCHEMA
        file.attrs["title"] = record.title
        file.attrs["provenance"] = to_json(dict(record.provenance))
        write_dimension(file, "time", np.arange(record.samples) / record.sampling_rate, "s")
        dims = _write_probes(file, record)
        for name, (field, _, unit) in SIGNALS.items():
            values = getattr(record, field)
            if values is not None:
                _write_signal(file, name, values, unit, dims[field])
        write_scalars(file, record, SCALARS)
        write_fluid(file, record.fluid)
        write_references(file, record.reference)


def _write_probes(file: h5py.File, record: PressureRecord) -> dict[str, tuple[str, ...]]:
    """Dimensions and coordinates; returns the dimensions of each signal after time."""
    dims: dict[str, tuple[str, ...]] = {}
    if record.facesheet is not None:
        dims["facesheet"] = dims["backplate"] = write_coordinates(file, record)
        if record.backplate.ndim == 1:
            dims["backplate"] = ()
        elif record.backplate.shape != record.facesheet.shape:
            write_dimension(file, "cell", np.arange(len(record.backplate)), "1")
            dims["backplate"] = ("cell",)
        if record.probe_cell is not None:
            labels = record.probe_cell.numpy().reshape(record.probe_shape)
            write_variable(file, "probe_cell", labels, "1", dims["facesheet"])
    if record.microphones is not None:
        write_dimension(file, "microphone", np.arange(len(record.microphones)), "1")
        write_variable(file, "microphone_y", record.microphone_y.numpy(), "m", ("microphone",))
        dims["microphones"] = dims["microphone_velocity"] = ("microphone",)
    return dims


def _write_signal(
    file: h5py.File, name: str, values: Any, unit: str, dims: tuple[str, ...]
) -> None:
    array = np.moveaxis(values.detach().cpu().numpy(), -1, 0)
    chunk = (
        min(array.shape[0], COMPRESSED_ROWS),
        *(min(n, COMPRESSED_COLUMNS) for n in array.shape[1:]),
    )
    write_variable(
        file, name, array, unit, ("time", *dims),
        compression="gzip", compression_opts=9, shuffle=True, chunks=chunk,
    )  # fmt: skip
    if name == "microphone_velocity":
        file[name].attrs["positive"] = "away from the liner"


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
            require_schema(file, SCHEMA, "pressure record", path)
        if not any(name in file for name in SIGNALS):
            get_dataset(file, "facesheet_pressure", path)  # says what is there instead
        rate, samples = read_times(file, path)
        signals: dict[str, Any] = {
            field: _signal(file, name, quantity, samples, path)
            for name, (field, quantity, _) in SIGNALS.items()
            if name in file
        }
        shape = signals["facesheet"].shape[:-1] if "facesheet" in signals else ()
        places: dict[str, Any] = {k: read_coordinate(file, k, shape, path) for k in ("x", "z")}
        if "microphone_y" in file:
            places["microphone_y"] = read_si(file, "microphone_y", "length", path).reshape(-1)
        if "probe_cell" in file:
            places["probe_cell"] = get_dataset(file, "probe_cell", path)[()]
        return PressureRecord(
            **signals,
            sampling_rate=rate,
            fluid=read_fluid(file, path),
            **places,
            **read_scalars(file, SCALARS, path),
            title=text_attribute(file, "title") or path.stem,
            reference=read_references(file, path),
            provenance=read_json(file, "provenance", path, {}),
            name=str(path),
        )


def _signal(file: h5py.File, name: str, quantity: str, samples: int, path: Path) -> np.ndarray:
    """A signal in SI units, time last, in the file's precision."""
    dataset = get_dataset(file, name, path)
    where = place(file, name, path)
    factor = si_factor(quantity, text_attribute(dataset, "units"), where)
    if dataset.dtype.kind != "f":
        raise ValueError(f"{where} is {dataset.dtype}; floating-point numbers are needed")
    axis = find_time_axis(dataset, samples, path)
    values = np.asarray(dataset[()])
    values = values if values.dtype in (np.float32, np.float64) else values.astype(np.float32)
    moved = np.ascontiguousarray(np.moveaxis(values, axis, -1))
    return moved if factor == 1 else moved * moved.dtype.type(factor)
