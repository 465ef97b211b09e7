"""What the axes of a variable of a netCDF-like file are, and where its probes stand.

CF conventions 1.8: dimension scales, ``axis``, ``standard_name``, coordinate variables; in our own
schema the names alone say it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py

from torchliner.file_checks import Unwritten
from torchliner.io.axes import NO_VARIABLE, axis_names, find_time_axis, read_coordinate
from torchliner.io.hdf5 import is_there, place, text_attribute
from torchliner.io.plane_format import PlaneRequest

UPWARD = r"\b(up|down)ward_(air|sea_water)_vel"
DIRECTIONS = {"x": r"\bstreamwise\b|\bx_?1\b", "z": r"\bspanwise\b|\bx_?3\b", "y": r"\bx_?2\b"}
HEIGHT = r"(?i)height|altitude|elevation|depth|lev(el)?s?|wall_?(distance|normal)|y_?plus"
COMPONENT = r"(?i)comp(onent)?s?|vec(tor)?s?|uvw|directions?|dims?|nv|d3|[a-z]*velocity_?components?"
ROLE = r"(?i)[ni]?([xyz])(_?(c|coords?|coordinates?|axis|dim|centers?|pos|positions?))?"


@dataclass(frozen=True)
class Axes:
    """How the velocity lies in its dataset.

    Args:
        order: axes of the dataset, time first, then z and x, or probe; those left out have size 1.
        shape: of the probes, (z, x), (probe,) or ().
        time: times; None where the file has none.
        scales: dimension scales of the probe axes, None where there are none.
        across: coordinate that plays z: "z", or "y" where z is normal to the wall.
    """

    order: tuple[int, ...]
    shape: tuple[int, ...]
    time: h5py.Dataset | None
    scales: tuple[h5py.Dataset | None, ...]
    across: str


def is_time(scale: h5py.Dataset) -> bool:
    """Whether a dimension is time, by its name or by what it says."""
    return scale.name is not None and (
        scale.name.split("/")[-1].lower() in ("time", "t", "times")
        or text_attribute(scale, "standard_name") == "time"
        or text_attribute(scale, "axis") == "T"
        or " since " in (text_attribute(scale, "units") or "")
    )


def _is_bare(scale: h5py.Dataset) -> bool:
    """Whether a scale stands for a length alone."""
    name = text_attribute(scale, "NAME") or ""
    return name.startswith(NO_VARIABLE) and "units" not in scale.attrs


def says(dataset: h5py.Dataset, key: str, pattern: str) -> bool:
    """Whether a name of a dataset, short, long or standard, fits."""
    names = [key.split("/")[-1], *(text_attribute(dataset, each) or ""
             for each in ("standard_name", "long_name"))]  # fmt: skip
    return any(re.search(pattern, name, re.IGNORECASE) for name in names)


def find_axes(group: h5py.Group, key: str, request: PlaneRequest, path: Path) -> Axes:
    """Roles of the axes, from the user, the dimension scales or the lengths.

    Raises:
        ValueError: they cannot be told, or more than time and two others are longer than 1.
    """
    dataset, label = group[key], place(group, key, path)
    shape = dataset.shape or ()
    upward = says(dataset, key, UPWARD) or (
        (request.normal or "").strip("-") == "z")  # fmt: skip
    scales = [dim[0] if len(dim) else None for dim in dataset.dims]
    if request.axes is not None:
        roles = [str(axis) for axis in request.axes]
        if len(roles) != len(shape):
            raise ValueError(f"{label} has shape {shape}, but {len(roles)} axes are named: {','.join(roles)}")
    else:
        names = axis_names(dataset, label)
        roles = [_role(*each) for each in zip(names, scales, strict=True)]
    time = _times(scales, group, path)
    samples = None if time is None else time.shape[0]
    if roles.count("time") != 1:
        if samples is None:
            raise ValueError(
                f"{label}: none of its axes is time; name them (axes='time,z,x') and give sampling_rate=..., in Hz"
            )
        at = find_time_axis(dataset, samples, path) % len(shape)
        if any(role == "time" and i != at and shape[i] > 1 for i, role in enumerate(roles)):
            raise ValueError(
                f"{label} has shape {shape} and more than one axis of time; name the axes: axes='time,z,x'"
            )
        roles = [role if role != "time" else "" for role in roles]
        roles[at] = "time"
    elif time is not None and samples != shape[roles.index("time")]:
        raise ValueError(
            f"{label} has shape {shape} with time on axis {roles.index('time')}, {time.name} has {samples} values"
        )
    across, height = ("y", "z") if upward else ("z", "y")
    space = [i for i, role in enumerate(roles) if role != "time"]
    kept = [i for i in space if shape[i] > 1 or roles[i] in ("x", across, "probe")
            or (len(space) < 3 and not _is_height(roles[i], height))]  # fmt: skip
    kept = kept if len(kept) < 3 else [i for i in kept if shape[i] > 1]
    if len(kept) > 2:
        raise ValueError(
            f"{label} has shape {shape}, axes {','.join(r or '?' for r in roles)}; (time, z, x) or "
            "(time, probe) is needed: take one height, and name the axes: axes=..."
        )
    _refuse_others({roles[i]: shape[i] for i in kept if shape[i] > 1}, across, height, label)
    if len(kept) == 2:
        lengths = {getattr(group[name], "shape", None) for name in group
                   if is_there(group, name, path) and _role(name, None) == across}  # fmt: skip
        free = any((shape[i],) in lengths or shape[i] == 1 for i in kept)
        kept = _rows_first(kept, roles, across, free, label)
    return Axes(
        (roles.index("time"), *kept), tuple(shape[i] for i in kept), time,
        tuple(scales[i] for i in kept), across,
    )  # fmt: skip


def _times(scales: list[h5py.Dataset | None], group: h5py.Group, path: Path) -> h5py.Dataset | None:
    """The times: a dimension scale that is time, else a variable of that name."""
    time = next((s for s in scales if s is not None and is_time(s) and not _is_bare(s)), None)
    for where in (group, group.file):
        named = next((k for k in where if k.lower() in ("time", "t")
                      and len(getattr(where[k], "shape", None) or ()) == 1), None)  # fmt: skip
        if time is None and named is not None and is_there(where, named, path):
            own = where[named]
            time = own if isinstance(own, h5py.Dataset) and not _is_bare(own) else None
    if time is not None and (time.shape is None or len(time.shape) != 1 or time.shape[0] < 2):
        raise Unwritten(f"{path}:{time.name} has shape {time.shape}; a list of at least two times is needed")
    return time


def _role(name: str, scale: h5py.Dataset | None) -> str:
    """time, x, y, z or probe; the name of another axis, "" of one without."""
    if scale is not None and is_time(scale):
        return "time"
    words = "" if scale is None else text_attribute(scale, "long_name") or ""
    for role, known in DIRECTIONS.items():
        if re.search(known, f"{name} {words}", re.IGNORECASE):
            return role
    found = re.fullmatch(ROLE, name)
    axis = None if scale is None else text_attribute(scale, "axis")
    if found is None and axis in ("X", "Y", "Z"):
        return axis.lower()
    return found[1].lower() if found else name


def _refuse_others(sizes: dict[str, int], across: str, height: str, label: str) -> None:
    """Axes that no plane has: heights, and components of the velocity."""
    for name, size in sizes.items():
        if re.fullmatch(COMPONENT, name):
            raise ValueError(
                f"{label} has an axis {name} of {size}, which may be the components of the "
                "velocity; write the one normal to the wall alone, or, if they are probes, name "
                "the axes: axes='time,z,x'"
            )
        if _is_height(name, height):
            raise ValueError(
                f"{label} has an axis {name} of {size}: {name} is the height, of which a plane "
                f"has one; if it runs across the duct, say so: normal={across!r}"
            )


def _is_height(name: str, height: str) -> bool:
    return name == height or re.fullmatch(HEIGHT, name) is not None


def _rows_first(kept: list[int], roles: list[str], across: str, free: bool, label: str) -> list[int]:
    """The two axes of a plane, z outside x; whether one of them may be called anything."""
    names = [roles[i] for i in kept]
    said = {"x", across} & set(names)
    if all(names) and len(said) < (1 if free else 2):
        raise ValueError(
            f"{label} has the axes {', '.join(names)}, and which runs "
            f"{'across' if 'x' in said else 'along'} the duct is not said; name all axes in their "
            "order: axes='time,z,x' (--axes)"
        )
    return kept[::-1] if names[0] == "x" or names[1] == across else kept


def find_coordinates(
    group: h5py.Group, axes: Axes, request: PlaneRequest, path: Path, *, strict: bool
) -> dict[str, Any]:
    """x and z of the probes, m; None where the file does not say.

    Args:
        group: of the velocity.
        axes: of the velocity.
        request, path: what the user states, and of the file.
        strict: refuse x and z of other lengths than the probes need; else they are of others.
    Raises:
        ValueError: as ``read_coordinate``.
    """
    found: dict[str, Any] = {}
    for role, word in (("x", "x"), ("z", axes.across)):
        axis = -1 if role == "x" or len(axes.shape) < 2 else 0
        count = axes.shape[axis] if axes.shape else 1
        scale = axes.scales[axis] if axes.shape else None
        own = None if scale is None else _role(scale.name.split("/")[-1], scale)
        groups = {group.name: group, "/": group.file}
        choices = [where[key] for where in groups.values() for key in where
                   if re.fullmatch(ROLE, key) and is_there(where, key, path)
                   and _role(key, None) == word]  # fmt: skip
        choices.sort(key=lambda each: len(each.name.split("/")[-1]))  # "x" before "x_coord"
        for each in choices:
            if len(axes.shape) == 2 and getattr(each, "shape", None) == axes.shape:
                raise ValueError(
                    f"{path}:{each.name} has a value for each probe, {each.shape}; a plane has one "
                    "for each row or column: flatten velocity and coordinates to (time, probe)"
                )
        if scale is not None and scale.name and (len(axes.shape) == 2 or own == word):
            choices.insert(0, scale)
        for each in choices:
            if found.get(role) is None and isinstance(each, h5py.Dataset) and (strict or each.size == count):
                found[role] = read_coordinate(
                    each.parent, each.name.split("/")[-1], (count,) if axes.shape else (), path,
                    request.length_units,
                )  # fmt: skip
    return found
