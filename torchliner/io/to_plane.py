"""The one way from variables to a plane. It answers in this order, by names and what CF 1.8 lays down (units,
standard_name, axis, positive), never by prose: which variable is the wall-normal velocity, in what units; what its
clock is; which of its axes is what, and where the probes stand; what the case is; which way it is positive.

Dimensions are (time, z, x), (time, x) or (time, probe), in any order. Numbers beside the velocity are scalar variables
or attributes with CF units (docs/formats.md).
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from torchliner.file_checks import Unwritten, naming
from torchliner.fluid import Fluid
from torchliner.io.clocks import read_times
from torchliner.io.own_file import read_attribute
from torchliner.io.own_writer import FLUID_UNITS
from torchliner.io.plane_format import PlaneRequest
from torchliner.io.points import component_of, require_direction
from torchliner.io.variables import (
    Field,
    Fields,
    Source,
    VariableVelocity,
    coordinate,
    references_of,
    time_axis,
)
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane
from torchliner.records.declared import variables_of
from torchliner.units import SI_QUANTITY, si_factor

HEAD = {"title": str, "source_side": str, "liner": str, "provenance": dict[str, Any]}  # attributes of our files
VELOCITY, STREAMWISE, AREA = "wall_normal_velocity", "streamwise_velocity", "area"
STATED = {row.field: row.unit for row in variables_of(VelocityPlane) if not row.dims and row.field != "start"}
STATED |= FLUID_UNITS
REMEDIES = {
    "torchliner pressure": "; use torchliner insitu",
    "torchliner moments": ": moments, and this needs the samples, which are gone; name the plane that was reduced",
}
# Names of axes.
PLACE = r"(_?(c|coords?|coordinates?|axis|dim|centers?|pos|positions?|unique))?"
ROLES = {
    "time": "t|times?",
    "x": rf"[ni]?x{PLACE}|x_?1|streamwise{PLACE}",
    "y": rf"[ni]?y{PLACE}|x_?2",
    "z": rf"[ni]?z{PLACE}|x_?3|spanwise{PLACE}",
}
HEIGHT = r"height|altitude|elevation|depth|lev(el)?s?|wall_?(distance|normal)|y_?plus"
COMPONENTS = r"comp(onent)?s?|vec(tor)?s?|uvw|directions?|dims?|nv|d3|[a-z]*velocity_?components?"
NONE = "none"  # an axis of one value
# Names of velocities, and which way they are positive.
NORMAL = r"(wall|surface|liner)[ _-]?normal|^normal[ _-]vel"
OTHER = r"streamwise|spanwise|eastward|northward|mean\b|rms\b"
ALONG = {a: rf"^({u}|([uv]|vel|velocity)[ _-]?{a}|{a}[ _-]?vel(ocity)?)\b" for a, u in zip("xyz", "uvw", strict=True)}
WALL = r"( the (liner|wall|surface|facesheet))?"
AWAY, INTO = rf"(away|outwards?)( from{WALL})?", rf"(into|towards?|inwards?){WALL}"


def to_plane(source: Source, request: PlaneRequest) -> VelocityPlane:
    """The plane that a file or dataset holds; a ValueError that names FILE:/variable where one is missing, was never
    written, has a wrong shape or no or wrong units, or time is not uniform."""
    fields, path = source.fields, source.path
    head = Field(None, path, "/", source.attrs)
    schema = head.text("schema") or ""
    if f"/{VELOCITY}" not in fields and schema.startswith("torchliner "):
        raise ValueError(
            f"{path} is no velocity plane but a file of schema {schema!r}{REMEDIES.get(schema.rpartition(' ')[0], '')}"
        )
    velocity = _velocity(source, request)
    ours = velocity.short == VELOCITY
    factor = velocity.signal_factor("m/s", request.velocity_units)
    rate, samples, first = request.sampling_rate, None, 0.0
    times = [fields[axis] for axis in velocity.axes if axis in fields and role_of(axis, fields) == "time"]
    times += [each for each in near(velocity, fields) if each.short.lower() in ("time", "t") and len(each.shape) == 1]
    if times:
        rate, samples, first = read_times(times[0], request.sampling_rate)
    order, taken, across = find_axes(velocity, fields, request, samples)
    if rate is None:
        raise ValueError(f"{velocity.label} has no times; give sampling_rate=..., in Hz")
    case = find_places(velocity, fields, request, order[1:], taken, across) | _case(source, head, velocity)
    # Elsewhere a field may bear the name of one of our numbers: density over time and place.
    lead = velocity.name.rpartition("/")[0]
    own = {name: fields[f"{lead}/{name}"] for name in (STREAMWISE, AREA) if ours and f"{lead}/{name}" in fields}
    if stream := own.pop(STREAMWISE, None):
        case["streamwise"] = VariableVelocity(stream, source.opens, order, stream.signal_factor("m/s"))
    if area := own.pop(AREA, None):
        case["area"] = area.si("m2")
    row = request.row or 0
    part = {} if taken is None else {taken: slice(row, row + 1)}
    sign = _sign(velocity, request, ours and schema.startswith("torchliner "))
    with naming(path):
        return VelocityPlane(
            VariableVelocity(velocity, source.opens, order, sign * factor, part),
            sampling_rate=rate,
            start=first,
            name=velocity.label,
            reference=references_of(fields),
            **case,
        )


def says(field: Field, pattern: str) -> bool:
    """Whether name or standard_name fit."""
    names = (field.short, field.text("standard_name") or "")
    return any(re.search(pattern, name, re.IGNORECASE) for name in names)


def _velocity(source: Source, request: PlaneRequest) -> Field:
    """The wall-normal velocity: named so, or by the user; else by standard_name, component or as the only one."""
    lead = f"/{(request.group or '').strip('/')}/".replace("//", "/")
    there = {name.removeprefix(lead): each for name, each in source.fields.items() if name.startswith(lead)}
    wanted = (request.variable or VELOCITY).lstrip("/")
    if wanted in there:
        return there[wanted]
    if request.variable is not None or (request.group is not None and not there):
        raise ValueError(
            f"{source.path}:{lead} has no variable {wanted!r}{did_you_mean(wanted, list(there))}; it holds "
            f"{', '.join(there or source.fields) or 'nothing'}"
        )
    found = [each for each in there.values() if _may_be(each, request, len(there) == 1)]
    found = [each for each in found if "time" in (role_of(axis, source.fields) for axis in each.axes)] or found
    patterns = [NORMAL, ALONG[request.normal[-1]]] if request.normal else [NORMAL]
    best = next(filter(None, ([each for each in found if says(each, pattern)] for pattern in patterns)), [])
    best = best or [each for each in found if not says(each, OTHER)]
    if len(best) == 1 and (request.normal or not says(best[0], f"{ALONG['x']}|{OTHER}")):
        return best[0]
    listed = "; ".join(
        f"{each.name.removeprefix(lead)} ({'x'.join(map(str, each.shape)) or 'a number'}, {each.text('units')})"
        for each in best or found or there.values()
    )
    if found:
        number = f"{len(best) or 'none'} of its velocities may be normal to the wall"
        raise ValueError(f"{source.path}: {number}: {listed}; name it: variable=...")
    raise (ValueError if there else Unwritten)(
        f"{source.path} holds no velocity above a wall, {VELOCITY} or one with units of a velocity; it holds: "
        f"{listed or 'nothing'}. Name it: variable=..., and if it has no units velocity_units=..."
    )


def _may_be(field: Field, request: PlaneRequest, alone: bool) -> bool:
    """Whether it has several numbers and the units of a velocity, its own or stated."""
    unit = field.text("units")
    line = unit is None and len(field.shape) < 2 and not alone
    if field.array.dtype.kind not in "fiu" or field.size < 2 or line or role_of(field.short, {}) in ROLES:
        return False
    with suppress(ValueError):
        return bool(si_factor("velocity", request.velocity_units if unit is None else unit, ""))
    return False


def _sign(velocity: Field, request: PlaneRequest, ours: bool) -> float:
    """-1 where the data are positive into the liner: what the attribute ``positive`` says of it, or the schema of
    ``ours``, counts before the user's normal, and against it is a ValueError."""
    require_direction(velocity.label, component_of(velocity.short), request.normal)
    words = (velocity.text("positive") or ("away" if ours else "")).strip().lower()
    turned, into = (request.normal or "").startswith("-"), re.fullmatch(INTO, words) is not None
    if into or re.fullmatch(AWAY, words):
        if turned and not into:
            raise ValueError(
                f"{velocity.label} is positive {words}{' by its schema' if ours else ''}, and normal="
                f"{request.normal!r} would turn it; leave the sign out, or correct the file"
            )
        return -1.0 if into else 1.0
    if words:
        raise ValueError(f"{velocity.label}: positive is {words!r}; write 'away from the liner' or 'into the liner'")
    return -1.0 if turned else 1.0


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


def find_axes(
    velocity: Field, fields: Fields, request: PlaneRequest, samples: int | None
) -> tuple[tuple[int, ...], int | None, str]:
    """Its axes, time first, then z and x, or probe; the axis of heights or components of which one is taken; the
    coordinate that plays z, "y" where z is normal to the wall.

    They are told by the user, the dimensions or the lengths; ``samples``: number of times, if there are any. A
    ValueError where they cannot be told, or more than time and two others are longer than 1.
    """
    shape, label = velocity.shape, velocity.label
    across, height = ("y", "z") if (request.normal or "")[-1:] == "z" else ("z", "y")
    roles = request.axis_names or [role_of(axis, fields) for axis in velocity.axes or ("",) * len(shape)]
    long = [i for i, n in enumerate(shape) if n != 1]
    if len(roles) == len(long) < len(shape):  # MATLAB keeps a vector as a row
        roles = [roles[long.index(i)] if i in long else NONE for i in range(len(shape))]
    if len(roles) != len(shape):
        raise ValueError(f"{label} has shape {shape}, but {len(roles)} axes are named: {','.join(roles)}")
    if "time" not in roles and samples is not None:
        roles[time_axis(velocity, samples)] = "time"
    tall = [i for i, role in enumerate(roles) if re.fullmatch(f"{height}|{HEIGHT}|{COMPONENTS}", role, re.IGNORECASE)]
    taken = tall[0] if len(tall) == 1 and request.row in range(shape[tall[0]]) else None
    held = ("x", across, "probe")  # also where one value is left
    kept = [i for i, role in enumerate(roles) if role not in ("time", NONE) and (shape[i] > 1 or role in held)]
    kept = [i for i in kept if i != taken]
    names, why = [roles[i] for i in kept], ""
    if roles.count("time") != 1:
        why = "one axis is time: name all (axes='time,z,x', --axes), and give sampling_rate=..., in Hz, without times"
    elif samples not in (None, shape[roles.index("time")]):
        why = f"but there are {samples} times"
    elif request.row is not None and taken is None:
        why = f"no axis of heights has a row {request.row}"
    elif set(kept) & set(tall):
        why = "a plane has one height and one component: state row=0 or so for one of several (--row), or "
        why += f"normal={across!r} if {height} runs across the duct"
    elif len(kept) > 2 or (len(kept) == 2 and all(names) and not {"x", across} <= {*names}):
        why = "which runs along the duct and which across is not said: name all in order: axes='time,z,x' (--axes)"
    if why:
        raise ValueError(f"{label} has shape {shape} with the axes {', '.join(role or '?' for role in roles)}; {why}")
    return (roles.index("time"), *(kept[::-1] if names[:1] == ["x"] else kept)), taken, across


def find_places(
    velocity: Field, fields: Fields, request: PlaneRequest, probes: Sequence[int], taken: int | None, across: str
) -> dict[str, Any]:
    """x and z of the probes, m, where the file says them, and of several heights the one that is taken.

    In our own files x and z of other lengths than the probes need are refused; elsewhere they are of others. A
    ValueError as of ``coordinate``, or where there is a value for each probe of a plane.
    """
    grid = tuple(velocity.shape[i] for i in probes)
    wanted = [("x", "x", probes[-1] if probes else None), ("z", across, probes[0] if probes else None)]
    wanted += [] if taken is None else [("height", "y" if across == "z" else "z", taken)]
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
            if found.get(name) is None and (each.size == count or (velocity.short == VELOCITY and axis != taken)):
                component = axis == taken and each.array.dtype.kind not in "fiu"  # names of them
                found[name] = None if component else coordinate(each, count, request.length_units)
    if found.get("height") is not None and request.row is not None:
        found["height"] = float(found["height"][request.row])
    return found


def _case(source: Source, head: Field, velocity: Field) -> dict[str, Any]:
    """Attributes of the file; numbers of the case and the gas: variables, or attributes of velocity and file, in SI
    units or with a unit, "1.4 kHz"."""
    said = {key: read_attribute(head, key, hint, head.path) for key, hint in HEAD.items()}
    found: dict[str, Any] = {"title": head.path.stem} | {key: value for key, value in said.items() if value}
    for name, unit in STATED.items():
        for where in dict.fromkeys((velocity.name.rpartition("/")[0], "")):
            each = source.fields.get(f"{where}/{name}")
            if name not in found and each is not None and (velocity.short == VELOCITY or each.size == 1):
                found[name] = each.number(unit)
        for owner in (velocity, head):
            if name not in found and (text := owner.text(name)):
                found[name] = _number(text, unit, f"{owner.label}: attribute {name!r}")
    return found | {"fluid": Fluid(**{name: found.pop(name) for name in FLUID_UNITS if name in found})}


def _number(text: str, unit: str, label: str) -> float:
    """A number of an attribute, with its unit or in SI."""
    amount, *units = text.split(maxsplit=1) or [""]
    try:
        return float(amount) * si_factor(SI_QUANTITY[unit], units[0] if units else unit, label)
    except ValueError as error:
        raise ValueError(f"{label} is {text!r}; a number is needed, with its unit: {error}") from None
