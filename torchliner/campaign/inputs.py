"""The one place where campaigns open planes, and what tells whether a file is the one of before."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torchliner.io.planes import read_plane
from torchliner.records import VelocityPlane
from torchliner.records.origin import series_of

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
