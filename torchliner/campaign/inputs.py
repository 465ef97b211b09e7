"""The one place where campaigns open planes, and what tells whether a file is the one of before."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torchliner.engine.moments import Moments
from torchliner.io.moments_file import holds_moments, read_moments
from torchliner.io.planes import read_plane
from torchliner.records import VelocityPlane
from torchliner.records.origin import series_of
from torchliner.records.velocity_plane import restated

ENDS = 1 << 20  # bytes at either end of a file that are looked at
NAMED = ("points", "x", "z")  # fields of a request that may name files, FILE or FILE:VARIABLE


def open_plane(path: str | Path, request: Mapping[str, Any] | None = None) -> VelocityPlane:
    """A plane whose velocity stays in its file, under a path that does not depend on the folder.

    Args:
        path: file or folder.
        request: fields of ``PlaneRequest``: what the file does not say.
    Raises:
        OSError, ValueError: as ``read_plane``.
    """
    return read_plane(Path(path).absolute(), lazy=True, **(request or {}))


def open_moments(path: Path, request: Mapping[str, Any]) -> Moments | None:
    """Moments that a plane was reduced to before; None of a file that is no such.

    Raises:
        OSError, ValueError: as ``read_moments``; a request, which is of planes alone.
    """
    if not holds_moments(path):
        return None
    if request:
        raise ValueError(f"{path} holds moments, which are read as they are: leave out {', '.join(request)}")
    return read_moments(path)


def with_case_facts(known: Moments, facts: Mapping[str, Any], name: str) -> Moments:
    """Moments of a plane of which the campaign's file states more, called ``name``.

    Raises:
        ValueError: another tone than the one that their blocks were cut for.
    """
    tone, made = facts.get("frequency"), known.plane.frequency
    if tone is not None and tone != made:
        words = "no tone" if made is None else f"{made:g} Hz"
        raise ValueError(
            f"{name} holds moments that were reduced with {words}, and frequency = {tone:g} is "
            "stated: leave it out, or name the plane that was reduced"
        )
    plane = dataclasses.replace(restated(known.plane, facts), name=name)
    return dataclasses.replace(known, plane=plane)


def data_fingerprint(path: Path, request: Mapping[str, Any]) -> str:
    """Of a plane: its file or folder, the files of its series, and those that the request names."""
    found = [fingerprint(path)]
    found += [f"{p.name} {p.stat().st_size} {p.stat().st_mtime_ns}" for p in series_of(path)]
    for value in map(request.get, NAMED):
        beside = [] if value is None else [Path(str(value)), Path(str(value).rpartition(":")[0])]
        found += [fingerprint(each) for each in beside if each.is_file()]
    return digest(*found)


def fingerprint(path: Path) -> str:
    """Of a file: its size, time of change and both ends; of a folder: of all files in it.

    Raises:
        OSError: it cannot be read.
    """
    found = hashlib.sha256()
    for each in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if not each.is_file():
            continue
        status = each.stat()
        name = str(each.relative_to(path))
        found.update(f"{name} {status.st_size} {status.st_mtime_ns} ".encode())
        with each.open("rb") as file:
            found.update(file.read(ENDS))
            file.seek(max(0, status.st_size - ENDS))
            found.update(file.read(ENDS))
    return found.hexdigest()


def digest(*facts: Any) -> str:
    """Sixteen letters of anything that prints alike each time."""
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:16]
