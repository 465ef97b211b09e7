"""One plane, one file: HDF5 that is valid netCDF-4 at once (docs/formats.md).

Dimensions (time, z, x), (time, x) or (time, probe); others are read as they are (``cf``). Numbers
beside the velocity are scalar variables with CF units.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py

from torchliner.io.axes import FLUID, FLUID_UNITS, float_factor, read_case, read_clock
from torchliner.io.cf import VELOCITY, find_velocity, sign_of
from torchliner.io.cf_axes import find_axes, find_coordinates
from torchliner.io.hdf5 import get_dataset, is_there, open_file, place, read_si, text_attribute
from torchliner.io.hdf5_velocity import H5Velocity
from torchliner.io.holes import stored_holes
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.tables import FileKind, read_variables
from torchliner.records import VelocityPlane
from torchliner.records.declared import Variable, variables_of
from torchliner.units import SI_QUANTITY, si_factor

KIND = FileKind(
    "torchliner plane 1", "velocity plane", {"title": "", "source_side": "unknown", "liner": "", "provenance": {}}
)
STREAMWISE, AREA = "streamwise_velocity", "area"
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
NUMBERS = tuple(row for row in variables_of(VelocityPlane) if not row.dims and row.field != "start")
UNITS = {row.field: row.unit for row in NUMBERS}
STATED = UNITS | FLUID_UNITS
SAME = 1e-6  # relative: an attribute as text, and the variable of its name


def recognises(path: Path, head: bytes) -> bool:
    """Any HDF5 file that no format before this one knows."""
    return head.startswith(HDF5_SIGNATURE)


def open_plane(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a file of our schema, or of another netCDF-4 or HDF5 file.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: a dataset is missing, has a wrong shape or no or wrong units, or time is not
            uniform; the message names FILE:/dataset.
    """
    path = Path(path)
    with open_file(path) as file:
        return plane_from(file, path, request, H5Velocity)


FORMAT = PlaneFormat(
    "HDF5 or netCDF-4",
    recognises,
    open_plane,
    ("variable", "group", "axes", "velocity_units", "length_units", "sampling_rate", "normal"),
)


def plane_from(
    file: h5py.File, path: Path, request: PlaneRequest, stored: Callable[[Path, str, tuple[int, ...], float], Any]
) -> VelocityPlane:
    """What a file says, as HDF5 or put into its terms.

    Args:
        file, path: what is read, and how messages call it.
        request: what the user states.
        stored: velocity from the path, its name, the axes as of ``cf.Axes`` and a factor.
    """
    schema = text_attribute(file, "schema") or ""
    if not is_there(file, VELOCITY, path) and schema.startswith("torchliner "):
        remedies = {
            "torchliner pressure": "; use torchliner insitu",
            "torchliner moments": ": moments of |v|, and this needs the samples, which are gone; "
            "name the plane that was reduced (educe takes moments)",
        }
        raise ValueError(
            f"{path} is no velocity plane but a file of schema {schema!r}" + remedies.get(schema.rpartition(" ")[0], "")
        )
    where, _, key = find_velocity(file, request, path).rpartition("/")
    group = file[where or "/"]
    label, dataset = place(group, key, path), get_dataset(group, key, path)
    factor = float_factor(group, key, "m/s", path, request.velocity_units)
    axes = find_axes(group, key, request, path)
    rate, _, first = (
        (request.sampling_rate, 0, 0.0)
        if axes.time is None
        else read_clock(axes.time.parent, path, axes.time.name.split("/")[-1], request.sampling_rate)
    )
    if rate is None:
        raise ValueError(f"{label} has no times; give sampling_rate=..., in Hz")
    stream = None
    if key == VELOCITY and is_there(group, STREAMWISE, path):
        if get_dataset(group, STREAMWISE, path).shape != dataset.shape:
            raise ValueError(
                f"{path}:/{STREAMWISE} has shape {group[STREAMWISE].shape}, /{VELOCITY} "
                f"{dataset.shape}; they share probes and times"
            )
        stream = stored(path, f"{where}/{STREAMWISE}", axes.order, float_factor(group, STREAMWISE, "m/s", path))
    # Elsewhere a field may bear the name of one of our numbers: density over time and place.
    ours = key == VELOCITY
    case = read_case(file, KIND, _single(file, ours), path, ours)
    if group.name != "/":
        case |= read_variables(group, _single(group, ours), path)
    case = _with_attributes(case, group, dataset, path)
    return VelocityPlane(
        stored(path, f"{where}/{key}", axes.order, sign_of(dataset, key, request, label) * factor),
        sampling_rate=rate,
        start=first,
        streamwise=stream,
        area=read_si(group, AREA, "m2", path) if ours and is_there(group, AREA, path) else None,
        holes=stored_holes(group, path) if ours else None,
        name=label,
        **find_coordinates(group, axes, request, path, strict=ours),
        **case,
    )


def _single(group: h5py.Group, ours: bool) -> list[Variable]:
    """The numbers of the case that a group has; all of them in a file of ours."""
    return [row for row in NUMBERS if ours or getattr(group.get(row.names[0]), "size", 0) == 1]


def _with_attributes(case: dict[str, Any], group: h5py.Group, dataset: h5py.Dataset, path: Path) -> dict[str, Any]:
    """Also the numbers that stand as attributes, and the gas that the velocity's group states.

    Raises:
        ValueError: as ``_attributes``; attribute and variable differ; no gas is like that.
    """
    gas: dict[str, Any] = {}
    for each in (group.file, group):
        rows = [row for row in FLUID if getattr(each.get(row.names[0]), "size", 0) == 1]
        gas |= read_variables(each, rows, path)
    known = case | gas
    for name, (number, words) in _attributes(group.file, dataset, path).items():
        if not math.isclose(known.setdefault(name, number), number, rel_tol=SAME):
            raise ValueError(
                f"{words} is {number:.9g} {STATED[name]}, the variable {name} is {known[name]:.9g}; correct one of them"
            )
    gas = {name: known.pop(name) for name in FLUID_UNITS if name in known}
    return known | {"fluid": replace(case["fluid"], **gas)}


def _attributes(file: h5py.File, dataset: h5py.Dataset, path: Path) -> dict[str, tuple[float, str]]:
    """Numbers of the case that stand as attributes, in SI units or with a unit, "1.4 kHz"; and how
    messages call them."""
    found = {}
    for owner, (name, unit) in itertools.product((file, dataset), STATED.items()):
        text = text_attribute(owner, name)
        if text is None or not (parts := text.split(maxsplit=1)):
            continue
        label = f"{path}:{owner.name}: attribute {name!r}"
        try:
            number = float(parts[0])
        except ValueError:
            raise ValueError(f"{label} is {text!r}; a number is needed, with its unit") from None
        number *= si_factor(SI_QUANTITY[unit], parts[1] if parts[1:] else unit, label)
        found[name] = number, label
    return found
