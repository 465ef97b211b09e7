"""The one way from variables to a plane. It answers in this order, by names and what CF 1.8 lays down (units,
standard_name, positive), never by prose: which variable is the wall-normal velocity, in what units; what its clock is;
which of its axes is what, and where the probes stand; what the case is; which way the velocity is positive.

Dimensions are (time, z, x), (time, x) or (time, probe), in any order. Numbers beside the velocity are scalar variables
or attributes with CF units (docs/formats.md).
"""

from __future__ import annotations

import re
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from torchliner.file_checks import Unwritten, naming
from torchliner.fluid import Fluid
from torchliner.io.axes import FLUID_UNITS
from torchliner.io.hdf5 import hold_open, open_file
from torchliner.io.plane_format import HDF5_SIGNATURE, PlaneFormat, PlaneRequest
from torchliner.io.plane_layout import ROLES, UPWARD, find_layout, find_places, find_times, role_of, says
from torchliner.io.points import component_of, require_direction
from torchliner.io.tables import FileKind
from torchliner.io.variable_velocity import velocity_of
from torchliner.io.variables import Field, Source, fields_of_hdf5, read_times, references_of
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
UNITS = {row.field: row.unit for row in variables_of(VelocityPlane) if not row.dims and row.field != "start"}
STATED = UNITS | FLUID_UNITS
REMEDIES = {
    "torchliner pressure": "; use torchliner insitu",
    "torchliner moments": ": moments of |v|, and this needs the samples, which are gone; "
    "name the plane that was reduced (educe takes moments)",
}
NORMAL = rf"(wall|surface|liner)[ _-]?normal|^normal[ _-]vel|{UPWARD}"
OTHER = r"streamwise|spanwise|eastward|northward|mean\b|rms\b"
LETTERS = {"x": "u", "y": "v", "z": "w"}
WALL = r"( the (liner|wall|surface|facesheet))?"
AWAY, INTO = rf"(away|outwards?)( from{WALL})?", rf"(into|towards?|inwards?){WALL}"


def open_plane(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a file of our schema, or of another netCDF-4 or HDF5 file; as ``to_plane``."""
    with open_file(path) as file:
        return to_plane(Source(path, fields_of_hdf5(file, path), file.attrs, partial(hold_open, path)), request)


FORMAT = PlaneFormat(
    "HDF5 or netCDF-4",
    lambda _, head: head.startswith(HDF5_SIGNATURE),
    open_plane,
    ("variable", "group", "axes", "velocity_units", "length_units", "sampling_rate", "normal", "row"),
)


def to_plane(source: Source, request: PlaneRequest) -> VelocityPlane:
    """The plane that a file or dataset holds.

    Raises:
        ValueError: a variable is missing, was never written, has a wrong shape or no or wrong units, or time is not
            uniform; the message names FILE:/variable.
    """
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
    rate, samples, first, clock = request.sampling_rate, None, 0.0, None
    if (times := find_times(velocity, fields)) is not None:
        rate, samples, first, clock = read_times(times, request.sampling_rate)
    layout = find_layout(velocity, fields, request, samples)
    if rate is None:
        raise ValueError(f"{velocity.label} has no times; give sampling_rate=..., in Hz")
    case = find_places(velocity, layout, fields, request, strict=ours) | _case(source, head, velocity)
    # Elsewhere a field may bear the name of one of our numbers: density over time and place.
    lead = velocity.name.rpartition("/")[0]
    own = {name: fields[f"{lead}/{name}"] for name in (STREAMWISE, AREA, *HOLES) if ours and f"{lead}/{name}" in fields}
    if stream := own.pop(STREAMWISE, None):
        case["streamwise"] = velocity_of(stream, source.opens, layout.order, stream.signal_factor("m/s"))
    if area := own.pop(AREA, None):
        case["area"] = area.si("m2")
    if own:
        if not {"hole_x", "hole_diameter"} <= {*own}:
            raise ValueError(f"{path}: holes are {', '.join(HOLES)}, without z for slits; only some of them are there")
        holes: dict[str, Any] = {name[5:]: each.si("m") for name, each in own.items()}
        case["holes"] = Holes(**holes)
    row = request.row or 0
    part = {} if layout.taken is None else {layout.taken: slice(row, row + 1)}
    sign = _sign(velocity, request, ours and schema.startswith("torchliner "))
    with naming(path):
        return VelocityPlane(
            velocity_of(velocity, source.opens, layout.order, sign * factor, clock, part),
            sampling_rate=rate,
            start=first,
            name=velocity.label,
            reference=references_of(fields),
            **case,
        )


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
    timed = [each for each in found if "time" in (role_of(axis, source.fields) for axis in each.axes)] or found
    best = [each for each in timed if says(each, NORMAL)]
    if not best and request.normal:
        best = [each for each in timed if says(each, _component(request.normal.strip("+-")))]
    best = best or [each for each in timed if not says(each, OTHER)]
    if len(best) == 1 and (request.normal or not says(best[0], f"{_component('x')}|{OTHER}")):
        return best[0]
    listed = "; ".join(
        f"{each.name.removeprefix(lead)} ({'x'.join(map(str, each.shape)) or 'a number'}, {each.text('units')})"
        for each in best or found or there.values()
    )
    if found:
        raise ValueError(
            f"{source.path}: {len(best) or 'none'} of its velocities may be normal to the wall: {listed}; name it: "
            "variable=..."
        )
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


def _component(axis: str) -> str:
    """Names of one component of the velocity: v, v_y, Vy, y_velocity, velocity_y, YVelocity."""
    return rf"^({LETTERS[axis]}|([uv]|vel|velocity)[ _-]?{axis}|{axis}[ _-]?vel(ocity)?)\b"


def _sign(velocity: Field, request: PlaneRequest, ours: bool) -> float:
    """-1 where the data are positive into the liner: what the attribute ``positive`` says of it, or the schema of
    ``ours``, counts before the user's normal, and against it is a ValueError."""
    require_direction(velocity.label, component_of(velocity.short), request.normal)
    words = (velocity.text("positive") or ("away" if ours else "")).strip().lower()
    turned = (request.normal or "").startswith("-")
    if re.fullmatch(AWAY, words) and turned:
        raise ValueError(
            f"{velocity.label} is positive {words}{' by its schema' if ours else ''}, and normal="
            f"{request.normal!r} would turn it; leave the sign out, or correct the file"
        )
    if re.fullmatch(f"{AWAY}|{INTO}", words):
        return -1.0 if re.fullmatch(INTO, words) else 1.0
    if not re.fullmatch("((up|down)(wards?)?)?", words):
        raise ValueError(
            f"{velocity.label}: positive is {words!r}; write 'away from the liner', 'into the liner', 'up' or 'down'"
        )
    down = words.startswith("down") or says(velocity, r"^downward_")
    return -1.0 if down != turned else 1.0


def _case(source: Source, head: Field, velocity: Field) -> dict[str, Any]:
    """Attributes of the file; numbers of the case and the gas: variables, or attributes of velocity and file, in SI
    units or with a unit, "1.4 kHz"."""
    found: dict[str, Any] = KIND.read_head(head, head.path)  # type: ignore[arg-type]  # it has attributes
    found["title"] = found["title"] or head.path.stem
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
