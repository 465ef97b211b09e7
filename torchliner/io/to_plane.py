"""The one way from variables to a plane: which is the velocity, what its clock is, which of its axes is what, where the
probes stand, what the case is. Names and units say it, or the user; nothing is guessed.

Dimensions are (time, z, x), (time, x) or (time, probe), in any order. Numbers beside the velocity are scalar variables
with units (docs/formats.md).
"""

from typing import Any

from torchliner.file_checks import Unwritten, naming
from torchliner.fluid import Fluid
from torchliner.io.own_file import read_attribute
from torchliner.io.own_writer import FLUID_UNITS
from torchliner.io.plane_format import PlaneRequest
from torchliner.io.points import require_direction
from torchliner.io.variables import Field, Source, VariableVelocity, read_times, references_of, time_axis
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane
from torchliner.records.declared import variables_of

HEAD = {"title": str, "source_side": str, "liner": str, "provenance": dict[str, Any]}  # attributes of our files
VELOCITY, AREA = "wall_normal_velocity", "area"
STATED = {row.field: row.unit for row in variables_of(VelocityPlane) if not row.dims and row.field != "start"}
STATED |= FLUID_UNITS
ROLES = {"t": "time"} | {f"{axis}_unique": axis for axis in "xyz"}  # the latter in files of MATLAB


def to_plane(source: Source, request: PlaneRequest) -> VelocityPlane:
    """The plane that a file or dataset holds; a ValueError that names FILE:/variable where one is missing, was never
    written, has a wrong shape or no or wrong units, or time is not uniform."""
    fields, path = source.fields, source.path
    head = Field(None, path, "/", source.attrs)
    schema = head.text("schema") or ""
    if f"/{VELOCITY}" not in fields and schema.startswith("torchliner "):
        why = "; this needs the samples, which are gone: name the plane that was reduced" if "moments" in schema else ""
        raise ValueError(f"{path} is no velocity plane but a file of schema {schema!r}{why}")
    velocity = _velocity(source, request)
    require_direction(velocity.label, velocity.short, request.normal)
    sign = -1.0 if (request.normal or "").startswith("-") else 1.0
    if sign < 0 and schema:
        raise ValueError(f"{velocity.label} is positive away from the liner by its schema; leave normal='-...' out")
    factor = velocity.signal_factor("m/s", request.velocity_units)
    # Elsewhere a field may bear the name of one of our numbers: density over time and place.
    ours, groups = velocity.short == VELOCITY, ("", velocity.name.rpartition("/")[0])
    near = {each.short: each for lead in groups for name, each in fields.items() if name.rpartition("/")[0] == lead}
    rate, samples, start = request.sampling_rate, None, 0.0
    clocks = [each for each in near.values() if role_of(each.name) == "time" and len(each.shape) == 1]
    if clocks:
        rate, samples, start = read_times(min(clocks, key=lambda each: each.name not in velocity.axes), rate)
    order, across = find_axes(velocity, request, samples)
    if rate is None:
        raise ValueError(f"{velocity.label} has no times; give sampling_rate=..., in Hz")
    said = {key: read_attribute(head, key, hint, path) for key, hint in HEAD.items()}
    case: dict[str, Any] = {"title": path.stem} | {key: value for key, value in said.items() if value}
    for name, unit in STATED.items():
        if (each := near.get(name)) is not None and (ours or each.size == 1):
            case[name] = each.number(unit)
    case["fluid"] = Fluid(**{name: case.pop(name) for name in FLUID_UNITS if name in case})
    for name, word, axes in (("x", "x", order[-1:]), ("z", across, order[1:2])):
        count = velocity.shape[axes[0]] if len(order) > 1 else 1
        for each in near.values():
            if case.get(name) is None and role_of(each.name) == word and (ours or each.size == count):
                case[name] = each.si("m", request.length_units).reshape(-1)
    if ours and AREA in near:
        case["area"] = near[AREA].si("m2")
    case |= {"start": start, "name": velocity.label, "reference": references_of(fields)}
    with naming(path):
        stored = VariableVelocity(velocity, source.opens, order, sign * factor)
        return VelocityPlane(stored, sampling_rate=rate, **case)


def _velocity(source: Source, request: PlaneRequest) -> Field:
    """The variable that the user names, else the one of our name, or the only one."""
    there = {name.lstrip("/"): each for name, each in source.fields.items()}
    wanted = (request.variable or VELOCITY).lstrip("/")
    if wanted in there:
        return there[wanted]
    if request.variable is None and len(there) == 1:
        return next(iter(there.values()))
    shapes = {name: "x".join(map(str, each.shape)) or "a number" for name, each in there.items()}
    raise (ValueError if there else Unwritten)(
        f"{source.path} has no variable {wanted!r}{did_you_mean(wanted, [*there])}; it holds "
        f"{', '.join(f'{name} ({shape})' for name, shape in shapes.items()) or 'nothing'}: name the velocity "
        "(variable=..., --variable)"
    )


def role_of(name: str) -> str:
    """time, x, y or z of a dimension or its variable; else its name."""
    short = name.rpartition("/")[2].lower()
    return ROLES.get(short, short)


def find_axes(velocity: Field, request: PlaneRequest, samples: int | None) -> tuple[tuple[int, ...], str]:
    """Its axes, time first, then z and x, or probe; the coordinate that plays z, "y" where z is normal to the wall.

    The user or the dimensions tell them; where these have no names, time is the one as long as there are ``samples``,
    and z comes before x. A ValueError where they do not tell, or an axis longer than 1 is of something else.
    """
    shape = velocity.shape
    across = "y" if (request.normal or "")[-1:] == "z" else "z"
    roles = request.axis_names or [role_of(axis) for axis in velocity.axes or ("",) * len(shape)]
    if "time" not in roles and samples is not None:
        roles[time_axis(velocity, samples)] = "time"
    held = ("x", across, "probe")  # also where one value is left
    kept = [i for i, n in enumerate(shape[: len(roles)]) if roles[i] != "time" and (n > 1 or roles[i] in held)]
    names, why = [roles[i] for i in kept], ""
    if len(roles) != len(shape) or roles.count("time") != 1:
        why = "one axis is time: name all (axes='time,z,x', --axes), and give sampling_rate=..., in Hz, without times"
    elif samples not in (None, shape[roles.index("time")]):
        why = f"but there are {samples} times"
    elif sorted(names) not in (sorted(["x", across]), ["", ""], ["x"], [across], ["probe"], [""], []):
        why = (
            f"a plane has x and {across}, or one row of probes: name its axes in order (axes='time,z,x' or "
            "'time,probe', --axes), take one height, or state normal='z' if y runs across the duct"
        )
    if why:
        raise ValueError(
            f"{velocity.label} has shape {shape} with the axes {', '.join(r or '?' for r in roles)}; {why}"
        )
    return (roles.index("time"), *(kept[::-1] if names[:1] == ["x"] else kept)), across
