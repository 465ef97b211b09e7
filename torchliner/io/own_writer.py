"""Files of our own records: their fields say what stands there (``records.declared``), one writer serves all.

A record is a netCDF-4 file, or a group of one; several stand in groups beside each other. All is made in memory: on a
full disk HDF5 itself crashes.
"""

import dataclasses
import io
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
from torch import Tensor

from torchliner.checks import type_hints
from torchliner.fluid import Fluid
from torchliner.io.whole_file import HDF5, written_whole
from torchliner.names import RESULT_WRITERS, resolve
from torchliner.records.case import AtProbes
from torchliner.records.declared import Variable, facts_of, flat
from torchliner.records.outlets import Result

LONGEST_TEXT = 60_000  # bytes
PLACES = {  # coordinates by dimension, of what else stands along it
    "probe": ("x", "z"),
    "cell": ("cell_x", "cell_z"),
    "point": ("point_x", "point_z"),
    "station": ("x", "y", "z", "station_name"),
}
FLUID_UNITS = {
    "sound_speed": "m/s",
    "density": "kg/m3",
    "dynamic_viscosity": "Pa s",
    "heat_capacity_ratio": "1",
    "prandtl": "1",
}
REFERENCES = Mapping[str, complex]  # a field of this type is of impedances by name
Axes = Mapping[str, Sequence[str]]


def write_record(record: Any, path: str | Path) -> None:
    """One file, by its ending; the old one, if any, is replaced when the new one is whole. A ValueError where no writer
    has this ending, and for what the format cannot hold."""
    ending, others = Path(path).suffix.lower(), RESULT_WRITERS if isinstance(record, Result) else ()
    if ending in others:
        resolve(RESULT_WRITERS[ending])(record, path)
    else:
        with new_file(path, *others) as file:
            if isinstance(record, AtProbes):
                write_times(file, record)
            fill(file, record)


def write_several(several: Sequence[Any], path: str | Path) -> None:
    """Records of one kind in groups of one file, as their ``GROUPS`` say."""
    schema, stem = several[0].GROUPS
    with new_file(path) as file:
        set_texts(file, schema=schema)
        for i, one in enumerate(several):
            fill(file.create_group(f"{stem}_{i}"), one)


@contextmanager
def new_file(path: str | Path, *others: str) -> Iterator[h5netcdf.File]:
    """A netCDF-4 file that takes the place of an old one when it is whole; ``others``: endings that a message names."""
    with written_whole(path, *HDF5, *others) as temporary:
        with in_memory() as (buffer, file):
            yield file
        temporary.write_bytes(buffer.getvalue())


@contextmanager
def in_memory() -> Iterator[tuple[io.BytesIO, h5netcdf.File]]:
    """A netCDF-4 file without a disk; its bytes are whole behind the block."""
    buffer = io.BytesIO()
    with h5netcdf.File(buffer, "w") as file:
        set_texts(file, Conventions="CF-1.8")
        yield buffer, file


def fill(group: h5netcdf.Group, record: Any, unsaid: Sequence[str] = (), **more: Any) -> None:
    """A record into an open file, or a group of one, but for the fields ``unsaid``, and ``more`` attributes;
    coordinates first, then what stands along them."""
    axes, unsaid = getattr(record, "axes", {}), (*unsaid, *getattr(record, "UNSAID", ()))
    if hasattr(record, "SCHEMA"):
        set_texts(group, schema=record.SCHEMA)
    rows = [(row, value) for row, value in flat(record) if row.field not in unsaid]
    for row, value in sorted(rows, key=lambda each: dims_of(each[0].dims, axes) != [each[0].name]):
        if row.kind != "text" or row.name not in group.variables:  # averagings stand there once
            write_row(group, row, value, axes)
    hints = type_hints(record.__class__)
    for each in dataclasses.fields(record):
        value = getattr(record, each.name)
        if each.name in unsaid or "variable" in each.metadata or not each.init:
            continue
        if "part" in each.metadata and each.metadata["part"].by == "groups":
            stem = each.metadata["part"].stem
            several = isinstance(value, tuple)
            for i, one in enumerate(value if several else [value] * (value is not None)):
                fill(group.create_group(f"{stem}_{i}" if several else stem), one)
        elif "part" in each.metadata:
            said = facts_of(type(value)) if dataclasses.is_dataclass(value) else []
            set_texts(group, **({each.name: {key: getattr(value, key) for key in said}} if said else {}))
        elif isinstance(value, Fluid):
            for name, unit in FLUID_UNITS.items():
                write_row(group, Variable(name, unit), getattr(value, name))
        elif hints[each.name] == REFERENCES:
            _write_references(group, value)
        else:
            set_texts(group, **{each.name: value})
    set_texts(group, **more)
    for name, variable in group.variables.items():
        near = [known for dim in variable.dimensions for known in PLACES.get(dim, ()) if known in group.variables]
        if near and name not in (*near, *variable.dimensions):  # as the CF conventions have it
            set_texts(variable, coordinates=" ".join(near))


def write_row(group: h5netcdf.Group, row: Variable, value: Any, axes: Axes | None = None) -> None:
    """One variable, or the two parts of a complex one; dimensions that the group lacks are made. ``axes``: dimensions
    that stand behind one name of ``Variable.dims``."""
    dims, values = dims_of(row.dims, axes), np.array(value, dtype=object) if row.kind == "text" else plain(value)
    if dims[-1:] == ["time"]:
        dims, values = ["time", *dims[:-1]], np.moveaxis(values, -1, 0)
    values = values if dims else values.reshape(()).astype(np.result_type(values, np.float64))
    make_dimensions(group, row.field, dims, values.shape)
    parts = (values,) if len(row.names) == 1 else (values.real, values.imag)
    for (name, text), part in zip(row.parts.items(), parts, strict=True):
        kind = h5py.string_dtype() if row.kind == "text" else part.dtype
        variable = group.create_variable(name, dims, kind, data=part)
        units = {} if row.kind == "text" else {"units": row.unit}
        set_texts(variable, **units, **({"long_name": text} if text else {}), **row.attributes)


def make_dimensions(group: h5netcdf.Group, field: str, dims: Sequence[str], shape: Sequence[int]) -> None:
    """Those that a field needs and the group lacks; one of another length is a ValueError."""
    for dim, count in zip(dims, shape, strict=True):
        known = group.dimensions[dim].size if dim in group.dimensions else count
        if known != count:
            raise ValueError(f"{field} has {count} values along {dim}, of which the record has {known}")
        if dim not in group.dimensions:
            group.dimensions[dim] = count


def write_times(group: h5netcdf.Group, record: Any) -> None:
    """The dimension ``time`` of the uniform samples of a record: a file states times, one of which tells no rate."""
    if record.samples < 2:
        raise ValueError(f"{record.name} has 1 sample; at least two times are needed in a file")
    write_row(group, Variable("time", "s", ("time",)), record.start + np.arange(record.samples) / record.sampling_rate)


def _write_references(group: h5netcdf.Group, reference: Mapping[str, complex]) -> None:
    """Impedances by name, each as two numbers whose attribute ``label`` holds the name."""
    for number, (label, value) in enumerate(reference.items()):
        stem = "reference_" + re.sub(r"\W+", "_", label)
        stem = f"{stem}_{number}" if f"{stem}_resistance" in group.variables else stem
        row = Variable("", name=f"{stem}_{{}}", text=f"from elsewhere, {label}", attributes={"label": label})
        write_row(group, row, complex(value))


def dims_of(names: Sequence[str], axes: Axes | None) -> list[str]:
    """Dimensions in a file that those of a ``Variable`` stand for."""
    return [dim for name in names for dim in (axes or {}).get(name, (name,))]


def plain(value: Any) -> np.ndarray:
    """A tensor, list or number as an array; booleans become 0 and 1."""
    values = value.detach().cpu().numpy() if isinstance(value, Tensor) else np.asarray(value)
    return values.astype(np.int8) if values.dtype == np.bool_ else values


def set_texts(owner: Any, **values: Any) -> None:
    """Attributes: texts as they are, all else as JSON. Of fixed length, which nco and Octave read; HDF5 has 64 kB for
    them, beyond it no choice."""
    for key, value in values.items():
        text = value if isinstance(value, str) else to_json(value)
        stored = text.encode()
        fixed = h5py.string_dtype("utf-8", max(1, len(stored)))
        owner.attrs[key] = np.array(stored, fixed) if len(stored) < LONGEST_TEXT else text


def to_json(value: Any) -> str:
    """JSON text; arrays and tensors become lists, dataclasses objects, what JSON does not know text."""

    def known(item: Any) -> Any:
        if isinstance(item, Mapping):
            return dict(item)
        return vars(item) if dataclasses.is_dataclass(item) else getattr(item, "tolist", item.__str__)()

    return json.dumps(value, default=known)


# For other programs


def to_xarray(record: Any) -> Any:
    """What ``xarray.open_dataset`` shows of the file, and the complex values."""
    import xarray

    with in_memory() as (buffer, file):
        fill(file, record)
    found: Any = xarray.load_dataset(buffer, engine="h5netcdf")
    for real, part in list(found.items()):
        for whole, (first, second) in {"impedance": ("resistance", "reactance"), "": ("_real", "_imaginary")}.items():
            if first in real and (other := real.replace(first, second)) in found:
                text = part.attrs.get("long_name", real.replace(first, whole))
                text = text.replace("real part of the ", "").replace("resistance", "impedance")
                both = (part + 1j * found[other]).assign_attrs(part.attrs | {"long_name": text})
                found[real.replace(first, whole)] = both
    return found
