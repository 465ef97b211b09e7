"""Variables and attributes of HDF5 files, from the rows that say how each variable stands in them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from torch import Tensor

from torchliner.checks import frequency_tensor
from torchliner.file_checks import naming
from torchliner.io.hdf5 import (
    is_there,
    place,
    read_json,
    read_number,
    read_si,
    read_texts,
    require_names,
    set_texts,
    text_attribute,
    to_json,
    write_index,
    write_texts,
    write_variable,
)
from torchliner.io.whole_file import HDF5, written_whole
from torchliner.records.declared import Variable
from torchliner.records.notes import Note

KEPT = ("f4", "f8", "i1", "i2", "i4", "i8")  # types that torch has
Table = Sequence[Variable]
Axes = Mapping[str, Sequence[str]]


def numbers(units: Mapping[str, str]) -> tuple[Variable, ...]:
    """Optional scalars, named as their fields, by unit."""
    return tuple(Variable(name, unit, optional=True) for name, unit in units.items())


def write_variables(group: h5py.Group, record: Any, table: Table, axes: Axes | None = None, **storage: Any) -> None:
    """Fields of a record that are not None, in the order of the table; arguments as for ``write_row``."""
    for row in table:
        value = getattr(record, row.field)
        if value is not None:
            write_row(group, row, value, axes, **storage)


def write_row(group: h5py.Group, row: Variable, value: Any, axes: Axes | None = None, **storage: Any) -> None:
    """One variable, or the two parts of a complex one; dimensions that the group lacks become indices.

    Args:
        group: a file or a group of one.
        row, value: the variable.
        axes: dimensions that stand behind one name of ``Variable.dims``.
        storage: of ``h5py.Group.create_dataset``, as ``compression``.
    """
    dims = dims_of(row, axes)
    if row.kind == "text":
        write_dimensions(group, row, dims, (len(value),))
        write_texts(group, row.names[0], value, dims[0])
        set_texts(group[row.names[0]], long_name=row.text)
        return
    values: Any = plain(value) if row.dims else float(value)
    if dims[-1:] == ["time"]:
        dims, values = ["time", *dims[:-1]], np.moveaxis(values, -1, 0)
    values = values if dims else np.reshape(values, ())
    write_dimensions(group, row, dims, np.shape(values))
    parts = (values,) if len(row.names) == 1 else (np.real(values), np.imag(values))
    for name, part, text in zip(row.names, parts, row.long_names, strict=True):
        dataset = write_variable(group, name, part, row.unit, dims, **storage)
        set_texts(dataset, **({"long_name": text} if text else {}), **row.attributes)


def dims_of(row: Variable, axes: Axes | None) -> list[str]:
    """Dimensions of a variable in its file."""
    return [dim for name in row.dims for dim in (axes or {}).get(name, (name,))]


def write_dimensions(group: h5py.Group, row: Variable, dims: Sequence[str], shape: Sequence[int]) -> None:
    """Those that a variable needs and the group lacks, as indices; one of another length is a ValueError."""
    for dim, count in zip(dims, shape, strict=True):
        if dim not in group and dim not in row.names:
            write_index(group, dim, count)
        elif dim in group and len(group[dim]) != count:
            raise ValueError(f"{row.field} has {count} values along {dim}, of which the record has {len(group[dim])}")


def plain(value: Any) -> Any:
    """A tensor or list as an array; booleans become 0 and 1."""
    values = value.detach().cpu().numpy() if isinstance(value, Tensor) else np.asarray(value)
    return values.astype(np.int8) if values.dtype == np.bool_ else values


def read_variables(group: h5py.Group, table: Table, path: str | Path) -> dict[str, Any]:
    """Fields of a record from the variables that are there, tensors or numbers, in SI units.

    Raises:
        ValueError: a variable is missing that is not optional, has a wrong unit, or holds no numbers. The message
            names FILE:/variable.
    """
    return {
        row.field: read_row(group, row, path)
        for row in table
        if not row.optional or any(is_there(group, name, path) for name in row.names)
    }


def read_row(group: h5py.Group, row: Variable, path: str | Path) -> Any:
    """One of them."""
    label = place(group, row.names[0], path)
    if row.kind == "text":
        return tuple(read_texts(group, row.names[0], path))
    if not row.dims:
        return read_number(group, row.names[0], row.unit, path)
    parts = [_tensor(read_si(group, name, row.unit, path, any_size=row.wide)) for name in row.names]
    if any(part.shape != parts[0].shape for part in parts):
        raise ValueError(f"{label} and its other part have shapes {[tuple(part.shape) for part in parts]}")
    value = parts[0] if len(parts) == 1 else torch.complex(*parts)
    if not row.wide and bool(torch.isinf(value).any()):
        raise ValueError(f"{label} or its other part is infinite; restore the file")
    if row.kind == "flag":
        if not bool(((value == 0) | (value == 1)).all()):
            raise ValueError(f"{label} holds other values than 0 and 1")
        value = value.to(torch.bool)
    if row.field == "frequency":
        with naming(label):
            value = frequency_tensor(value)
    return value


def _tensor(values: np.ndarray) -> Tensor:
    """float32, float64 and integers of this machine as they are, others of their kind widened."""
    kept = values.dtype.isnative and values.dtype.kind + str(values.dtype.itemsize) in KEPT
    wide = np.float64 if values.dtype.kind == "f" else np.int64
    return torch.from_numpy(values if kept else values.astype(wide))


def write_attribute(group: h5py.Group, key: str, value: Any) -> None:
    """A text as it is, all else as JSON."""
    if isinstance(value, tuple | list):
        value = [dataclasses.asdict(each) if isinstance(each, Note) else each for each in value]
    value = dict(value) if isinstance(value, Mapping) else value
    set_texts(group, **{key: value if isinstance(value, str) else to_json(value)})


def read_attribute(group: h5py.Group, key: str, path: str | Path, default: Any) -> Any:
    """What ``write_attribute`` wrote; ``default``, which says of what kind it is, where there is none."""
    if isinstance(default, str):
        return text_attribute(group, key) or default
    value = read_json(group, key, path, default)
    if not isinstance(value, tuple | list):
        return value
    with naming(f"{path}: attribute {key!r}"):  # other keys than those of a note
        return tuple(_entry(each, key) for each in value)


def _entry(value: Any, key: str) -> Any:
    """Of a list: a list as a tuple, an object among the notes as a note."""
    if isinstance(value, list):
        return tuple(value)
    return Note(**value) if key == "notes" and isinstance(value, dict) else value


@dataclass(frozen=True)
class FileKind:
    """What a kind of file says of itself, and the attributes it has beside its variables.

    Args:
        schema: of the file.
        noun: what it holds, for messages.
        attributes: fields of the record that are attributes of the file, in order, and their values where the file
            has none: texts as they are, all else as JSON.
        constants: attributes that every such file has.
    """

    schema: str
    noun: str
    attributes: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    constants: Mapping[str, str] = dataclasses.field(default_factory=lambda: {"Conventions": "CF-1.8"})

    def read_head(self, group: h5py.Group, path: str | Path) -> dict[str, Any]:
        """The attributes, as fields of a record."""
        return {key: read_attribute(group, key, path, default) for key, default in self.attributes.items()}

    def require(self, group: h5py.Group, path: str | Path) -> None:
        """Refuse a file, or a group of one, that holds something else, or hides names."""
        require_schema(group, path, self.schema)


@contextmanager
def new_file(path: str | Path, *others: str) -> Iterator[h5py.File]:
    """An HDF5 file that takes the place of an old one when it is whole; ``others``: endings that a message names.

    It is made in memory: where the disk is full, HDF5 itself crashes.
    """
    with written_whole(path, *HDF5, *others) as temporary:
        with h5py.File.in_memory() as file:
            set_texts(file, Conventions="CF-1.8")
            yield file
            file.flush()
            image = file.id.get_file_image()
        temporary.write_bytes(image)


def require_schema(group: h5py.Group, path: str | Path, *schemas: str) -> str:
    """The schema of a file or a group.

    Raises:
        ValueError: none of these; damage hides some of its names.
    """
    found = text_attribute(group, "schema")
    require_names(group, path)
    if found not in schemas:
        where = f"{path}" if group.name == "/" else f"{path}:{group.name}"
        raise ValueError(f"{where} has the schema {found!r}; {' or '.join(map(repr, schemas))} is needed")
    return str(found)
