"""One plane, one file: HDF5 that is valid netCDF-4 at once (docs/formats.md); and planes of all that is like it.

Dimensions (time, z, x), (time, x) or (time, probe); others are read as they are (``plane_layout``). Numbers beside the
velocity are scalar variables or attributes with CF units.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from torchliner.file_checks import naming
from torchliner.fluid import Fluid
from torchliner.io.axes import FLUID_UNITS
from torchliner.io.field_velocity import Opener, velocity_of
from torchliner.io.hdf5 import hold_open, open_file
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.plane_layout import VELOCITY, find_coordinates, find_layout, find_times, find_velocity, sign_of
from torchliner.io.tables import FileKind
from torchliner.io.variables import Field, fields_of_hdf5, read_times
from torchliner.records import VelocityPlane
from torchliner.records.declared import variables_of
from torchliner.records.holes import Holes
from torchliner.units import SI_QUANTITY, si_factor

KIND = FileKind(
    "torchliner plane 1",
    "velocity plane",
    {"title": "", "source_side": "unknown", "liner": "", "provenance": {}},
)
STREAMWISE, AREA = "streamwise_velocity", "area"
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


def recognises(path: Path, head: bytes) -> bool:
    """Any HDF5 file that no format before this one knows."""
    return head.startswith(HDF5_SIGNATURE)


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
    recognises,
    open_plane,
    ("variable", "group", "axes", "velocity_units", "length_units", "sampling_rate", "normal", "row"),
)


def to_plane(
    fields: Mapping[str, Field], attributes: Mapping[str, Any], path: Path, request: PlaneRequest, opens: Opener
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
    velocity = find_velocity(fields, request, path)
    lead, ours = velocity.name.rpartition("/")[0], velocity.short == VELOCITY
    factor = velocity.signal_factor("m/s", request.velocity_units)
    times = find_times(velocity, fields)
    rate, samples, first, clock = (
        (request.sampling_rate, None, 0.0, None) if times is None else read_times(times, request.sampling_rate)
    )
    layout = find_layout(velocity, fields, request, samples)
    if rate is None:
        raise ValueError(f"{velocity.label} has no times; give sampling_rate=..., in Hz")
    # Elsewhere a field may bear the name of one of our numbers: density over time and place.
    own = {name: fields.get(f"{lead}/{name}") if ours else None for name in (STREAMWISE, AREA, *HOLES)}
    stream, area = own.pop(STREAMWISE), own.pop(AREA)
    holes: dict[str, Any] = {name[5:]: each.si("m") for name, each in own.items() if each is not None}
    case = find_coordinates(velocity, layout, fields, request, strict=ours) | _case(fields, head, velocity, lead, ours)
    row = request.row or 0
    part = {} if layout.taken is None else {layout.taken: slice(row, row + 1)}
    sign = sign_of(velocity, request, ours and schema.startswith("torchliner "))
    if holes and not {"x", "diameter"} <= {*holes}:
        raise ValueError(f"{path}: holes are {', '.join(HOLES)}, without z for slits; only some of them are there")
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


def _case(fields: Mapping[str, Field], head: Field, velocity: Field, lead: str, ours: bool) -> dict[str, Any]:
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


def _references(fields: Mapping[str, Field]) -> dict[str, complex]:
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
