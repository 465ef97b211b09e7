"""Which variable of a netCDF-like file is the velocity, and what its axes are.

CF conventions 1.8: units, ``standard_name``, ``axis``, coordinate variables; our own schema is the
case in which the names alone say it.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py

from torchliner.io.axes import NO_VARIABLE, axis_names, find_time_axis, read_coordinate
from torchliner.io.hdf5 import get_group, is_there, place, text_attribute
from torchliner.io.plane_format import PlaneRequest
from torchliner.names import did_you_mean
from torchliner.units import si_factor

VELOCITY = "wall_normal_velocity"
UPWARD = r"\b(up|down)ward_(air|sea_water)_vel"
NORMAL = rf"(wall|surface|liner)[ _-]?normal|\bnormal[ _-](vel|to)|{UPWARD}"
OTHER = r"streamwise|spanwise|eastward|northward|\bmean\b|_mean\b|\brms\b|_rms\b"
LETTERS = {"x": "u", "y": "v", "z": "w"}
# What an attribute ``positive`` says of the liner, and of the axis; long names and units may too.
INTO, AWAY = r"\b(into|towards?|inwards?)\b", r"\b(away|outwards?|out of)\b"
DOWN, UP = r"\bdown(wards?)?\b", r"\bup(wards?)?\b"
DIRECTIONS = {"x": r"\bstreamwise\b|\bx_?1\b", "z": r"\bspanwise\b|\bx_?3\b", "y": r"\bx_?2\b"}
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


def find_velocity(file: h5py.File, request: PlaneRequest, path: Path) -> str:
    """Where the wall-normal velocity stands in the file.

    Raises:
        ValueError: none fits, or several do; they are listed.
    """
    group = get_group(file, request.group, path) if request.group else file
    lead = (group.name or "/").rstrip("/") + "/"
    if request.variable is None and is_there(group, VELOCITY, path):
        return lead + VELOCITY
    there = _datasets(group)
    if request.variable is not None:
        name = request.variable.lstrip("/")
        if not is_there(group, name, path):
            raise ValueError(
                f"{path} has no variable {name!r}{did_you_mean(name, list(there))}; it holds "
                f"{', '.join(there) or 'nothing'}"
            )
        return lead + name
    found = [key for key, each in there.items() if _may_be(each, request)]
    timed = [key for key in found if _has_time(there[key])] or found
    best = [key for key in timed if says(there[key], key, NORMAL)]
    if not best and request.normal:
        axis = request.normal.strip("-")
        best = [key for key in timed if says(there[key], key, _component(axis))]
    best = best or [key for key in timed if not says(there[key], key, OTHER)]
    alone = f"{_component('x')}|{OTHER}"
    if len(best) == 1 and (request.normal or not says(there[best[0]], best[0], alone)):
        return lead + best[0]
    listed = "; ".join(_described(there[key], key) for key in best or found or there) or "nothing"
    if not found:
        raise ValueError(
            f"{path} holds no velocity above a wall, {VELOCITY} or one with units of a velocity; "
            f"it holds: {listed}. Name it: variable=..., and if it has no units velocity_units=..."
        )
    raise ValueError(
        f"{path}: {len(best) or 'none'} of its velocities may be normal to the wall: {listed}; "
        "name it: variable=..."
    )


def _datasets(group: h5py.Group) -> dict[str, h5py.Dataset]:
    """All numbers in a group and the groups in it; of links out of the file those at its top."""
    found: dict[str, Any] = {}
    group.visititems(found.__setitem__)
    for key in group:
        with suppress(KeyError, OSError, RuntimeError):  # a link that leads nowhere
            found.setdefault(key, group[key])
    return {key: each for key, each in found.items()
            if isinstance(each, h5py.Dataset) and each.dtype.kind in "fiu"}  # fmt: skip


def _may_be(dataset: h5py.Dataset, request: PlaneRequest) -> bool:
    """Whether a dataset has more than one value and the units of a velocity, its own or stated."""
    unit = text_attribute(dataset, "units")
    if not dataset.shape or (unit is None and len(dataset.shape) < 2):
        return False
    try:
        si_factor("velocity", request.velocity_units if unit is None else unit, "")
    except ValueError:
        return False
    return dataset.size > 1


def _has_time(dataset: h5py.Dataset) -> bool:
    return any(is_time(dim[0]) for dim in dataset.dims if len(dim) and dim[0].name)


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


def _component(axis: str) -> str:
    """Names of one component of the velocity: v, v_y, Vy, y_velocity, velocity_y, YVelocity."""
    return rf"^({LETTERS[axis]}|([uv]|vel|velocity)[ _-]?{axis}|{axis}[ _-]?vel(ocity)?)\b"


def says(dataset: h5py.Dataset, key: str, pattern: str) -> bool:
    """Whether a name of a dataset, short, long or standard, fits."""
    names = [key.split("/")[-1], *(text_attribute(dataset, each) or ""
             for each in ("standard_name", "long_name"))]  # fmt: skip
    return any(re.search(pattern, name, re.IGNORECASE) for name in names)


def _described(dataset: h5py.Dataset, key: str) -> str:
    unit = text_attribute(dataset, "units")
    shape = "x".join(map(str, dataset.shape or ())) or "a number"
    return f"{key} ({shape}{'' if unit is None else f', {unit}'})"


def sign_of(dataset: h5py.Dataset, key: str, request: PlaneRequest) -> float:
    """-1 where the data are positive into the liner: what they say of it counts before the user's
    normal, which counts for an axis.

    Raises:
        ValueError: an attribute ``positive`` that says neither.
    """
    words = (text_attribute(dataset, "positive") or "").strip().lower()
    others = " ".join(
        text_attribute(dataset, name) or "" for name in ("long_name", "units")
    ).lower()
    for text in (words, others if "positive" in others else ""):
        into, away = (re.search(each, text) is not None for each in (INTO, AWAY))
        if into != away:
            return -1.0 if into else 1.0
    if words and not (re.search(DOWN, words) or re.search(UP, words)):
        raise ValueError(
            f"{dataset.file.filename}:{dataset.name}: positive is {words!r}; write 'away from the "
            "liner' or 'into the liner' (or 'up', 'down')"
        )
    down = re.search(DOWN, words) is not None or says(dataset, key, r"\bdownward_")
    return -1.0 if down != (request.normal or "").startswith("-") else 1.0


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
            raise ValueError(
                f"{label} has shape {shape}, but {len(roles)} axes are named: {','.join(roles)}"
            )
    else:
        names = axis_names(dataset, label)
        roles = [_role(*each) for each in zip(names, scales, strict=True)]
    time = _times(scales, group, path)
    samples = None if time is None else time.shape[0]
    if roles.count("time") != 1:
        if samples is None:
            raise ValueError(
                f"{label}: none of its axes is time; name them (axes='time,z,x') and give "
                "sampling_rate=..., in Hz"
            )
        at = find_time_axis(dataset, samples, path) % len(shape)
        if any(role == "time" and i != at and shape[i] > 1 for i, role in enumerate(roles)):
            raise ValueError(
                f"{label} has shape {shape} and more than one axis of time; name the axes: "
                "axes='time,z,x'"
            )
        roles = [role if role != "time" else "" for role in roles]
        roles[at] = "time"
    elif time is not None and samples != shape[roles.index("time")]:
        raise ValueError(
            f"{label} has shape {shape} with time on axis {roles.index('time')}, {time.name} has "
            f"{samples} values"
        )
    across, height = ("y", "z") if upward else ("z", "y")
    space = [i for i, role in enumerate(roles) if role != "time"]
    kept = [i for i in space if shape[i] > 1 or roles[i] in ("x", across, "probe")
            or (len(space) < 3 and roles[i] != height)]  # fmt: skip
    kept = kept if len(kept) < 3 else [i for i in kept if shape[i] > 1]
    if len(kept) > 2:
        raise ValueError(
            f"{label} has shape {shape}, axes {','.join(r or '?' for r in roles)}; (time, z, x) or "
            "(time, probe) is needed: take one height, and name the axes: axes=..."
        )
    if len(kept) == 2:
        kept = _rows_first(kept, [roles[i] for i in kept], across, height, label)
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
        raise ValueError(
            f"{path}:{time.name} has shape {time.shape}; a list of at least two times is needed"
        )
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


def _rows_first(
    kept: list[int], names: list[str], across: str, height: str, label: str
) -> list[int]:
    """The two axes of a plane, z outside x."""
    if height in names:
        raise ValueError(
            f"{label} has the axes {', '.join(names)}: {height} is the height, of which a plane "
            f"has one; if it runs across the duct, say so: normal={across!r}"
        )
    if all(names) and not {"x", across} & set(names):
        raise ValueError(
            f"{label} has the axes {', '.join(names)}, and which runs along the duct is not "
            "said; name all axes in their order: axes='time,z,x' (--axes)"
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
            if (
                found.get(role) is None
                and isinstance(each, h5py.Dataset)
                and (strict or each.size == count)
            ):
                found[role] = read_coordinate(
                    each.parent, each.name.split("/")[-1], (count,) if axes.shape else (), path,
                    request.length_units,
                )  # fmt: skip
    return found
