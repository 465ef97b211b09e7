"""Which variable of a netCDF-like file is the velocity, and its sign.

CF conventions 1.8: units, ``standard_name``; our own schema is the case in which the name alone
says it.
"""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py

from torchliner.file_checks import Unwritten
from torchliner.io.cf_axes import UPWARD, is_time, says
from torchliner.io.hdf5 import get_group, is_there, text_attribute
from torchliner.io.plane_format import PlaneRequest
from torchliner.names import did_you_mean
from torchliner.units import si_factor

VELOCITY = "wall_normal_velocity"
NORMAL = rf"(wall|surface|liner)[ _-]?normal|\bnormal[ _-](vel|to)|{UPWARD}"
OTHER = r"streamwise|spanwise|eastward|northward|\bmean\b|_mean\b|\brms\b|_rms\b"
LETTERS = {"x": "u", "y": "v", "z": "w"}
# What an attribute ``positive`` says of the liner, and of the axis; long names and units may too.
INTO, AWAY = r"\b(into|towards?|inwards?)\b", r"\b(away|outwards?|out of)\b"
WALL, DUCT = "(wall|liner|surface|facesheet)", "(duct|flow|channel|stream)"
TOWARDS, OUT = r"\b(into|towards?)( the)?", r"\b(away from|out of)( the)?"
DOWN, UP = r"\bdown(wards?)?\b", r"\bup(wards?)?\b"


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
        raise (ValueError if there else Unwritten)(
            f"{path} holds no velocity above a wall, {VELOCITY} or one with units of a velocity; "
            f"it holds: {listed}. Name it: variable=..., and if it has no units velocity_units=..."
        )
    raise ValueError(
        f"{path}: {len(best) or 'none'} of its velocities may be normal to the wall: {listed}; name it: variable=..."
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


def _component(axis: str) -> str:
    """Names of one component of the velocity: v, v_y, Vy, y_velocity, velocity_y, YVelocity."""
    return rf"^({LETTERS[axis]}|([uv]|vel|velocity)[ _-]?{axis}|{axis}[ _-]?vel(ocity)?)\b"


def _described(dataset: h5py.Dataset, key: str) -> str:
    unit = text_attribute(dataset, "units")
    shape = "x".join(map(str, dataset.shape or ())) or "a number"
    return f"{key} ({shape}{'' if unit is None else f', {unit}'})"


def sign_of(dataset: h5py.Dataset, key: str, request: PlaneRequest, label: str) -> float:
    """-1 where the data are positive into the liner: what they say of it counts before the user's
    normal, which counts for an axis.

    Raises:
        ValueError: an attribute ``positive`` that says neither; a normal that would turn data which
            are positive away, as files of our schema are.
    """
    schema = text_attribute(dataset.file, "schema") or ""
    ours = "away, by its schema" if key == VELOCITY and schema.startswith("torchliner ") else ""
    words = (text_attribute(dataset, "positive") or ours).strip().lower()
    turned_by_user = (request.normal or "").startswith("-")
    others = " ".join(text_attribute(dataset, name) or "" for name in ("long_name", "units")).lower()
    said = "positive" in others or re.search(rf"({TOWARDS}|{OUT}) {WALL}", others)
    for text in (words, others if said else ""):
        # Into the duct is away from the liner.
        turned = re.sub(rf"{TOWARDS} {DUCT}", "away", re.sub(rf"{OUT} {DUCT}", "inward", text))
        into, away = (re.search(each, turned) is not None for each in (INTO, AWAY))
        if away and not into and turned_by_user:
            raise ValueError(
                f"{label} says {text!r}, so that it is positive away from the liner, and "
                f"normal={request.normal!r} would turn it; leave the sign out, or correct the file"
            )
        if into != away:
            return -1.0 if into else 1.0
    if words and not (re.search(DOWN, words) or re.search(UP, words)):
        raise ValueError(
            f"{label}: positive is {words!r}; write 'away from the liner' or 'into the liner' (or 'up', 'down')"
        )
    down = re.search(DOWN, words) is not None or says(dataset, key, r"\bdownward_")
    return -1.0 if down != turned_by_user else 1.0
