"""Fields of a record to a file and back, by what each says of itself (``records.declared``)."""

from __future__ import annotations

import dataclasses
import functools
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

from torchliner.file_checks import naming
from torchliner.fluid import Fluid
from torchliner.io.axes import FLUID
from torchliner.io.hdf5 import get_group, is_there, place, read_references, read_texts, text_attribute, write_references
from torchliner.io.tables import (
    Axes,
    Sizes,
    plain,
    read_attribute,
    read_variables,
    write_attribute,
    write_row,
    write_variables,
)
from torchliner.names import resolve
from torchliner.records import Educed, Interval
from torchliner.records.declared import Part, Variable, variables_of

PLACES = {  # coordinates by dimension, of what else stands along it
    "probe": ("x", "z"),
    "cell": ("cell_x", "cell_z"),
    "point": ("point_x", "point_z"),
    "station": ("x", "y", "z", "station_name"),
}
SAME = 1e-6  # relative: a value that is stored, and what follows from the others
ROOT = Part()
Known = Mapping[str, Any]


# Writing


def probe_axes(shape: tuple[int, ...], line: bool = False) -> dict[str, tuple[str, ...]]:
    """Dimensions of probes: z and x of a surface, else ``probe``, or x along a ``line``; none of a single probe."""
    if len(shape) == 2:
        return {"probes": ("z", "x"), "columns": ("x",), "rows": ("z",)}
    return dict.fromkeys(("probes", "columns", "rows"), () if not shape else ("x",) if line else ("probe",))


def write_times(file: h5py.Group, record: Any) -> None:
    """The dimension ``time`` of the uniform samples of a record: a file states times, one of which tells no rate."""
    if record.samples < 2:
        raise ValueError(f"{record.name} has 1 sample; at least two times are needed in a file")
    times = record.start + np.arange(record.samples) / record.sampling_rate
    write_row(file, Variable("time", "s", ("time",)), times)


def line_axes(record: Any) -> dict[str, tuple[str, ...]]:
    """``probe_axes`` of a record, whose probes along x alone are a line where they stand in its order."""
    x = record.x
    line = x is not None and record.z is None and bool((x.diff() > 0).all())
    return probe_axes(record.probe_shape, line)


def fill(
    group: h5py.Group, record: Any, part: Part = ROOT, axes: Axes | None = None, unsaid: Sequence[str] = ()
) -> None:
    """Variables, parts and attributes of a record; coordinates first, then what stands along them."""
    rows = [row.within(part) for row in (*variables_of(type(record)), *getattr(record, "DERIVED", ()))]
    axes = axes or {}
    for row in sorted(
        rows, key=lambda row: [dim for name in row.dims for dim in axes.get(name, (name,))] != [row.name]
    ):
        value = getattr(record, row.field)
        if value is not None and row.field not in unsaid and not (row.kind == "text" and row.name in group):
            write_row(group, row, value, axes)
    for each in dataclasses.fields(record):
        value = getattr(record, each.name)
        if each.name in unsaid or "variable" in each.metadata:
            continue
        if "part" in each.metadata:
            if value is not None:
                _fill_part(group, value, each.metadata["part"].within(part, each.name), axes)
        elif isinstance(value, Fluid):
            write_variables(group, value, FLUID)
        elif each.type == REFERENCES:
            write_references(group, value)
        else:
            write_attribute(group, part.head + each.name, value)


REFERENCES = "Mapping[str, complex]"  # a field of this type is of impedances by name


def _fill_part(group: h5py.Group, value: Any, part: Part, axes: Axes) -> None:
    if part.by == "averagings":
        fill(group, stacked([*value.values()]), part, axes)
    elif part.by == "names":
        for name, one in value.items():
            fill(group, one, _named(part, name), axes)
    elif part.by == "groups":
        for i, one in enumerate(value if isinstance(value, tuple) else (value,)):
            inner = group.create_group(f"{part.stem}{i}" if isinstance(value, tuple) else part.stem)
            resolve(one.FILE).fill(inner, one)
    else:
        fill(group, value, part, axes)


def _named(part: Part, name: str) -> Part:
    """As measured, the averaging ``admittance`` needs no name."""
    stem, text = ("", "") if name == "admittance" else (f"{name.replace('-', '_')}_", f", averaging {name}")
    return dataclasses.replace(part, stem=stem + part.stem, text=part.text + text)


def stacked(parts: Sequence[Educed]) -> Educed:
    """Several averagings in one, along a new first axis; all or none have intervals."""
    intervals = [each.interval for each in parts if each.interval is not None]
    if len(intervals) not in (0, len(parts)):
        raise ValueError(
            f"{len(intervals)} of {len(parts)} averagings have intervals; all or none are needed in a file"
        )
    bounds = [torch.stack(each) for each in zip(*(vars(one).values() for one in intervals), strict=True)]
    return Educed(torch.stack([each.reflection for each in parts]), Interval(*bounds) if intervals else None)


def attach_places(group: h5py.Group) -> None:
    """To each variable the names of the coordinates of its places, as the CF conventions have it."""
    for name, each in group.items():
        if isinstance(each, h5py.Dataset) and not each.is_scale:
            dims = [str(dim[0].name).rpartition("/")[2] for dim in each.dims if len(dim)]
            near = [known for dim in dims for known in PLACES.get(dim, ()) if known in group]
            if near and name not in near:
                write_attribute(each, "coordinates", " ".join(near))


# Reading


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _class_of(hint: Any) -> Any:
    """The record within ``X | None``, ``Mapping[str, X]`` or ``tuple[X, ...]``."""
    return next(
        (found for each in typing.get_args(hint) if (found := _class_of(each))),
        hint if dataclasses.is_dataclass(hint) else None,
    )


def take(group: h5py.Group, kind: Any, path: str | Path, sizes: Sizes, known: Known, part: Part = ROOT) -> Any:
    """A record from what ``fill`` wrote.

    Args:
        group, path: where it stands.
        kind: its class.
        sizes: lengths of dimensions, as for ``read_variables``.
        known: fields that are known already.
        part: of the record that it belongs to.
    """
    rows = [row.within(part) for row in variables_of(kind) if row.field not in known]
    found = {**read_variables(group, rows, path, sizes=sizes), **known}
    for row in rows:
        value = found.get(row.field)
        if isinstance(value, torch.Tensor) and not row.wide and bool(torch.isinf(value).any()):
            raise ValueError(f"{place(group, row.names[0], path)} or its other part is infinite; restore the file")
        if isinstance(value, float) and "int" in str(_hints(kind)[row.field]):
            found[row.field] = int(value)
    for each in dataclasses.fields(kind):
        hint = _hints(kind)[each.name]
        if each.name in known or "variable" in each.metadata:
            continue
        if "part" in each.metadata:
            value = _take_part(group, _class_of(hint), hint, path, sizes, each.metadata["part"].within(part, each.name))
        elif hint is Fluid:
            with naming(str(path)):
                value = Fluid(**read_variables(group, FLUID, path))
        elif each.type == REFERENCES:
            value = read_references(group, path)
        else:
            value = _attribute(group, part.head + each.name, hint, path)
        if value is not None or each.default is dataclasses.MISSING:
            found[each.name] = value
    with naming(str(path)):
        made = kind(**found)
    if isinstance(made, Interval):
        _require_order(group, made, rows, path)
    require_same(group, made, [row.within(part) for row in getattr(made, "DERIVED", ())], path)
    return made


def _attribute(group: h5py.Group, key: str, hint: Any, path: str | Path) -> Any:
    origin = typing.get_origin(hint) or hint
    empty: Any = (
        ""
        if origin is str
        else ()
        if origin is tuple
        else {}
        if isinstance(origin, type) and issubclass(origin, Mapping)
        else None
    )
    if empty is None and text_attribute(group, key) is None:
        raise ValueError(f"{path} lacks the attribute {key!r}: it is damaged")
    value = read_attribute(group, key, path, empty)
    if hint is float and not isinstance(value, int | float):
        raise ValueError(f"{path}: attribute {key!r} is {value!r}; a number is needed")
    return value


def _take_part(group: h5py.Group, kind: Any, hint: Any, path: str | Path, sizes: Sizes, part: Part) -> Any:
    """A record, several, or None where nothing of it is there."""
    if part.by == "groups":
        return _take_groups(group, kind, hint, path, part)
    if part.by == "":
        return take(group, kind, path, sizes, {}, part) if _known(group, kind, part, path) else None
    averagings = read_texts(group, "averaging", path)
    sizes["averaging"] = (len(averagings),)
    if part.by == "averagings":
        whole = take(group, kind, path, sizes, {}, part)
        return {name: whole.map(lambda value, i=i: value[i]) for i, name in enumerate(averagings)}
    places = {name: _named(part, name) for name in averagings}
    return {
        name: take(group, kind, path, sizes, {}, at) for name, at in places.items() if _known(group, kind, at, path)
    }


def _take_groups(group: h5py.Group, kind: Any, hint: Any, path: str | Path, part: Part) -> Any:
    file = resolve(kind.FILE)
    if typing.get_origin(hint) is not tuple:
        return file.taken(get_group(group, part.stem, path), path)
    found: list[Any] = []
    while is_there(group, name := f"{part.stem}{len(found)}", path):
        found.append(file.taken(get_group(group, name, path), path))
    return tuple(found)


def _known(group: h5py.Group, kind: Any, part: Part, path: str | Path) -> bool:
    """Whether anything of a record is there: with a part of it alone the file is damaged."""
    rows = (row.within(part) for row in variables_of(kind) if row.kind != "text")
    parts = {each.name: each.metadata["part"] for each in dataclasses.fields(kind) if "part" in each.metadata}
    return any(is_there(group, name, path) for row in rows for name in row.names) or any(
        _known(group, _class_of(_hints(kind)[name]), inner.within(part, name), path) for name, inner in parts.items()
    )


def _require_order(group: h5py.Group, found: Interval, rows: Sequence[Variable], path: str | Path) -> None:
    low, high = (torch.view_as_real(each) for each in (found.low, found.high))
    if bool((low > high).any()):
        raise ValueError(
            f"{place(group, rows[0].names[0], path)} or its other part is above the upper bound; the file "
            "is damaged: restore it"
        )


def require_same(group: h5py.Group, record: Any, rows: Sequence[Variable], path: str | Path) -> None:
    """Refuse a file in which what is written for others to see is not what follows from the record."""
    for row in rows:
        value = getattr(record, row.field)
        if row.kind == "text" or value is None:
            continue
        values = np.asarray(plain(value))
        parts = (values,) if len(row.names) == 1 else (values.real, values.imag)
        for name, wanted in zip(row.names, parts, strict=True):
            stored = group[name][()] if is_there(group, name, path) else wanted
            if stored.shape != wanted.shape or not np.allclose(stored, wanted, rtol=SAME, atol=0, equal_nan=True):
                raise ValueError(
                    f"{place(group, name, path)} is not what follows from the other variables; the file is damaged: "
                    "restore it"
                )
