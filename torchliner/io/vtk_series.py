"""Series of VTK files: a ParaView collection (.pvd, .series), numbered files, or their folder."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from itertools import groupby
from pathlib import Path

import numpy as np

from torchliner.file_checks import naming
from torchliner.io.axes import uniform_rate
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.point_layout import length_factor, named, velocity_factor
from torchliner.io.surface_frames import plane_of_frames, read_whole
from torchliner.io.text_rows import bytes_at, last_digit
from torchliner.io.vtk_files import is_vtk, parse_vtk
from torchliner.io.vtk_xml import ATTRIBUTE, TAG
from torchliner.records import VelocityPlane

ENDINGS = (".vtp", ".vtk", ".vtu", ".vti", ".vts")
HEAD = 1 << 14  # bytes that hold the time of a frame
NUMBER = re.compile(r"(.*?)(\d+)")
XML_TIME = re.compile(rb"Name=[\"']TimeValue[\"'][^>]*format=[\"']ascii[\"'][^>]*>\s*([^\s<]+)")
LEGACY_TIME = re.compile(rb"\bTIME(?:VALUE)? 1 1 (float|double)\n", re.IGNORECASE)


def recognises(path: Path, head: bytes) -> bool:
    """A VTK file, a collection of them, or a folder that holds some."""
    if path.is_dir():
        with suppress(OSError):
            return any(each.suffix in (*ENDINGS, ".pvd") for each in path.iterdir())
        return False
    return is_vtk(head) or b'"file-series-version"' in head


def open_series(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a series of VTK files.

    Args:
        path: collection, any of the numbered files, or their folder.
        request: units of length and velocity, which VTK does not state; ``group`` names the series
            where a folder has several; ``sampling_rate`` where no file states its time.
    Raises:
        ValueError: a unit or the rate is missing; several series; fewer than two frames; as
            ``uniform_rate`` and ``plane_of_frames``.
    """
    factor, length = velocity_factor(request, f"{path}"), length_factor(request, f"{path}")
    with naming(path):
        paths, times = _series(path, request.group)
    if len(paths) < 2:
        raise ValueError(f"{path} is one frame; a plane needs the series: numbered files of one "
                         "name, or a .pvd of them")  # fmt: skip
    absent = [each for each in paths if not each.is_file()]
    if absent:
        raise ValueError(f"{path}: {len(absent)} frames of {len(paths)} are not there, the first "
                         f"{absent[0]}; restore them")  # fmt: skip
    rate, start = request.sampling_rate, 0.0
    if rate is None:
        stamps = times if times is not None else [_time(each) for each in paths]
        known = np.array([np.nan if each is None else each for each in stamps])
        if np.isnan(known).any():
            raise ValueError(f"{paths[int(np.isnan(known).argmax())]} states no time (TimeValue); "
                             "state sampling_rate=... (--sampling-rate HZ)")  # fmt: skip
        rate = uniform_rate(known, f"{path}, times", last_digit(known, 7))
        start = float(known[0])
    return plane_of_frames(
        paths, parse_vtk, request, rate, path, factor, length, start=start, format="VTK series"
    )


def _series(path: Path, group: str | None) -> tuple[list[Path], list[float | None] | None]:
    """Files of a series in order, and their times where a collection states them."""
    if path.is_dir():
        found = sorted(each for each in path.iterdir() if each.suffix == ".pvd")
        names = sorted({_stem(each) for each in path.iterdir() if each.suffix in ENDINGS})
        if group is None and len(found) != 1 and len(names) > 1:
            raise ValueError(f"{path} holds the series {', '.join(names)}; name one as group "
                             "(--group)")  # fmt: skip
        if group is None and len(found) == 1:
            return _series(found[0], None)
        name = group or names[0]
        if name not in names:
            raise ValueError(f"{path} holds the series {', '.join(names)}, no {name!r}")
        return _numbered(path, name), None
    head = bytes_at(path, 0, 1024)
    if b'"file-series-version"' in head:
        files = json.loads(read_whole(path))["files"]
        rows = [(float(each["time"]), str(each["name"])) for each in files]
    elif b"Collection" in head:
        tags = [{k.decode(): (a or b).decode() for k, a, b in ATTRIBUTE.findall(tag[3])}
                for tag in TAG.finditer(read_whole(path)) if tag[2] == b"DataSet"]  # fmt: skip
        rows = [(float(each["timestep"]), each["file"]) for each in tags]
    else:
        return _numbered(path.parent, _stem(path), path.suffix), None
    twice = [time for time, each in groupby(sorted(rows), lambda row: row[0]) if len([*each]) > 1]
    if twice:
        raise ValueError(f"{path} has several files for the time {twice[0]:g}, parts of one frame; "
                         "write each surface in one file, or a collection of its own")  # fmt: skip
    rows.sort()
    return [path.parent / name for _, name in rows], [time for time, _ in rows]


def _stem(path: Path) -> str:
    """Name without the number at its end."""
    found = NUMBER.fullmatch(path.stem)
    return found[1] if found else path.stem


def _numbered(folder: Path, name: str, suffix: str = "") -> list[Path]:
    """Files of one name in the order of their numbers."""
    endings = (suffix,) if suffix else ENDINGS
    found = [each for each in folder.iterdir() if each.suffix in endings and _stem(each) == name]
    return sorted(found, key=lambda each: (len(each.stem), each.stem))


def _time(path: Path) -> float | None:
    """Time that a frame states in its first bytes, s."""
    head = bytes_at(path, 0, HEAD)
    found = XML_TIME.search(head)
    with suppress(ValueError):
        if found is not None:
            return float(found[1])
        found = LEGACY_TIME.search(head)
        if found is not None and b"\nBINARY" in head[:512]:
            kind = np.dtype(">f8" if found[1].lower() == b"double" else ">f4")
            return float(np.frombuffer(head, kind, 1, found.end())[0])
        if found is not None:
            return float(head[found.end() :].split(None, 1)[0])
    return None


FORMAT = PlaneFormat(
    "VTK series", recognises, named(open_series),
    ("variable", "group", "velocity_units", "length_units", "sampling_rate", "normal"),
)  # fmt: skip
