"""Time, coordinates and gas: what our files of signals at probes share (docs/formats.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.io import fields
from torchliner.io.hdf5 import get_dataset, is_there, read_references, write_index, write_references, write_variable
from torchliner.io.tables import FileKind, Table, numbers, plain, read_variables, write_variables

FLUID_UNITS = {
    "sound_speed": "m/s",
    "density": "kg/m3",
    "dynamic_viscosity": "Pa s",
    "heat_capacity_ratio": "1",
    "prandtl": "1",
}
FLUID = numbers(FLUID_UNITS)
PLACES = {"x": "streamwise coordinate", "z": "spanwise coordinate"}


def write_coordinates(
    file: h5py.Group, shape: tuple[int, ...], x: Tensor | None, z: Tensor | None, line: bool = True
) -> tuple[str, ...]:
    """Coordinate variables and dimensions of probes.

    Args:
        file: to write into.
        shape: of the probes, (z, x), (probe,) or ().
        x, z: m; None where unknown.
        line: probes in the order of x, without z, lie along a dimension x and not ``probe``.
    Returns:
        Names of the dimensions.
    """
    known = {name: plain(values) for name, values in (("x", x), ("z", z)) if values is not None}
    rising = line and list(known) == ["x"] and bool((np.diff(known["x"]) > 0).all())
    dims = ("z", "x") if len(shape) == 2 else () if not shape else ("x",) if rising else ("probe",)
    for dim, count in zip(dims, shape, strict=True):
        if dim not in known:
            write_index(file, dim, count)
    for name, values in known.items():
        along = (name,) if name in dims else dims
        row = write_variable(file, name, values if shape else values.item(), "m", along)
        row.attrs["long_name"] = PLACES[name]
    return dims


def write_case(file: h5py.File, record: Any, table: Table) -> None:
    """What describes a measurement: the variables of a table, the gas, reference impedances."""
    write_variables(file, record, table)
    write_variables(file, record.fluid, FLUID)
    write_references(file, record.reference)


def read_case(file: h5py.File, kind: FileKind, table: Table, path: Path) -> dict[str, Any]:
    """What ``write_case`` wrote and the attributes of the file, as fields of a record.

    The gas is air at 20 C where the file says nothing, the title the name of the file.

    Raises:
        ValueError: as ``read_variables``; no gas is like that.
    """
    found = {**kind.read_head(file, path), **read_variables(file, table, path)}
    if "title" in found:
        found["title"] = found["title"] or path.stem
    gas = read_variables(file, FLUID, path)
    try:
        found["fluid"] = Fluid(**gas)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return {**found, "reference": read_references(file, path)}


def write_times(file: h5py.File, record: Any) -> None:
    """The dimension ``time`` of the uniform samples of a record.

    Raises:
        ValueError: a single sample: a file states times, of which one tells no sampling rate.
    """
    if record.samples < 2:
        raise ValueError(f"{record.name} has 1 sample; at least two times are needed in a file")
    times = getattr(record, "start", 0.0) + np.arange(record.samples) / record.sampling_rate
    write_variable(file, "time", times, "s", ("time",))


def _field(file: h5py.Group, key: str, path: str | Path) -> fields.Field:
    get_dataset(file, key, path)
    return fields.field_of(file, key, path)


def read_signal(file: h5py.File, key: str, unit: str, samples: int, path: Path) -> np.ndarray:
    """A signal in an SI unit, time last, float32 or float64 as in the file.

    Raises:
        ValueError: as ``Field.signal_factor`` and ``time_axis``.
    """
    signal = _field(file, key, path)
    factor, axis = signal.signal_factor(unit), fields.time_axis(signal, samples)
    values = signal.values()
    values = values if values.dtype in (np.float32, np.float64) else values.astype(np.float32)
    moved = np.ascontiguousarray(np.moveaxis(values, axis, -1))
    return moved if factor == 1 else moved * moved.dtype.type(factor)


def read_times(group: h5py.Group, path: str | Path, key: str = "time") -> tuple[float, int]:
    """Sampling rate (Hz) and number of samples; as ``fields.read_times``."""
    return read_clock(group, path, key)[:2]


def read_clock(group: h5py.Group, path: str | Path, key: str = "time") -> tuple[float, int, float]:
    """Sampling rate (Hz), number of samples, and time of the first, s; as ``fields.read_times``."""
    return fields.read_times(_field(group, key, path))[:3]


def find_time_axis(dataset: h5py.Dataset, samples: int, path: Path) -> int:
    """0 or -1; as ``fields.time_axis``."""
    return fields.time_axis(fields.Field(dataset, path, dataset.name, dataset.attrs), samples)


def read_coordinate(file: h5py.Group, key: str, shape: tuple[int, ...], path: Path) -> np.ndarray | None:
    """x or z of probes, m; None if the file has none, or numbers its columns alone; as ``fields.coordinate``."""
    if not is_there(file, key, path):
        return None
    return fields.coordinate(_field(file, key, path), 1 if not shape else shape[-1] if key == "x" else shape[0])
