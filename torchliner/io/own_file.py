"""Records of our own files, and of files of others that follow their layout, read back."""

import dataclasses
import functools
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import h5py
import torch
from pydantic import TypeAdapter, ValidationError, create_model

from torchliner import records
from torchliner.checks import frequency_tensor, type_hints
from torchliner.file_checks import naming
from torchliner.fluid import Fluid
from torchliner.io.hdf5 import is_there, open_file, require_stored, text_attribute
from torchliner.io.own_writer import FLUID_UNITS, REFERENCES, dims_of
from torchliner.io.variables import Field, field_of, references_of
from torchliner.records import ImpedanceLine, ImpedanceMap, Interval, PointImpedances
from torchliner.records.case import Case
from torchliner.records.checked import require_shapes
from torchliner.records.declared import WHOLE, Part, Variable, facts_of, flat, parts_of, variables_of
from torchliner.records.wall_eduction import DrawnImpedance

KEPT = ("f4", "f8", "i1", "i2", "i4", "i8")  # types that torch has
Kind = TypeVar("Kind")
SCHEMAS = {kind.SCHEMA: kind for kind in vars(records).values() if hasattr(kind, "SCHEMA")}


def read_map(path: str | Path) -> ImpedanceMap:
    """Read a map written by ``ImpedanceMap.write`` as netCDF-4.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: of another schema; a variable is missing, or has another shape, unit or size than it can have. The
            message names FILE:/variable.
    """
    return _read(path, ImpedanceMap)


def read_line(path: str | Path) -> ImpedanceLine:
    """Read a line of stations written by ``ImpedanceLine.write`` as netCDF-4; errors as of ``read_map``."""
    return _read(path, ImpedanceLine)


def read_points(path: str | Path) -> PointImpedances:
    """Read impedances at points written by their ``write`` as netCDF-4; errors as of ``read_map``."""
    return _read(path, PointImpedances)


def _read(path: str | Path, kind: type[Kind]) -> Kind:
    with open_file(path) as file:
        found: Kind = taken(file, path, kind)
    return found


def read_wall(path: str | Path) -> tuple[Any, ...]:
    """Read the eductions that ``WallEduction.write`` or ``torchliner kt -o`` wrote, in order; errors as of
    ``read_map``, and where the microphones of an eduction are missing, elsewhere, or of other frequencies."""
    schema, stem = DrawnImpedance.GROUPS
    with open_file(path) as file:
        require_schema(file, path, schema)
        found = tuple(taken(each, path, records.WallEduction, records.FieldFit) for each in groups_of(file, stem, path))
    for i, one in enumerate(found):
        line = one.line
        if line is None or not (torch.equal(one.x, line.x) and torch.equal(one.frequency, line.frequency)):
            raise ValueError(f"{path}:/{stem}_{i}: its microphones are missing, elsewhere, or of other frequencies")
    return found


# Records


def require_schema(group: h5py.Group, path: str | Path, *schemas: str) -> str:
    """The schema of a file or a group. A ValueError where it is none of these, and where damage hides some of its
    names: optional variables would be missed in silence."""
    found, lost = text_attribute(group, "schema"), [name for name in group if group.get(name, getlink=True) is None]
    if lost or len(set(group)) < len(group):
        raise ValueError(f"{path} is damaged: of the names that {group.name} lists {lost or 'some'} lead nowhere")
    if found not in schemas:
        where = f"{path}" if group.name == "/" else f"{path}:{group.name}"
        raise ValueError(f"{where} has the schema {found!r}; {' or '.join(map(repr, schemas))} is needed")
    return str(found)


def groups_of(group: h5py.Group, stem: str, path: str | Path) -> list[h5py.Group]:
    """The groups ``stem_0``, ``stem_1`` and so on of a file or group; a ValueError where one of them is missing."""
    names = [f"{stem}_{i}" for i in range(sum(name.startswith(f"{stem}_") for name in group))]
    for name in names:
        if not is_there(group, name, path) or not isinstance(group[name], h5py.Group):
            raise ValueError(f"{path}:{group.name.rstrip('/')}/{name} is no group; there are: {', '.join(group)}")
    return [group[name] for name in names]


def taken(group: h5py.Group, path: str | Path, *kinds: Any) -> Any:
    """A record of one of some kinds, as ``write`` made it, from an open file, or a group of one."""
    kind = SCHEMAS[require_schema(group, path, *(kind.SCHEMA for kind in kinds))]
    known = {"name": str(path)} if group.name == "/" and issubclass(kind, Case) else {}
    made = take(group, kind, path, known)
    axes = getattr(made, "axes", {})  # so that places are as many as the values along them
    rows = [
        (dataclasses.replace(row, dims=tuple(dims_of(row.dims, axes))), value)
        for row, value in flat(made, derived=False)
    ]
    with naming(path):
        require_shapes(rows, f"{path}:{group.name}")
    return made


def take(group: h5py.Group, kind: Any, path: str | Path, known: Mapping[str, Any], part: Part = WHOLE) -> Any:
    """A record, or one that is a ``part`` of another, from what ``fill`` wrote; fields that are ``known`` are not
    read."""
    found, hints = dict(known), type_hints(kind)
    for row in (row for row in variables_of(kind) if row.field not in known):
        own = part.row(row)
        if not row.optional or any(_has(group, name, path) for name in own.names):
            value = read_row(group, own, path)
            whole = isinstance(value, float) and "int" in str(hints[row.field])
            found[row.field] = int(value) if whole else value
    for each in dataclasses.fields(kind):
        hint, value = hints[each.name], None
        if "variable" in each.metadata or each.name in known or not each.init:
            continue
        if each.name in parts_of(kind):
            value = _take_part(group, each.name, hint, path, part.part(parts_of(kind)[each.name]))
        elif hint is Fluid:
            gas = [Variable(name, unit) for name, unit in FLUID_UNITS.items() if is_there(group, name, path)]
            value = Fluid(**{row.field: read_row(group, row, path) for row in gas})
        elif hint == REFERENCES:
            value = references_of(
                {f"/{key}": get_field(group, key, path) for key in group if key.startswith("reference_")}
            )
        else:
            value = read_attribute(group, each.name, hint, path)
        needed = each.default is each.default_factory is dataclasses.MISSING
        if value is None and needed and type(None) not in typing.get_args(hint):
            raise ValueError(f"{path} lacks {part.stem}{each.name}: it is damaged")
        if value is not None or needed:
            found[each.name] = value
    with naming(path):
        made = kind(**found)
    if isinstance(made, Interval) and bool((torch.view_as_real(made.low) > torch.view_as_real(made.high)).any()):
        low = part.row(variables_of(kind)[0]).names[0]
        raise ValueError(f"{path}:{group.name.rstrip('/')}/{low} or its other part is above the upper bound")
    return made


def _class_of(hint: Any) -> Any:
    """The record within ``X | None``, ``Mapping[str, X]`` or ``tuple[X, ...]``."""
    inner = next((found for each in typing.get_args(hint) if (found := _class_of(each))), None)
    return inner or (hint if dataclasses.is_dataclass(hint) else None)


def _take_part(group: h5py.Group, name: str, hint: Any, path: str | Path, part: Part) -> Any:
    """A record, several, or None where nothing of it is there: with a part of it alone the file is damaged."""
    kind = _class_of(hint)
    if part.by == "groups":
        kinds = [each for each in SCHEMAS.values() if issubclass(each, kind)]
        if typing.get_origin(hint) is tuple:
            return tuple(taken(each, path, *kinds) for each in groups_of(group, part.stem, path))
        return taken(group[part.stem], path, *kinds) if is_there(group, part.stem, path) else None
    if part.by:
        averagings = read_row(group, Variable("averaging", kind="text", dims=("averaging",)), path)
        if part.by == "averagings":
            whole = take(group, kind, path, {}, part)
            return {key: whole.map(lambda value, i=i: value[i]) for i, key in enumerate(averagings)}
        places = {key: WHOLE.part(part, key) for key in averagings}
        return {key: take(group, kind, path, {}, at) for key, at in places.items() if _there(group, kind, at, path)}
    if not _there(group, kind, part, path):
        return None
    hints: dict[str, Any] = {key: (type_hints(kind)[key], ...) for key in facts_of(kind)}
    said = read_attribute(group, name, create_model(name, **hints), path) if hints else {}
    if said is None:
        raise ValueError(f"{path} lacks the attribute {name!r}: it is damaged")
    return take(group, kind, path, dict(said), part)


def _there(group: h5py.Group, kind: Any, part: Part, path: str | Path) -> bool:
    """Whether anything of a record is there."""
    rows = (part.row(row) for row in variables_of(kind) if row.kind != "text")
    return any(_has(group, name, path) for row in rows for name in row.names) or any(
        _there(group, _class_of(type_hints(kind)[name]), part.part(own), path) for name, own in parts_of(kind).items()
    )


# Variables and attributes


def _has(group: h5py.Group, key: str, path: str | Path) -> bool:
    """Whether there is such a variable, not the length of a dimension alone."""
    return is_there(group, key, path) and not get_field(group, key, path).bare


def get_field(group: h5py.Group, key: str, path: str | Path) -> Field:
    """A variable by name; a ValueError lists what is there instead."""
    if not is_there(group, key, path) or not isinstance(group[key], h5py.Dataset):
        where, held = "the file" if group.name == "/" else "the group", ", ".join(sorted(group)) or "nothing"
        raise ValueError(f"{path}:{group.name.rstrip('/')}/{key} is missing; {where} holds: {held}")
    return field_of(group, key, path)


def read_row(group: h5py.Group, row: Variable, path: str | Path) -> Any:
    """A number, a tensor in an SI unit, or a tuple of texts; a ValueError names FILE:/variable where it is missing, has
    no unit of this quantity, or holds what it cannot."""
    fields = [get_field(group, name, path) for name in row.names]
    label = fields[0].label
    if row.kind == "text":
        texts = fields[0].array
        require_stored(texts, label, path)
        return tuple(str(text) for text in texts.asstr(errors="replace")[()])
    if not row.dims:
        return fields[0].number(row.unit)
    parts = []
    for each in fields:
        values = each.si(row.unit, wide=row.wide)
        kept = values.dtype.isnative and values.dtype.kind + str(values.dtype.itemsize) in KEPT
        parts.append(torch.from_numpy(values if kept else values.astype("f8" if values.dtype.kind == "f" else "i8")))
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


def read_attribute(owner: Any, key: str, hint: Any, path: str | Path) -> Any:
    """A text as it is, all else from JSON, as ``hint`` says; None where there is none."""
    text = text_attribute(owner, key)
    if text is None or hint is str:
        return text
    try:
        return _adapter(hint).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        where = "".join(f"[{each!r}]" for each in first["loc"])
        raise ValueError(f"{path}: attribute {key!r}{where} is {text[:40]!r}: {first['msg']}; repair it") from error


_adapter = functools.cache(TypeAdapter)
