"""The one way from variables to a plane: which of them is the wall-normal velocity, and which way it is positive; by
names and what CF 1.8 lays down (units, standard_name, positive), never by prose.

Dimensions are (time, z, x), (time, x) or (time, probe), in any order. Numbers beside the velocity are scalar variables
or attributes with CF units (docs/formats.md).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from torchliner.file_checks import Unwritten, naming
from torchliner.fluid import Fluid
from torchliner.io.axes import FLUID_UNITS
from torchliner.io.hdf5 import hold_open, open_file
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.plane_layout import ROLES, UPWARD, Fields, find_layout, find_places, find_times, role_of, says
from torchliner.io.points import AXES, component_of
from torchliner.io.tables import FileKind
from torchliner.io.variable_velocity import Opener, velocity_of
from torchliner.io.variables import Field, fields_of_hdf5, read_times
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane
from torchliner.records.declared import variables_of
from torchliner.records.holes import Holes
from torchliner.units import SI_QUANTITY, si_factor

KIND = FileKind(
    "torchliner plane 1",
    "velocity plane",
    {"title": "", "source_side": "unknown", "liner": "", "provenance": {}},
)
VELOCITY, STREAMWISE, AREA = "wall_normal_velocity", "streamwise_velocity", "area"
HOLES = ("hole_x", "hole_z", "hole_diameter")
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
UNITS = {row.field: row.unit for row in variables_of(VelocityPlane) if not row.dims and row.field != "start"}
STATED = UNITS | FLUID_UNITS
SAME = 1e-6  # relative: an attribute as text, and the variable of its name
REMEDIES = {
    "torchliner pressure": "; use torchliner insitu",
    "torchliner moments": ": moments of |v|, and this needs the samples, which are gone; "
    "name the plane that was reduced (educe takes moments)",
}
NORMAL = rf"(wall|surface|liner)[ _-]?normal|^normal[ _-]vel|{UPWARD}"
OTHER = r"streamwise|spanwise|eastward|northward|mean\b|rms\b"
LETTERS = {"x": "u", "y": "v", "z": "w"}
WALL = r"(?: the (?:liner|wall|surface|facesheet))?"
POSITIVE = rf"(away|outwards?)(?: from{WALL})?|(into|towards?|inwards?){WALL}|(up)(?:wards?)?|(down)(?:wards?)?"


def open_plane(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a file of our schema, or of another netCDF-4 or HDF5 file.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: as ``to_plane``.
    """
    path = Path(path)
    with open_file(path) as file:
        return to_plane(fields_of_hdf5(file, path), file.attrs, path, request, partial(hold_open, path))


FORMAT = PlaneFormat(
    "HDF5 or netCDF-4",
    lambda _, head: head.startswith(HDF5_SIGNATURE),
    open_plane,
    ("variable", "group", "axes", "velocity_units", "length_units", "sampling_rate", "normal", "row"),
)


def to_plane(
    fields: Fields, attributes: Mapping[str, Any], path: Path, request: PlaneRequest, opens: Opener
) -> VelocityPlane:
    """The one way from the variables of a file or dataset to a plane.

    Args:
        fields, attributes: of the file, by name.
        path: how messages call it.
        request: what the user states.
        opens: the file again, by whoever reads the velocity.
    Raises:
        ValueError: a variable is missing, was never written, has a wrong shape or no or wrong units, or time is not
            uniform; the message names FILE:/variable.
    """
    head = Field(None, path, "/", attributes)
    schema = head.text("schema") or ""
    if f"/{VELOCITY}" not in fields and schema.startswith("torchliner "):
        raise ValueError(
            f"{path} is no velocity plane but a file of schema {schema!r}{REMEDIES.get(schema.rpartition(' ')[0], '')}"
        )
    velocity = _velocity(fields, request, path)
    lead, ours = velocity.name.rpartition("/")[0], velocity.short == VELOCITY
    factor = velocity.signal_factor("m/s", request.velocity_units)
    rate, samples, first, clock = request.sampling_rate, None, 0.0, None
    if (times := find_times(velocity, fields)) is not None:
        rate, samples, first, clock = read_times(times, request.sampling_rate)
    layout = find_layout(velocity, fields, request, samples)
    if rate is None:
        raise ValueError(f"{velocity.label} has no times; give sampling_rate=..., in Hz")
    # Elsewhere a field may bear the name of one of our numbers: density over time and place.
    own = {name: fields.get(f"{lead}/{name}") if ours else None for name in (STREAMWISE, AREA, *HOLES)}
    stream, area = own.pop(STREAMWISE), own.pop(AREA)
    holes: dict[str, Any] = {name[5:]: each.si("m") for name, each in own.items() if each is not None}
    if holes and not {"x", "diameter"} <= {*holes}:
        raise ValueError(f"{path}: holes are {', '.join(HOLES)}, without z for slits; only some of them are there")
    case = find_places(velocity, layout, fields, request, strict=ours) | _case(fields, head, velocity, lead, ours)
    row = request.row or 0
    part = {} if layout.taken is None else {layout.taken: slice(row, row + 1)}
    sign = _sign(velocity, request, ours and schema.startswith("torchliner "))
    with naming(path):
        return VelocityPlane(
            velocity_of(velocity, opens, layout.order, sign * factor, clock, part),
            sampling_rate=rate,
            start=first,
            streamwise=stream and velocity_of(stream, opens, layout.order, stream.signal_factor("m/s")),
            area=area and area.si("m2"),
            holes=Holes(**holes) if holes else None,
            name=velocity.label,
            reference=_references(fields),
            **case,
        )


# The velocity and its sign


def _velocity(fields: Fields, request: PlaneRequest, path: Path) -> Field:
    """The wall-normal velocity: named so, or by the user; else by standard_name, component or as the only one."""
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
    best = [each for each in timed if says(each, NORMAL)]
    if not best and request.normal:
        best = [each for each in timed if says(each, _component(request.normal.strip("-")))]
    best = best or [each for each in timed if not says(each, OTHER)]
    if len(best) == 1 and (request.normal or not says(best[0], f"{_component('x')}|{OTHER}")):
        return best[0]
    described = [
        f"{each.name.removeprefix(lead)} ({', '.join(filter(None, (_size(each), each.text('units'))))})"
        for each in best or found or there.values()
    ]
    listed = "; ".join(described) or "nothing"
    if not found:
        raise (ValueError if there else Unwritten)(
            f"{path} holds no velocity above a wall, {VELOCITY} or one with units of a velocity; "
            f"it holds: {listed}. Name it: variable=..., and if it has no units velocity_units=..."
        )
    raise ValueError(
        f"{path}: {len(best) or 'none'} of its velocities may be normal to the wall: {listed}; name it: variable=..."
    )


def _size(field: Field) -> str:
    return "x".join(map(str, field.shape)) or "a number"


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


def _component(axis: str) -> str:
    """Names of one component of the velocity: v, v_y, Vy, y_velocity, velocity_y, YVelocity."""
    return rf"^({LETTERS[axis]}|([uv]|vel|velocity)[ _-]?{axis}|{axis}[ _-]?vel(ocity)?)\b"


def _sign(velocity: Field, request: PlaneRequest, ours: bool) -> float:
    """-1 where the data are positive into the liner: what ``positive`` says of it counts before the user's normal.

    Args:
        velocity: its ``positive`` says "away from the liner", "into the liner", "up" or "down".
        request: its ``normal`` counts for an axis.
        ours: the file is of our schema: positive away.
    Raises:
        ValueError: ``positive`` says something else; a normal that would turn data which are positive away, or of
            another component.
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
    down = down or says(velocity, r"^downward_")
    return -1.0 if into or (not away and bool(down) != turned) else 1.0


# The case


def _case(fields: Fields, head: Field, velocity: Field, lead: str, ours: bool) -> dict[str, Any]:
    """Attributes of the file; numbers of the case and the gas: variables, or attributes of file and velocity, in SI
    units or with a unit, "1.4 kHz".

    Raises:
        ValueError: as ``Field.number``; an attribute is no number, or differs from the variable of its name.
    """
    found: dict[str, Any] = KIND.read_head(head, head.path)  # type: ignore[arg-type]  # it has attributes
    found["title"] = found["title"] or head.path.stem
    for name, unit in STATED.items():
        for where in dict.fromkeys(("", lead)):
            each = fields.get(f"{where}/{name}")
            if each is not None and (ours or each.size == 1):
                found[name] = each.number(unit)
        for owner in (head, velocity):
            words, *units = (owner.text(name) or "").split(maxsplit=1) or [""]
            if not words:
                continue
            label = f"{owner.label}: attribute {name!r}"
            try:
                number = float(words)
            except ValueError:
                raise ValueError(f"{label} is {owner.text(name)!r}; a number is needed, with its unit") from None
            number *= si_factor(SI_QUANTITY[unit], units[0] if units else unit, label)
            if not math.isclose(found.setdefault(name, number), number, rel_tol=SAME):
                raise ValueError(f"{label} is {number:.9g} {unit}, {name} is {found[name]:.9g} elsewhere; correct one")
    return found | {"fluid": Fluid(**{name: found.pop(name) for name in FLUID_UNITS if name in found})}


def _references(fields: Fields) -> dict[str, complex]:
    """Impedances known from elsewhere, by name."""
    found = {}
    for name, each in fields.items():
        if named := re.fullmatch(r"(/reference_(.*)_)(resistance|reactance)", name):
            other = fields.get(named[1] + ("reactance" if named[3] == "resistance" else "resistance"))
            if other is None:
                raise ValueError(f"{each.label} stands without the other part of its impedance; restore or remove it")
            if named[3] == "resistance":
                found[each.text("label") or named[2].replace("_", " ")] = complex(each.number("1"), other.number("1"))
    return found
