"""The axes of a variable: which are time, along and across the duct, and where its probes stand; by names, dimensions
and what CF 1.8 lays down (units, standard_name, axis), never by prose."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from torchliner.io.plane_format import PlaneRequest
from torchliner.io.variables import Field, Fields, coordinate, time_axis

UPWARD = r"(up|down)ward_(air|sea_water)_vel"
PLACE = r"(_?(c|coords?|coordinates?|axis|dim|centers?|pos|positions?|unique))?"
ROLES = {
    "time": "t|times?",
    "x": rf"[ni]?x{PLACE}|x_?1|streamwise{PLACE}",
    "y": rf"[ni]?y{PLACE}|x_?2",
    "z": rf"[ni]?z{PLACE}|x_?3|spanwise{PLACE}",
}
HEIGHT = r"height|altitude|elevation|depth|lev(el)?s?|wall_?(distance|normal)|y_?plus"
COMPONENT = r"comp(onent)?s?|vec(tor)?s?|uvw|directions?|dims?|nv|d3|[a-z]*velocity_?components?"
NONE = "none"  # an axis of one value


def says(field: Field, pattern: str) -> bool:
    """Whether name or standard_name fit."""
    names = (field.short, field.text("standard_name") or "")
    return any(re.search(pattern, name, re.IGNORECASE) for name in names)


def role_of(name: str, fields: Fields) -> str:
    """time, x, y or z of a dimension, by its name, what its variable says, or a coordinate along it; else its name."""
    field, short = fields.get(name), name.rpartition("/")[2]
    axis, standard, unit = (field.text(key) if field else None for key in ("axis", "standard_name", "units"))
    if standard == "time" or axis == "T" or " since " in (unit or ""):
        return "time"
    along = [each.short for each in fields.values() if name and each.axes == (name,)]
    for word in (short, axis or "", *along):
        for role, known in ROLES.items():
            if re.fullmatch(known, word, re.IGNORECASE):
                return role
    return short


def near(velocity: Field, fields: Fields) -> list[Field]:
    """Variables of the velocity's group, then those at the top of the file."""
    leads = dict.fromkeys((velocity.name.rpartition("/")[0], ""))
    return [each for lead in leads for name, each in fields.items() if name.rpartition("/")[0] == lead]


def find_times(velocity: Field, fields: Fields) -> Field | None:
    """A dimension that is time, else a variable of that name."""
    scales = [fields[axis] for axis in velocity.axes if axis in fields and role_of(axis, fields) == "time"]
    named = [each for each in near(velocity, fields) if each.short.lower() in ("time", "t") and len(each.shape) == 1]
    return next(iter(scales + named), None)


@dataclass(frozen=True)
class Layout:
    """How the velocity lies in its variable: its axes, time first, then z and x, or probe; the coordinate that plays z,
    "y" where z is normal to the wall; the axis of heights or components of which one is taken."""

    order: tuple[int, ...]
    across: str
    taken: int | None = None


def find_layout(velocity: Field, fields: Fields, request: PlaneRequest, samples: int | None) -> Layout:
    """Roles of the axes, from the user, the dimensions or the lengths; ``samples``: number of times, if there are any.

    Raises:
        ValueError: they cannot be told, or more than time and two others are longer than 1.
    """
    shape, label = velocity.shape, velocity.label
    upward = says(velocity, UPWARD) or (request.normal or "").strip("+-") == "z"
    across, height = ("y", "z") if upward else ("z", "y")
    roles = request.axis_names or [role_of(axis, fields) for axis in velocity.axes or ("",) * len(shape)]
    long = [i for i, n in enumerate(shape) if n != 1]
    if len(roles) == len(long) < len(shape):  # MATLAB keeps a vector as a row
        roles = [roles[long.index(i)] if i in long else NONE for i in range(len(shape))]
    if len(roles) != len(shape):
        raise ValueError(f"{label} has shape {shape}, but {len(roles)} axes are named: {','.join(roles)}")
    if "time" not in roles and samples is not None:
        roles[time_axis(velocity, samples)] = "time"
    tall = [i for i, role in enumerate(roles) if re.fullmatch(rf"{height}|{HEIGHT}|{COMPONENT}", role, re.IGNORECASE)]
    taken = tall[0] if len(tall) == 1 and request.row in range(shape[tall[0]]) else None
    held = ("x", across, "probe")  # also where one value is left
    kept = [i for i, role in enumerate(roles) if role not in ("time", NONE) and (shape[i] > 1 or role in held)]
    kept = [i for i in kept if i != taken]
    names = [roles[i] for i in kept]
    why = ""
    if roles.count("time") != 1:
        why = "one axis is time: name all (axes='time,z,x', --axes), and give sampling_rate=..., in Hz, without times"
    elif samples not in (None, shape[roles.index("time")]):
        why = f"but there are {samples} times"
    elif request.row is not None and taken is None:
        why = f"no axis of heights has a row {request.row}"
    elif set(kept) & set(tall):
        why = (
            "a plane has one height and one component: state row=0 or so for one of several (--row), or "
            f"normal={across!r} if {height} runs across the duct"
        )
    elif len(kept) > 2 or (len(kept) == 2 and all(names) and not {"x", across} <= {*names}):
        why = "which runs along the duct and which across is not said: name all in order: axes='time,z,x' (--axes)"
    if why:
        raise ValueError(f"{label} has shape {shape} with the axes {', '.join(role or '?' for role in roles)}; {why}")
    if names[:1] == ["x"]:
        kept.reverse()
    return Layout((roles.index("time"), *kept), across, taken)


def find_places(
    velocity: Field, layout: Layout, fields: Fields, request: PlaneRequest, *, strict: bool
) -> dict[str, Any]:
    """x and z of the probes, m, where the file says them, and of several heights the one that is taken.

    Where ``strict``, x and z of other lengths than the probes need are refused; else they are of others. A ValueError
    as of ``coordinate``, or where there is a value for each probe of a plane.
    """
    probes, taken = layout.order[1:], layout.taken
    grid = tuple(velocity.shape[i] for i in probes)
    wanted = [("x", "x", probes[-1] if probes else None), ("z", layout.across, probes[0] if probes else None)]
    wanted += [] if taken is None else [("height", "y" if layout.across == "z" else "z", taken)]
    found: dict[str, Any] = {}
    for name, word, axis in wanted:
        count = 1 if axis is None else velocity.shape[axis]
        choices = [each for each in near(velocity, fields) if role_of(each.short, {}) == word]
        choices.sort(key=lambda each: len(each.short))  # "x" before "x_coord"
        if bad := [each for each in choices if len(grid) == 2 and min(grid) > 1 and each.shape == grid]:
            raise ValueError(
                f"{bad[0].label} has a value for each probe, {grid}; a plane has one for each row or column: flatten "
                "velocity and coordinates to (time, probe)"
            )
        scale = fields.get(velocity.axes[axis]) if axis is not None and velocity.axes else None
        if scale is not None and (len(grid) == 2 or axis == taken or role_of(scale.name, fields) == word):
            choices.insert(0, scale)
        for each in choices:
            if found.get(name) is None and (each.size == count or (strict and axis != taken)):
                component = axis == taken and each.array.dtype.kind not in "fiu"  # names of them
                found[name] = None if component else coordinate(each, count, request.length_units)
    if found.get("height") is not None and request.row is not None:
        found["height"] = float(found["height"][request.row])
    return found
