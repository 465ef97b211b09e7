"""Planes from files of any format: recognised by content, joined in time, cut to a part, loaded."""

import glob
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.file_checks import naming, require_regular
from torchliner.io.foreign import read_array
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.plane_parts import JOINED, join_planes, select
from torchliner.io.points import require_velocity
from torchliner.names import PLANE_FORMATS, resolve
from torchliner.records import VelocityPlane
from torchliner.records.origin import series_of
from torchliner.units import si_factor

HEAD = 4096  # bytes by which a file is recognised
KNOWN = [each.name for each in fields(PlaneRequest)]
ANY = ("x", "z", "wall_normal_component", "overlap")  # which every format takes from the user
OF_READING = (JOINED, "overlaps", "selected", "stated", "restated")  # in the provenance


def read_plane(
    path: str | Path | Sequence[str | Path],
    lazy: bool = False,
    *,
    start: float | None = None,
    stop: float | None = None,
    **stated: Any,
) -> VelocityPlane:
    """Read the velocity plane of a file, of any format of ``names.PLANE_FORMATS``.

    Args:
        path: file or folder; or a list or a glob ("run_*.nc") of the restarts of one run, which
            are joined in time; of files of one numbered series any stands for all.
        lazy: leave the velocity in the file, to be read by slabs as it is used.
        start: s; samples from this time on, on the clock of the file.
        stop: s; samples before this time.
        stated: what the files do not say themselves, fields of ``io.plane_format.PlaneRequest``:
            variable, group, axes, velocity_units, length_units, sampling_rate, normal, wall_normal_component,
            x, z, points, overlap.
    Raises:
        OSError: missing, truncated, unreadable, of no format that is known; a glob that matches nothing.
        ValueError: something is missing, has a wrong shape or no or wrong units; times are not uniform; files do not
            join; nothing is selected. The message names FILE:/variable.
    """
    request = PlaneRequest(**stated)
    planes: list[VelocityPlane] = []
    seen: set[str] = set()  # files of series, of which any file stands for all
    for each in paths_of(path):
        if os.path.abspath(each) not in seen:
            planes.append(open_plane(each, request))
            seen.update(os.path.abspath(frame) for frame in series_of(each))
    if not planes:
        raise ValueError("the list of plane files is empty; name at least one")
    plane = select(join_planes(planes, request.overlap or "refuse"), start, stop)
    return plane if lazy else plane.load()


def paths_of(path: str | Path | Iterable[str | Path]) -> list[Path]:
    """The files that a path, a list or a glob names; a FileNotFoundError where a glob matches nothing."""
    if not isinstance(path, str | os.PathLike):
        return [one for each in path for one in paths_of(each)]
    text = os.fspath(path)
    if glob.escape(text) == text or os.path.lexists(text):
        return [Path(path)]
    matched = sorted(glob.glob(text, recursive=True))
    if not matched:
        raise FileNotFoundError(f"{text}: no file matches")
    return [Path(each) for each in matched]


def format_of(path: str | Path) -> PlaneFormat:
    """The first format that recognises a file or folder; an OSError where there is none, or no file."""
    path, head = Path(path), b""
    if not path.is_dir():
        require_regular(path)
        with naming(path), path.open("rb") as file:
            head = file.read(HEAD)
    formats: list[PlaneFormat] = [resolve(home) for home in PLANE_FORMATS.values()]
    for each in formats:
        with suppress(OSError, ValueError):
            if each.recognises(path, head):
                return each
    looks = f"begins with {head[:20]!r}" if head else "is empty"
    if path.is_dir():
        looks = f"is a folder of {', '.join(sorted(os.listdir(path))[:3]) or 'nothing'} ..."
    raise OSError(f"{path} {looks}; it is of no format of planes that is known: {', '.join(f.name for f in formats)}")


def open_plane(path: str | Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of one file or folder, its velocity left there. Every error names the path; beside those of the
    format, a ValueError where the user states what the format does not take."""
    found = format_of(path)
    given = {name: value for name in KNOWN if (value := getattr(request, name)) is not None}
    for name in given:
        if name not in (*found.takes, *ANY):
            raise ValueError(f"{path} is {found.name}, which says {name} itself or has none: leave out {name}=...")
    with naming(path):
        plane: VelocityPlane = found.open(Path(path), request)
    require_velocity(plane.name, request)
    # What a converted file tells is of the reading before it was written, not of this one.
    kept: dict[str, Any] = {key: value for key, value in plane.provenance.items() if key not in OF_READING}
    words = {name: str(value) for name, value in given.items() if isinstance(value, str | int | float | os.PathLike)}
    kept |= {"stated": words} if words else {}
    about = {name: _coordinate(given[name], request.length_units, name) for name in "xz" if name in given}
    return replace(plane, provenance=kept, **about)


def _coordinate(where: Any, unit: str | None, name: str) -> Any:
    """Coordinates, m, from an array or FILE or FILE:VARIABLE, in a unit that the user states."""
    factor = si_factor("length", unit, f"{name}: length_units=..., which")
    if isinstance(where, str | os.PathLike):
        file, _, inside = os.fspath(where).partition(":")
        where = read_array(file, inside or None)
    return factor * np.asarray(where, float)
