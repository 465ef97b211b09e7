"""Which variable is the wall-normal velocity, which way it is positive, and what its axes are.

By names, dimensions and what CF 1.8 lays down (units, standard_name, axis, positive), never by prose.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchliner.checks import tell
from torchliner.file_checks import Unwritten
from torchliner.io.plane_format import PlaneRequest
from torchliner.io.point_layout import AXES, component_of
from torchliner.io.variables import Field, coordinate, time_axis
from torchliner.names import did_you_mean
from torchliner.units import si_factor

VELOCITY = "wall_normal_velocity"
UPWARD = r"(up|down)ward_(air|sea_water)_vel"
NORMAL = rf"(wall|surface|liner)[ _-]?normal|^normal[ _-]vel|{UPWARD}"
OTHER = r"streamwise|spanwise|eastward|northward|mean\b|rms\b"
LETTERS = {"x": "u", "y": "v", "z": "w"}
WALL = r"(?: the (?:liner|wall|surface|facesheet))?"
POSITIVE = rf"(away|outwards?)(?: from{WALL})?|(into|towards?|inwards?){WALL}|(up)(?:wards?)?|(down)(?:wards?)?"
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
Fields = Mapping[str, Field]


@dataclass(frozen=True)
class Layout:
    """How the velocity lies in its variable.

    Args:
        order: axes of the variable, time first, then z and x, or probe; of those left out one value is taken.
        across: coordinate that plays z: "z", or "y" where z is normal to the wall.
        taken: axis of the heights or components of which one is taken; None without one.
        height: coordinate along that axis, "y" or "z"; None of components.
    """

    order: tuple[int, ...]
    across: str
    taken: int | None = None
    height: str | None = None


def find_velocity(fields: Fields, request: PlaneRequest, path: Path) -> Field:
    """The wall-normal velocity: named so, or by the user; else by standard_name, component or as the only one.

    Raises:
        ValueError: none fits, or several do; they are listed.
    """
    lead = f"/{(request.group or '').strip('/')}/".replace("//", "/")
    there = {name.removeprefix(lead): each for name, each in fields.items() if name.startswith(lead)}
    wanted = (request.variable or VELOCITY).lstrip("/")
    if wanted in there:
        return there[wanted]
    if request.variable is not None or (request.group is not None and not there):
        raise ValueError(
            f"{path}:{lead} has no variable {wanted!r}{did_you_mean(wanted, list(there))}; it holds "
            f"{', '.join(there or fields) or 'nothing'}"
        )
    found = [each for each in there.values() if _may_be(each, request, len(there) == 1)]
    timed = [each for each in found if "time" in (role_of(axis, fields) for axis in each.axes)] or found
    best = [each for each in timed if _says(each, NORMAL)]
    if not best and request.normal:
        best = [each for each in timed if _says(each, _component(request.normal.strip("-")))]
    best = best or [each for each in timed if not _says(each, OTHER)]
    if len(best) == 1 and (request.normal or not _says(best[0], f"{_component('x')}|{OTHER}")):
        return best[0]
    listed = "; ".join(_described(each, lead) for each in best or found or there.values()) or "nothing"
    if not found:
        raise (ValueError if there else Unwritten)(
            f"{path} holds no velocity above a wall, {VELOCITY} or one with units of a velocity; "
            f"it holds: {listed}. Name it: variable=..., and if it has no units velocity_units=..."
        )
    raise ValueError(
        f"{path}: {len(best) or 'none'} of its velocities may be normal to the wall: {listed}; name it: variable=..."
    )


def _described(field: Field, lead: str) -> str:
    unit = field.text("units")
    shape = "x".join(map(str, field.shape)) or "a number"
    return f"{field.name.removeprefix(lead)} ({shape}{'' if unit is None else f', {unit}'})"


def _may_be(field: Field, request: PlaneRequest, alone: bool) -> bool:
    """Whether it has several numbers and the units of a velocity, its own or stated."""
    unit = field.text("units")
    line = unit is None and len(field.shape) < 2 and not alone
    if field.array.dtype.kind not in "fiu" or field.size < 2 or line or role_of(field.short, {}) in ROLES:
        return False
    try:
        return bool(si_factor("velocity", request.velocity_units if unit is None else unit, ""))
    except ValueError:
        return False


def _says(field: Field, pattern: str) -> bool:
    """Whether name or standard_name fit."""
    names = (field.short, field.text("standard_name") or "")
    return any(re.search(pattern, name, re.IGNORECASE) for name in names)


def _component(axis: str) -> str:
    """Names of one component of the velocity: v, v_y, Vy, y_velocity, velocity_y, YVelocity."""
    return rf"^({LETTERS[axis]}|([uv]|vel|velocity)[ _-]?{axis}|{axis}[ _-]?vel(ocity)?)\b"


def sign_of(velocity: Field, request: PlaneRequest, ours: bool) -> float:
    """-1 where the data are positive into the liner: what ``positive`` says of it counts before the user's normal.

    Args:
        velocity: its ``positive`` says "away from the liner", "into the liner", "up" or "down".
        request: its ``normal`` counts for an axis.
        ours: the file is of our schema: positive away.
    Raises:
        ValueError: ``positive`` says something else; a normal that would turn data which are positive away, or of
            another component.
    Warns:
        DataWarning: words say into or towards something, which are not understood.
    """
    axis = component_of(velocity.short)
    if request.normal and axis is not None and AXES[axis] != request.normal[-1]:
        raise ValueError(
            f"{velocity.label} is the velocity along {AXES[axis]}, but normal is {request.normal!r}; name "
            "the variable of that direction"
        )
    words = (velocity.text("positive") or ("away" if ours else "")).strip().lower()
    turned = (request.normal or "").startswith("-")
    found = re.fullmatch(POSITIVE, words)
    if words and found is None:
        raise ValueError(
            f"{velocity.label}: positive is {words!r}; write 'away from the liner', 'into the liner', 'up' or 'down'"
        )
    away, into, _, down = found.groups() if found else (None,) * 4
    if away and turned:
        raise ValueError(
            f"{velocity.label} is positive {words}{' by its schema' if ours else ''}, and normal={request.normal!r} "
            "would turn it; leave the sign out, or correct the file"
        )
    prose = f"{velocity.text('long_name') or ''} {velocity.text('units')}"
    if not words and not turned and re.search(r"\b(into|towards?|downwards?)\b", prose):
        tell(
            f"{velocity.label} says {prose.strip()!r}; it is taken as positive away from the liner: if it is not, "
            "state normal='-y' or so, or write an attribute positive = 'into the liner'"
        )
    down = down or _says(velocity, r"^downward_")
    return -1.0 if into or (not away and bool(down) != turned) else 1.0


def role_of(name: str, fields: Fields) -> str:
    """time, x, y or z of a dimension, by its name or what its variable says; else its name."""
    field, short = fields.get(name), name.rpartition("/")[2]
    axis, standard, unit = (field.text(key) if field else None for key in ("axis", "standard_name", "units"))
    if standard == "time" or axis == "T" or " since " in (unit or ""):
        return "time"
    named = next((role for role, known in ROLES.items() if re.fullmatch(known, short, re.IGNORECASE)), None)
    return named or (axis.lower() if axis in ("X", "Y", "Z") else short)


def _near(velocity: Field, fields: Fields) -> list[Field]:
    """Variables of the velocity's group, then those at the top of the file."""
    leads = dict.fromkeys((velocity.name.rpartition("/")[0], ""))
    return [each for lead in leads for name, each in fields.items() if name.rpartition("/")[0] == lead]


def find_times(velocity: Field, fields: Fields) -> Field | None:
    """The times: a dimension that is time, else a variable of that name."""
    scales = [fields[axis] for axis in velocity.axes if axis in fields and role_of(axis, fields) == "time"]
    named = [each for each in _near(velocity, fields) if each.short.lower() in ("time", "t") and len(each.shape) == 1]
    return next(iter(scales + named), None)


def find_layout(velocity: Field, fields: Fields, request: PlaneRequest, samples: int | None) -> Layout:
    """Roles of the axes, from the user, the dimensions or the lengths.

    Args:
        velocity, fields, request: as for ``find_velocity``.
        samples: number of times; None where there are none.
    Raises:
        ValueError: they cannot be told, or more than time and two others are longer than 1.
    """
    shape, label = velocity.shape, velocity.label
    upward = _says(velocity, UPWARD) or (request.normal or "").strip("-") == "z"
    across, height = ("y", "z") if upward else ("z", "y")
    roles = request.axis_names or [role_of(axis, fields) for axis in velocity.axes]
    long = [i for i, n in enumerate(shape) if n != 1]
    if len(roles) == len(long) < len(shape):  # MATLAB keeps a vector as a row
        roles = [roles[long.index(i)] if i in long else NONE for i in range(len(shape))]
    if len(roles) != len(shape):
        raise ValueError(f"{label} has shape {shape}, but {len(roles)} axes are named: {','.join(roles)}")
    if roles.count("time") > 1:
        roles = [NONE if role == "time" and n == 1 else role for role, n in zip(roles, shape, strict=True)]
    if "time" not in roles and samples is not None:
        roles[time_axis(velocity, samples)] = "time"
    tall = [
        i
        for i, role in enumerate(roles)
        if role == height or re.fullmatch(f"{HEIGHT}|{COMPONENT}", role, re.IGNORECASE)
    ]
    taken = tall[0] if len(tall) == 1 and request.row in range(shape[tall[0]]) else None
    kept = [
        i
        for i, role in enumerate(roles)
        if role not in ("time", NONE) and i != taken and (shape[i] > 1 or role in ("x", across, "probe"))
    ]
    names = [roles[i] for i in kept]
    # A coordinate along an axis, or a size of 1, tells what the other name does not.
    placed = {each.shape for each in _near(velocity, fields) if role_of(each.short, {}) == across}
    free = any((shape[i],) in placed or shape[i] == 1 for i in kept)
    told = len({"x", across} & set(names)) >= (1 if free else 2) or len(kept) < 2 or not all(names)
    several = f"state row=0 or so for one of several (--row), or normal={across!r} if {height} runs across the duct"
    faults = {
        "one axis is time: name all (axes='time,z,x', --axes), and give sampling_rate=..., in Hz, where there are no "
        "times": roles.count("time") != 1,
        f"no axis of heights has a row {request.row}": request.row is not None and taken is None,
        f"a plane has one height and one component: {several}": set(kept) & set(tall),
        "which runs along the duct and which across is not said: name all in their order: axes='time,z,x' (--axes)": (
            len(kept) > 2 or not told
        ),
    }
    if why := next((words for words, there in faults.items() if there), None):
        raise ValueError(f"{label} has shape {shape} with the axes {', '.join(role or '?' for role in roles)}; {why}")
    time = roles.index("time")
    if samples not in (None, shape[time]):
        raise ValueError(f"{label} has shape {shape} with time on axis {time}, but there are {samples} times")
    if len(kept) == 2 and (names[0] == "x" or names[1] == across):
        kept.reverse()
    named = taken is not None and not re.fullmatch(COMPONENT, roles[taken], re.IGNORECASE)
    return Layout((time, *kept), across, taken, height if named else None)


def find_coordinates(
    velocity: Field, layout: Layout, fields: Fields, request: PlaneRequest, *, strict: bool
) -> dict[str, Any]:
    """x and z of the probes, m, None where the file does not say, and of several heights the one that is taken.

    Args:
        velocity, layout, fields, request: as found before.
        strict: refuse x and z of other lengths than the probes need; else they are of others.
    Raises:
        ValueError: as ``coordinate``; a value for each probe of a plane.
    """
    probes = layout.order[1:]
    grid = tuple(velocity.shape[i] for i in probes)
    found: dict[str, Any] = {}
    wanted: list[tuple[str, str, int | None]] = [("x", "x", probes[-1] if probes else None)]
    wanted += [("z", layout.across, probes[0] if probes else None)]
    wanted += [("height", layout.height, layout.taken)] if layout.height is not None else []
    for name, word, axis in wanted:
        count = 1 if axis is None else velocity.shape[axis]
        choices = [each for each in _near(velocity, fields) if role_of(each.short, {}) == word]
        choices.sort(key=lambda each: len(each.short))  # "x" before "x_coord"
        for each in choices:
            if len(grid) == 2 and min(grid) > 1 and each.shape == grid:
                raise ValueError(
                    f"{each.label} has a value for each probe, {each.shape}; a plane has one "
                    "for each row or column: flatten velocity and coordinates to (time, probe)"
                )
        scale = "" if axis is None else velocity.axes[axis]
        if scale in fields and (len(grid) == 2 or name == "height" or role_of(scale, fields) == word):
            choices.insert(0, fields[scale])
        for each in choices:
            if found.get(name) is None and (each.size == count or (strict and name != "height")):
                found[name] = coordinate(each, count, request.length_units)
    if found.get("height") is not None and request.row is not None:
        found["height"] = float(found["height"][request.row])
    return found
