"""One writer and one reader of HDF5 files, from a table of the variables of each kind of file."""

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
from torchliner.fluid import Fluid
from torchliner.io.hdf5 import (
    is_there,
    place,
    read_json,
    read_number,
    read_si,
    require_names,
    text_attribute,
    to_json,
    write_variable,
)
from torchliner.io.whole_file import HDF5, written_whole
from torchliner.records.notes import Note

COORDINATES = {  # by dimension, of what is written after them
    "probe": ("x", "z"), "cell": ("cell_x", "cell_z"), "point": ("point_x", "point_z"),
    "station": ("x", "y", "z", "station_name"),
}  # fmt: skip
SEVERAL = ("probes", "along", "draws")  # dimensions that may stand for several axes or none
Sizes = dict[str, tuple[int, ...]]  # of dimensions by name
IMPEDANCE, CARTESIAN = ("resistance", "reactance"), ("real", "imaginary")


@dataclass(frozen=True)
class Variable:
    """One row of a table: a field of a record and how it stands in the file.

    Args:
        field: of the record.
        names: of the variable; two for a complex field, its real and its imaginary part.
        unit: SI, of record and file; the reader converts other units of the same quantity.
        dims: names of the dimensions, () for one number. "time" is first in files and last in
            records. A key of the writer's ``axes`` stands for the dimensions that it leads to.
        optional: may be None in the record and absent from the file.
        derived: follows from other fields: written, not read.
        flag: True and False in the record, 1 and 0 in the file, as netCDF has no booleans.
        any_size: a sum, or an end of an interval, which may be far from all that is measured.
        attributes: beside ``units``; "{part}" becomes the part of an impedance, "{words}" those
            given to the writer.
    """

    field: str
    names: tuple[str, ...]
    unit: str = "1"
    dims: tuple[str, ...] = ()
    optional: bool = False
    derived: bool = False
    flag: bool = False
    any_size: bool = False
    attributes: Mapping[str, str] = dataclasses.field(default_factory=dict)


Table = Sequence[Variable]


def real(name: str, unit: str, dims: Sequence[str], **about: Any) -> Variable:
    """A real variable, named as its field or as ``about`` says."""
    return Variable(about.pop("field", name), (name,), unit, tuple(dims), **about)


def numbers(units: Mapping[str, str]) -> tuple[Variable, ...]:
    """Optional scalars, named as their fields, by unit."""
    return tuple(Variable(name, (name,), unit, optional=True) for name, unit in units.items())


def impedance(field: str, stem: str, dims: Sequence[str], **about: Any) -> Variable:
    """A complex field as ``<stem>resistance`` and ``<stem>reactance``; "{}" marks their place."""
    place = stem if "{}" in stem else stem + "{}"
    return Variable(field, tuple(map(place.format, IMPEDANCE)), "1", tuple(dims), **about)


def cartesian(field: str, stem: str, dims: Sequence[str], **about: Any) -> Variable:
    """A complex field as ``<stem>_real`` and ``<stem>_imaginary``."""
    names = tuple(f"{stem}_{part}" for part in CARTESIAN)
    return Variable(field, names, about.pop("unit", "1"), tuple(dims), **about)


def write_variables(
    group: h5py.Group, record: Any, table: Table, axes: Mapping[str, Sequence[str]] | None = None,
    words: str = "", **storage: Any,
) -> None:  # fmt: skip
    """Fields of a record that are not None, in the order of the table.

    Args:
        group: a file or a group of one, with the dimensions that are used.
        record: whose attributes the fields are.
        table: of the variables.
        axes: dimensions that stand behind one name of ``Variable.dims``.
        words: see ``Variable.attributes``.
        storage: of ``h5py.Group.create_dataset``, as ``compression``.
    """
    for row in table:
        value = getattr(record, row.field)
        if value is None and row.optional:
            continue
        dims = [dim for name in row.dims for dim in (axes or {}).get(name, (name,))]
        values: Any = plain(value) if row.dims else float(value)
        if dims[:1] == ["time"]:
            values = np.moveaxis(values, -1, 0)
        parts = (values,) if len(row.names) == 1 else (values.real, values.imag)
        for name, part in zip(row.names, parts, strict=True):
            label = next((w for w in (*IMPEDANCE, *CARTESIAN) if w in name), "")
            write_variable(group, name, part, row.unit, dims, **storage)
            texts = {k: v.format(part=label, words=words) for k, v in row.attributes.items()}
            near = [each for dim in dims for each in COORDINATES.get(dim, ()) if each in group]
            if near and name not in near:
                texts["coordinates"] = " ".join(near)
            group[name].attrs.update(texts)


def plain(value: Any) -> Any:
    """A tensor or list as an array; booleans become 0 and 1."""
    values = value.detach().cpu().numpy() if isinstance(value, Tensor) else np.asarray(value)
    return values.astype(np.int8) if values.dtype == np.bool_ else values


def read_variables(
    group: h5py.Group, table: Table, path: str | Path, part: slice | None = None,
    sizes: Sizes | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Fields of a record from the variables that are there, tensors or numbers, in SI units.

    Args:
        group, table: as for ``write_variables``.
        path: for messages.
        part: of the first axis; None for all.
        sizes: lengths of the dimensions that are known, to which those found are added.
    Raises:
        ValueError: a variable is missing that is not optional, has a wrong unit, holds no
            numbers, or has other dimensions than the table says, or another length along one than
            the variables before it. The message names FILE:/variable.
    """
    found: dict[str, Any] = {}
    sizes = {} if sizes is None else sizes
    for row in table:
        if row.derived or (row.optional and not is_there(group, row.names[0], path)):
            continue
        if not row.dims:
            found[row.field] = read_number(group, row.names[0], row.unit, path)
            continue
        parts = [_tensor(read_si(group, name, row.unit, path, part, any_size=row.any_size))
                 for name in row.names]  # fmt: skip
        for name, one in zip(row.names, parts, strict=True):
            _require_shape(tuple(one.shape), row.dims, sizes, place(group, name, path))
        value = parts[0] if len(parts) == 1 else torch.complex(*parts)
        if row.flag:
            if not bool(((value == 0) | (value == 1)).all()):
                raise ValueError(f"{place(group, row.names[0], path)} holds other values than 0 "
                                 "and 1")  # fmt: skip
            value = value.to(torch.bool)
        if row.field == "frequency":
            with naming(place(group, row.names[0], path)):
                value = frequency_tensor(value)
        found[row.field] = value
    return found


def _require_shape(shape: tuple[int, ...], dims: Sequence[str], sizes: Sizes, label: str) -> None:
    """Each dimension has one length in all variables; ``sizes`` collects them.

    Raises:
        ValueError: another number of axes, or another length than a variable before it.
    """
    own = sum(dim not in SEVERAL for dim in dims)
    count = len(shape) - own if own < len(dims) else 0
    if count < 0 or len(shape) != own + count:
        raise ValueError(f"{label} has shape {shape}; ({', '.join(dims)}) is needed")
    at = 0
    for dim in dims:
        length = shape[at : at + (count if dim in SEVERAL else 1)]
        at += len(length)
        if sizes.setdefault(dim, length) != length:
            raise ValueError(
                f"{label} has shape {shape}, ({', '.join(dims)}); {dim} is {sizes[dim]} elsewhere in the file"
            )


def _tensor(values: np.ndarray) -> Tensor:
    """float32, float64 and integers of this machine as they are, others of their kind widened."""
    kept = values.dtype.isnative and values.dtype.kind + str(values.dtype.itemsize) in KEPT
    wide = np.float64 if values.dtype.kind == "f" else np.int64
    return torch.from_numpy(values if kept else values.astype(wide))


def described(table: Table, texts: Mapping[str, str]) -> tuple[Variable, ...]:
    """The rows, each with what it is: ``long_name`` by field, "{part}" as in ``attributes``."""
    return tuple(
        dataclasses.replace(row, attributes={"long_name": texts[row.field], **row.attributes})
        if row.field in texts else row
        for row in table
    )  # fmt: skip


def _from_json(value: Any, key: str) -> Any:
    """An entry of a list: a list as a tuple, an object among the notes as a note."""
    if isinstance(value, list):
        return tuple(value)
    return Note(**value) if key == "notes" and isinstance(value, dict) else value


KEPT = ("f4", "f8", "i1", "i2", "i4", "i8")


@dataclass(frozen=True)
class FileKind:
    """What a kind of file says of itself, and the attributes it has beside its variables.

    Args:
        schema: of the file.
        noun: what it holds, for messages.
        attributes: fields of the record that are attributes of the file, in order, and their
            values where the file has none: texts as they are, all else as JSON.
        constants: attributes that every such file has.
        others: endings that another writer of the record takes, for messages.
    """

    schema: str
    noun: str
    attributes: Mapping[str, Any]
    constants: tuple[tuple[str, str], ...] = (("Conventions", "CF-1.8"),)
    others: tuple[str, ...] = ()

    @contextmanager
    def created(self, path: str | Path, record: Any) -> Iterator[h5py.File]:
        """A new file with its attributes; an old one is replaced when the new one is whole."""
        endings = (*HDF5, *self.others)
        with written_whole(path, *endings) as temporary, h5py.File(temporary, "w") as file:
            for key, text in self.constants:
                file.attrs[key] = text
            self.write_head(file, record)
            yield file

    def write_head(self, group: h5py.Group, record: Any) -> None:
        """Schema and attributes."""
        group.attrs["schema"] = self.schema
        for key in self.attributes:
            value = getattr(record, key)
            value = dataclasses.asdict(value) if isinstance(value, Fluid) else value
            value = dict(value) if isinstance(value, Mapping) else value
            value = [vars(v) if isinstance(v, Note) else v for v in value] if key == "notes" else value
            group.attrs[key] = value if isinstance(value, str) else to_json(value)

    def read_head(self, group: h5py.Group, path: str | Path) -> dict[str, Any]:
        """The attributes, as fields of a record."""
        found: dict[str, Any] = {}
        for key, default in self.attributes.items():
            if isinstance(default, str):
                found[key] = text_attribute(group, key) or default
                continue
            value = read_json(group, key, path, default)
            if isinstance(default, tuple):  # JSON has lists alone
                with naming(f"{path}: attribute {key!r}"):  # other keys than those of a note
                    value = tuple(_from_json(v, key) for v in value)
            elif isinstance(default, Fluid) and value is not default:
                with naming(f"{path}: attribute {key!r}"):  # other keys, or none of numbers
                    value = Fluid(**value)
            found[key] = value
        return found

    def require(self, group: h5py.Group, path: str | Path) -> None:
        """Refuse a file, or a group of one, that holds something else.

        Raises:
            ValueError: it does; as ``require_names``.
        """
        found = text_attribute(group, "schema")
        require_names(group, path)
        if found != self.schema:
            where = f"{path}" if group.name == "/" else f"{path}:{group.name}"
            raise ValueError(f"{where} is no {self.noun}: its schema is {found!r}, not {self.schema!r}")
