"""Time, coordinates and gas: what our files of signals at probes share (docs/formats.md)."""

from __future__ import annotations

from contextvars import ContextVar
from fractions import Fraction
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import Unwritten
from torchliner.fluid import Fluid
from torchliner.io.clocks import UNIFORMITY, require_same_rate, uniform_rate
from torchliner.io.hdf5 import (
    factor_to,
    get_dataset,
    is_there,
    place,
    read_references,
    read_si,
    text_attribute,
)
from torchliner.io.stored_values import read_values
from torchliner.io.tables import FileKind, Table, numbers, read_variables
from torchliner.units import si_factor

# How netCDF-4 says that a dimension has a length and no coordinates.
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"
# Epoch of the clock read last, and its first time after that, s; who joins files asks for it.
CLOCK: ContextVar[tuple[str, Fraction] | None] = ContextVar("CLOCK", default=None)
FLUID_UNITS = {"sound_speed": "m/s", "density": "kg/m3", "dynamic_viscosity": "Pa s",
               "heat_capacity_ratio": "1", "prandtl": "1"}  # fmt: skip
FLUID = numbers(FLUID_UNITS)


def read_case(file: h5py.File, kind: FileKind, table: Table, path: Path, strict: bool = True) -> dict[str, Any]:
    """What describes a measurement and the attributes of the file, as fields of a record.

    The gas is air at 20 C where the file says nothing, the title the name of the file. Without
    ``strict`` what is no single number is none of the gas.

    Raises:
        ValueError: as ``read_variables``; no gas is like that.
    """
    found = {**kind.read_head(file, path), **read_variables(file, table, path)}
    if "title" in found:
        found["title"] = found["title"] or path.stem
    fluid = [row for row in FLUID if strict or getattr(file.get(row.names[0]), "size", 0) == 1]
    gas = read_variables(file, fluid, path)
    try:
        found["fluid"] = Fluid(**gas)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return {**found, "reference": read_references(file, path)}


def float_factor(file: h5py.Group, key: str, unit: str, path: Path, stated: str | None = None) -> float:
    """Factor from the units of a signal to an SI unit; ``stated``: units if the file has none.

    Integers count where ``scale_factor`` says what they stand for.

    Raises:
        ValueError: it is missing, is not floating-point, or has no unit of this quantity.
    """
    dataset = get_dataset(file, key, path)
    packed = dataset.dtype.kind in "iu" and "scale_factor" in dataset.attrs
    if dataset.dtype.kind != "f" and not packed:
        raise ValueError(f"{place(file, key, path)} is {dataset.dtype}; floating-point {unit} are needed")
    return factor_to(unit, file, key, path, stated)


def read_signal(file: h5py.File, key: str, unit: str, samples: int, path: Path) -> np.ndarray:
    """A signal in an SI unit, time last, float32 or float64 as in the file.

    Raises:
        As ``float_factor`` and ``find_time_axis``.
    """
    factor = float_factor(file, key, unit, path)
    axis = find_time_axis(file[key], samples, path)
    values = read_values(file[key], place(file, key, path), path)
    values = values if values.dtype in (np.float32, np.float64) else values.astype(np.float32)
    moved = np.ascontiguousarray(np.moveaxis(values, axis, -1))
    return moved if factor == 1 else moved * moved.dtype.type(factor)


def read_times(group: h5py.Group, path: str | Path, key: str = "time") -> tuple[float, int]:
    """Sampling rate (Hz) and number of samples; as ``read_clock``."""
    return read_clock(group, path, key)[:2]


def read_clock(
    group: h5py.Group, path: str | Path, key: str = "time", stated: float | None = None
) -> tuple[float, int, float]:
    """Sampling rate (Hz), number of samples, and time of the first, s.

    Args:
        group, path: of the dataset.
        key: its name.
        stated: sampling rate, Hz, where the times have no units, or as they have it.
    Raises:
        ValueError: the times are missing, not finite, not uniform, or of another rate than stated.
    """
    name, shape = place(group, key, path), get_dataset(group, key, path).shape
    if shape is None or len(shape) != 1 or shape[0] < 2:
        raise Unwritten(f"{name} has shape {shape}; a list of at least two times is needed")
    unit, _, epoch = (text_attribute(group[key], "units") or "").partition(" since ")
    if epoch or (stated is not None and not unit):
        # Dates are far from their epoch; what counts is how far they are from each other.
        counts = read_values(group[key], name, path)
        factor = si_factor("time", unit, name) if epoch else 1.0
        time = factor * (counts - counts[0]).astype(np.float64)
        first = factor * float(counts[0])
    else:
        counts = time = read_si(group, key, "s", path)
        first = float(time[0])
    kind = group[key].dtype
    # Stamps are as exact as their type; the largest is a unit in the last place off, at most.
    exact = float(np.spacing(np.abs(counts).max().astype(kind))) if kind.kind == "f" else 0.0
    exact *= factor if epoch else 1.0
    rate = uniform_rate(time, name, exact)
    if stated is None and exact * rate > UNIFORMITY:
        tell(
            f"{name} are {kind}, exact to {exact:.1g} s, {exact * rate:.2g} of a step: the rate, "
            f"{rate:.9g} Hz, is known to {exact / (time[-1] - time[0]):.1g} of itself; count times "
            "from a nearer origin, or in float64, or, of a plane, state sampling_rate=..."
        )
    if epoch:
        calendar = text_attribute(group[key], "calendar") or "standard"
        since = Fraction(counts[0].item()) * Fraction(str(factor))
        CLOCK.set((f"{epoch.strip()} {calendar.lower()}", since))
    if stated is not None and not unit:
        return stated, len(time), first * rate / stated  # whatever they count, evenly
    require_same_rate(rate, stated, name, unit)
    if stated is not None and abs(stated / rate - 1) * (time[-1] - time[0]) <= 2 * exact:
        rate = stated  # the stamps cannot tell the two apart
    return rate, len(time), first


def axis_names(dataset: h5py.Dataset, label: str) -> list[str]:
    """Names of the dimension scales of a dataset's axes, or their labels; "" where there is none.

    Raises:
        ValueError: an axis has a scale that is no longer in the file.
    """
    names = []
    for axis, dim in enumerate(dataset.dims):
        scale = dim[0] if len(dim) else None
        if len(dim) and (scale is None or scale.name is None):
            raise ValueError(
                f"{label}: the dimension scale of axis {axis} is no longer in the file; write it "
                "again, or detach it from the axis"
            )
        names.append(dim.label if scale is None else scale.name.split("/")[-1])
    return names


def find_time_axis(dataset: h5py.Dataset, samples: int, path: Path) -> int:
    """0 or -1, from the dimension scale 'time' or from the lengths.

    Raises:
        ValueError: neither axis fits the times, or both do.
    """
    name = f"{path}:{dataset.name}"
    shape = dataset.shape
    if shape is None or len(shape) not in (1, 2, 3):
        raise ValueError(f"{name} has shape {shape}; (time, z, x) or (time, probe) is needed")
    labels = axis_names(dataset, name)
    if labels[0] == "time" or (labels[-1] != "time" and shape[0] == samples):
        axis = 0
    elif shape[-1] == samples:
        axis = -1
    else:
        raise ValueError(f"{name} has shape {shape}, but /time has {samples} values; time is its first or last axis")
    if labels.count("time") == 0 and shape[0] == shape[-1] and len(shape) > 1:
        raise ValueError(
            f"{name} has shape {shape}: first and last axis both fit the {samples} times. Attach "
            "the dimension scale 'time' to the right one"
        )
    if shape[axis] != samples or "time" in labels[1:-1]:
        raise ValueError(
            f"{name} has shape {shape} with time on axis {labels.index('time')}, /time has "
            f"{samples} values; time is its first or last axis"
        )
    if [label for label in labels if label in ("z", "x")] == ["x", "z"]:
        raise ValueError(f"{name} has dimensions {tuple(labels)}; z comes before x: transpose it")
    return axis


def read_coordinate(
    file: h5py.Group, key: str, shape: tuple[int, ...], path: Path, stated: str | None = None
) -> np.ndarray | None:
    """x or z, m; None if the file has none, or numbers its columns alone.

    ``stated``: units if the file has none.

    Raises:
        ValueError: as ``read_si``; another number of values than the probes need; values that are
            not finite; units of 1 for what is no index.
    """
    if not is_there(file, key, path):
        return None
    dataset, label = get_dataset(file, key, path), place(file, key, path)
    unit = text_attribute(dataset, "units")
    if unit is None and (text_attribute(dataset, "NAME") or "").startswith(NO_VARIABLE):
        return None
    if unit == "1":
        index = read_values(dataset, label, path)
        if np.array_equal(index, np.arange(index.size)):
            return None
        raise ValueError(f"{label} has units '1', but is no index 0, 1, 2, ...; state its unit, as 'mm'")
    values = read_si(file, key, "m", path, stated=stated).reshape(-1)
    wanted = 1 if not shape else shape[-1] if key == "x" or len(shape) == 1 else shape[0]
    if len(values) != wanted:
        raise ValueError(f"{label} has {len(values)} values; the probes, {shape}, need {wanted}")
    if not np.isfinite(values).all():
        raise ValueError(f"{label} holds values that are not finite")
    return values
