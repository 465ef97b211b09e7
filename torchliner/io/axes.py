"""Time, coordinates and gas: what our files of signals at probes share (docs/formats.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.fluid import Fluid
from torchliner.io import clocks, variables
from torchliner.io.hdf5 import get_dataset, is_there
from torchliner.io.tables import FileKind, Table, numbers, read_variables

FLUID_UNITS = {
    "sound_speed": "m/s",
    "density": "kg/m3",
    "dynamic_viscosity": "Pa s",
    "heat_capacity_ratio": "1",
    "prandtl": "1",
}
FLUID = numbers(FLUID_UNITS)


def read_case(file: h5py.File, kind: FileKind, table: Table, path: Path) -> dict[str, Any]:
    """What describes a measurement and the attributes of the file, as fields of a record.

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


def read_references(file: h5py.Group, path: str | Path) -> dict[str, complex]:
    """Impedances by name, as ``write_references`` wrote them."""
    fields = {f"/{key}": _field(file, key, path) for key in file if key.startswith("reference_")}
    return variables.references_of(fields)


def _field(file: h5py.Group, key: str, path: str | Path) -> variables.Field:
    get_dataset(file, key, path)
    return variables.field_of(file, key, path)


def read_signal(file: h5py.File, key: str, unit: str, samples: int, path: Path) -> np.ndarray:
    """A signal in an SI unit, time last, float32 or float64 as in the file.

    Raises:
        ValueError: as ``Field.signal_factor`` and ``time_axis``.
    """
    signal = _field(file, key, path)
    factor, axis = signal.signal_factor(unit), variables.time_axis(signal, samples)
    values = signal.values()
    values = values if values.dtype in (np.float32, np.float64) else values.astype(np.float32)
    moved = np.ascontiguousarray(np.moveaxis(values, axis, -1))
    return moved if factor == 1 else moved * moved.dtype.type(factor)


def read_times(group: h5py.Group, path: str | Path, key: str = "time") -> tuple[float, int]:
    """Sampling rate (Hz) and number of samples; as ``clocks.read_times``."""
    return read_clock(group, path, key)[:2]


def read_clock(group: h5py.Group, path: str | Path, key: str = "time") -> tuple[float, int, float]:
    """Sampling rate (Hz), number of samples, and time of the first, s; as ``clocks.read_times``."""
    return clocks.read_times(_field(group, key, path))[:3]


def read_coordinate(file: h5py.Group, key: str, shape: tuple[int, ...], path: Path) -> np.ndarray | None:
    """x or z of probes, m; None if the file has none, or numbers its columns alone; as ``variables.coordinate``."""
    if not is_there(file, key, path):
        return None
    return variables.coordinate(_field(file, key, path), 1 if not shape else shape[-1] if key == "x" else shape[0])
