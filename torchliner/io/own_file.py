"""Records of our own files, read back."""

from __future__ import annotations

import dataclasses
import functools
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import torch

from torchliner import records
from torchliner.file_checks import naming
from torchliner.fluid import Fluid
from torchliner.io.axes import FLUID, read_coordinate, read_references
from torchliner.io.hdf5 import get_group, is_there, open_file, place, read_texts, text_attribute
from torchliner.io.own_writer import REFERENCES
from torchliner.io.tables import read_attribute, read_variables, require_schema
from torchliner.records import ImpedanceLine, ImpedanceMap, Interval, PointImpedances
from torchliner.records.case import Case
from torchliner.records.declared import Part, parts_of, require_shapes, variables_of
from torchliner.records.drawn_impedance import DrawnImpedance

SCHEMAS = {kind.SCHEMA: kind for kind in vars(records).values() if hasattr(kind, "SCHEMA")}


def read_record(path: str | Path, *kinds: Any) -> Any:
    """A record of one of some kinds, as ``write`` made it.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: of another schema; a variable is missing, or has another shape, unit or size than it can have. The
            message names FILE:/variable.
    """
    with open_file(path) as file:
        return taken(file, path, *kinds)


def read_map(path: str | Path) -> ImpedanceMap:
    """Read a map written by ``ImpedanceMap.write`` as netCDF-4; errors as of ``read_record``."""
    found: ImpedanceMap = read_record(path, ImpedanceMap)
    return found


def read_line(path: str | Path) -> ImpedanceLine:
    """Read a line of stations written by ``ImpedanceLine.write`` as netCDF-4; errors as of ``read_record``."""
    found: ImpedanceLine = read_record(path, ImpedanceLine)
    return found


def read_points(path: str | Path) -> PointImpedances:
    """Read impedances at points written by their ``write`` as netCDF-4; errors as of ``read_record``."""
    found: PointImpedances = read_record(path, PointImpedances)
    return found


def read_wall(path: str | Path) -> tuple[Any, ...]:
    """Read the eductions that ``WallEduction.write`` or ``torchliner kt -o`` wrote, in order.

    Raises:
        ValueError: the microphones of an eduction are missing, elsewhere, or of other frequencies; a covariance that is
            not symmetric; as ``read_record``.
    """
    with open_file(path) as file:
        schema, stem = DrawnImpedance.GROUPS
        require_schema(file, path, schema)
        found = taken_groups(file, stem, path, records.WallEduction, records.FieldFit)
    for i, one in enumerate(found):
        places, known = set(one.x.tolist()), set() if one.line is None else set(one.line.x.tolist())
        if len(places) < len(one.x) or not places <= known or not torch.equal(one.frequency, one.line.frequency):
            raise ValueError(f"{path}:/{stem}_{i}: its microphones are missing, elsewhere, or of other frequencies")
        if one.covariance is not None and not torch.allclose(one.covariance, one.covariance.mT, equal_nan=True):
            raise ValueError(f"{path}:/{stem}_{i}: the covariance of R and X is not symmetric; restore the file")
    return found


def taken(group: h5py.Group, path: str | Path, *kinds: Any) -> Any:
    """``read_record`` from an open file, or a group of one."""
    kind = SCHEMAS[require_schema(group, path, *(kind.SCHEMA for kind in kinds))]
    known: dict[str, Any] = {}
    if group.name == "/" and issubclass(kind, Case):
        known["name"] = str(path)
    if kind is ImpedanceMap:  # a number of the columns stands where there is no place
        shape = group["mean_velocity"].shape if "mean_velocity" in group else ()
        places = {key: read_coordinate(group, key, shape, Path(path)) for key in "xz"}
        known |= {key: None if at is None else torch.from_numpy(at) for key, at in places.items()}
    made = take(group, kind, path, known, Part())
    with naming(str(path)):
        require_shapes(made, f"{path}:{group.name}")
    return made


def taken_groups(group: h5py.Group, stem: str, path: str | Path, *kinds: Any) -> tuple[Any, ...]:
    """Records that stand in groups ``stem_0``, ``stem_1`` and so on."""
    count = sum(name.startswith(f"{stem}_") for name in group)
    return tuple(taken(get_group(group, f"{stem}_{i}", path), path, *kinds) for i in range(count))


def take(group: h5py.Group, kind: Any, path: str | Path, known: Mapping[str, Any], part: Part) -> Any:
    """A record, or one that is a part of another, from what ``fill`` wrote; ``known``: fields that are known."""
    rows = [row.within(part) for row in variables_of(kind) if row.field not in known]
    found: dict[str, Any] = {**read_variables(group, rows, path), **known}
    hints, inner = _hints(kind), parts_of(kind, part)
    for each in dataclasses.fields(kind):
        hint = hints[each.name]
        if "variable" in each.metadata:
            if isinstance(found.get(each.name), float) and "int" in str(hint):
                found[each.name] = int(found[each.name])
            continue
        if each.name in known:
            continue
        if each.name in inner:
            value = _take_part(group, hint, path, inner[each.name])
        elif hint is Fluid:
            value = Fluid(**read_variables(group, FLUID, path))
        elif each.type == REFERENCES:
            value = read_references(group, path)
        else:
            value = _attribute(group, part.head + each.name, each, hint, path)
        if value is not None or each.default is dataclasses.MISSING:
            found[each.name] = value
    with naming(str(path)):
        made = kind(**found)
    if isinstance(made, Interval) and bool((torch.view_as_real(made.low) > torch.view_as_real(made.high)).any()):
        raise ValueError(f"{place(group, rows[0].names[0], path)} or its other part is above the upper bound")
    return made


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _class_of(hint: Any) -> Any:
    """The record within ``X | None``, ``Mapping[str, X]`` or ``tuple[X, ...]``."""
    inner = next((found for each in typing.get_args(hint) if (found := _class_of(each))), None)
    return inner or (hint if dataclasses.is_dataclass(hint) else None)


def _attribute(group: h5py.Group, key: str, field: Any, hint: Any, path: str | Path) -> Any:
    """What an attribute holds; None where it is not there and the field has a value without."""
    if text_attribute(group, key) is None:
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise ValueError(f"{path} lacks the attribute {key!r}: it is damaged")
        return None
    empty: Any = {str: "", tuple: (), Mapping: {}}.get(typing.get_origin(hint) or hint)
    return read_attribute(group, key, path, empty)


def _take_part(group: h5py.Group, hint: Any, path: str | Path, part: Part) -> Any:
    """A record, several, or None where nothing of it is there."""
    kind = _class_of(hint)
    if part.by == "groups":
        kinds = [each for each in SCHEMAS.values() if issubclass(each, kind)]
        if typing.get_origin(hint) is tuple:
            return taken_groups(group, part.stem, path, *kinds)
        return taken(get_group(group, part.stem, path), path, *kinds) if part.stem in group else None
    if part.by == "":
        return take(group, kind, path, {}, part) if _there(group, kind, part, path) else None
    averagings = read_texts(group, "averaging", path)
    if part.by == "averagings":
        whole = take(group, kind, path, {}, part)
        return {name: whole.map(lambda value, i=i: value[i]) for i, name in enumerate(averagings)}
    places = {name: part.named(name) for name in averagings}
    return {name: take(group, kind, path, {}, at) for name, at in places.items() if _there(group, kind, at, path)}


def _there(group: h5py.Group, kind: Any, part: Part, path: str | Path) -> bool:
    """Whether anything of a record is there: with a part of it alone the file is damaged."""
    rows = (row.within(part) for row in variables_of(kind) if row.kind != "text")
    return any(is_there(group, name, path) for row in rows for name in row.names) or any(
        _there(group, _class_of(_hints(kind)[name]), inner, path) for name, inner in parts_of(kind, part).items()
    )
