"""Files of our own records: their fields say what stands there (``records.declared``), one writer serves all.

A record is a netCDF-4 file, or a group of one; several stand in groups beside each other.
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.fluid import Fluid
from torchliner.io.axes import FLUID
from torchliner.io.hdf5 import set_texts, write_references
from torchliner.io.tables import dims_of, new_file, write_attribute, write_row, write_variables
from torchliner.names import RESULT_WRITERS, resolve
from torchliner.records.declared import PARTS, Part, Variable, flat, parts_of
from torchliner.records.outlets import Result

PLACES = {  # coordinates by dimension, of what else stands along it
    "probe": ("x", "z"),
    "cell": ("cell_x", "cell_z"),
    "point": ("point_x", "point_z"),
    "station": ("x", "y", "z", "station_name"),
}
REFERENCES = "Mapping[str, complex]"  # a field of this type is of impedances by name


def write_record(record: Any, path: str | Path) -> None:
    """One file, by its ending; the old one, if any, is replaced when the new one is whole.

    Raises:
        ValueError: no writer has this ending; what the format cannot hold.
    """
    ending, others = Path(path).suffix.lower(), RESULT_WRITERS if isinstance(record, Result) else ()
    if ending in others:
        resolve(RESULT_WRITERS[ending])(record, path)
    else:
        with new_file(path, *others) as file:
            fill(file, record)


def write_several(several: Sequence[Any], path: str | Path) -> None:
    """Records of one kind in groups of one file, as their ``GROUPS`` say."""
    schema, stem = several[0].GROUPS
    with new_file(path) as file:
        set_texts(file, schema=schema)
        _fill_groups(file, stem, several)


def _fill_groups(group: h5py.Group, stem: str, several: Sequence[Any]) -> None:
    for i, one in enumerate(several):
        fill(group.create_group(f"{stem}_{i}"), one)


def fill(group: h5py.Group, record: Any, unsaid: Sequence[str] = ()) -> None:
    """A record but its fields ``unsaid`` into an open file, or a group of one; coordinates first, then what stands
    along them."""
    if hasattr(record, "SCHEMA"):
        set_texts(group, schema=record.SCHEMA)
    axes = getattr(record, "axes", {})
    rows = [(row, value) for row, value in flat(record) if row.field not in unsaid]
    for row, value in sorted(rows, key=lambda each: dims_of(each[0], axes) != [each[0].name]):
        if row.name not in group or row.kind != "text":  # averagings stand there once
            write_row(group, row, value, axes)
    _fill_facts(group, record, Part(), unsaid)
    for name, each in group.items():
        if isinstance(each, h5py.Dataset) and not each.is_scale:
            dims = [str(dim[0].name).rpartition("/")[2] for dim in each.dims if len(dim)]
            near = [known for dim in dims for known in PLACES.get(dim, ()) if known in group]
            if near and name not in near:  # as the CF conventions have it
                write_attribute(each, "coordinates", " ".join(near))


def _fill_facts(group: h5py.Group, record: Any, part: Part, unsaid: Sequence[str]) -> None:
    """What is no variable: attributes, the gas, references, records in groups of their own."""
    inner = parts_of(type(record), part)
    for each in dataclasses.fields(record):
        value = getattr(record, each.name)
        if each.name in unsaid or "variable" in each.metadata or (each.name in inner and not value):
            continue
        if each.name in inner:
            at = inner[each.name]
            if at.by == "groups" and isinstance(value, tuple):
                _fill_groups(group, at.stem, value)
            elif at.by == "groups":
                fill(group.create_group(at.stem), value)
            elif at.by == "":
                _fill_facts(group, value, at, ())
        elif isinstance(value, Fluid):
            write_variables(group, value, FLUID)
        elif each.type == REFERENCES:
            write_references(group, value)
        else:
            write_attribute(group, part.head + each.name, value)


def write_times(file: h5py.Group, record: Any) -> None:
    """The dimension ``time`` of the uniform samples of a record: a file states times, one of which tells no rate."""
    if record.samples < 2:
        raise ValueError(f"{record.name} has 1 sample; at least two times are needed in a file")
    times = record.start + np.arange(record.samples) / record.sampling_rate
    write_row(file, Variable("time", "s", ("time",)), times)


# For other programs


def to_xarray(record: Any) -> Any:
    """What ``xarray.open_dataset`` shows of the file, and the complex values."""
    import xarray

    with in_memory(record) as (buffer, _):
        found = xarray.load_dataset(buffer, engine="h5netcdf")
    for name, (real, imaginary) in complex_names(map(str, found)).items():
        text = found[real].attrs.get("long_name", name)
        text = text.replace("real part of the ", "").replace("resistance", "impedance")
        found[name] = (found[real] + 1j * found[imaginary]).assign_attrs(found[real].attrs | {"long_name": text})
    return found


@contextmanager
def in_memory(record: Any) -> Iterator[tuple[io.BytesIO, h5py.File]]:
    """The netCDF-4 file without a disk: what it would be as bytes, and open."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        fill(file, record)
        file.flush()
        yield buffer, file


def complex_names(names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """The two real variables of each complex one, by what they are together."""
    there, found = list(names), {}
    for real in there:
        for whole, (first, second) in {"impedance": PARTS["impedance"], "": ("_real", "_imaginary")}.items():
            if first in real and (other := real.replace(first, second)) in there:
                found[real.replace(first, whole)] = real, other
    return found
