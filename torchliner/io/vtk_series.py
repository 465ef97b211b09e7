"""Series of VTK files: a ParaView collection (.pvd, .series), numbered files, or their folder."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from contextlib import suppress
from decimal import Decimal
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from torchliner.file_checks import naming
from torchliner.io.clocks import clock_of, uniform_rate
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.point_layout import length_factor, named, velocity_factor
from torchliner.io.surface_frames import plane_of_frames, read_whole
from torchliner.io.text_rows import bytes_at, last_digit
from torchliner.io.vtk_frames import is_vtk, parse_vtk, vtk_parser
from torchliner.records import VelocityPlane
from torchliner.records.numbered_files import numbered_series

ENDINGS = (".vtp", ".vtk", ".vtu", ".vti", ".vts", ".vtr")
LISTS = (".vtm", ".vtmb", ".pvtp", ".pvtu", ".pvti", ".pvts")  # of files that hold parts of a frame
HEAD = 1 << 14  # bytes that hold the time of a frame
XML_TIME = re.compile(rb"Name=[\"']TimeValue[\"'][^>]*format=[\"']ascii[\"'][^>]*>\s*([^\s<]+)")
STATED = re.compile(rb"Name=[\"']TimeValue[\"']")
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
            where a folder has several; ``sampling_rate`` where none states its time, or not in s.
    Raises:
        ValueError: a unit or the rate is missing; several series; fewer than two frames; frames
            are missing; as ``clock_of`` and ``plane_of_frames``.
    """
    factor, length = velocity_factor(request, f"{path}"), length_factor(request, f"{path}")
    with naming(path):
        paths, times, numbers = _series(path, request.group)
    if len(paths) < 2:
        raise ValueError(f"{path} is one frame; a plane needs the series: numbered files of one "
                         "name, or a .pvd of them")  # fmt: skip
    absent = [each for each in paths if not each.is_file()]
    if absent:
        raise ValueError(f"{path}: {len(absent)} frames of {len(paths)} are not there, the first "
                         f"{absent[0]}; restore them")  # fmt: skip
    stamps: list[Any] = times or [_time(each) for each in paths]
    known = np.array(stamps, np.float64)
    rate, start = request.sampling_rate, 0.0
    if not np.isnan(known).any():
        rate, start = clock_of(known, f"{path}, times", rate, last_digit(known, 7))
    elif rate is None or not numbers:
        raise ValueError(f"{paths[int(np.isnan(known).argmax())]} states no time (TimeValue); "
                         "state sampling_rate=... (--sampling-rate HZ)")  # fmt: skip
    else:
        _require_all(paths, numbers, path)
    return plane_of_frames(
        paths, vtk_parser(paths[0]), request, rate, path, factor, length, start=start, format="VTK series"
    )


def _series(path: Path, group: str | None) -> tuple[list[Path], list[float], list[Decimal]]:
    """Files of a series in order; their times where a collection states them, else numbers."""
    if path.is_dir():
        found = sorted(each for each in path.iterdir() if each.suffix == ".pvd")
        series = numbered_series(path, ENDINGS)
        names = ", ".join(sorted(series))
        if group is None and len(found) == 1:
            return _series(found[0], None)
        files = series.get(group or names)
        if files is None:
            raise ValueError(f"{path} holds the series {names or 'none'}"
                             f"{'' if group is None else f', no {group!r}'}; name one as group "
                             "(--group)")  # fmt: skip
        return [*files], [], [*files.values()]
    head = bytes_at(path, 0, 1024)
    if b'"file-series-version"' in head:
        listed = json.loads(read_whole(path))["files"]
        rows = [(float(each["time"]), str(each["name"])) for each in listed]
    elif b"Collection" in head:
        rows = [(float(tag.attrib["timestep"]), tag.attrib["file"])
                for tag in _tags(path).iter("DataSet")]  # fmt: skip
    elif path.suffix in LISTS:
        raise ValueError(f"{path} lists the pieces of a frame, which is not read: merge them into "
                         "one .vtp or .vtu a frame, or name those of one surface in a .pvd"
                         )  # fmt: skip
    else:
        series = numbered_series(path.parent, (path.suffix,))
        files = next((files for files in series.values() if path in files), {path: Decimal(0)})
        return [*files], [], [*files.values()]
    twice = [time for time, each in groupby(sorted(rows), lambda row: row[0]) if len([*each]) > 1]
    if twice:
        raise ValueError(f"{path} has several files for the time {twice[0]:g}, parts of one frame; "
                         "write each surface in one file, or a collection of its own")  # fmt: skip
    rows.sort()
    return [path.parent / name for _, name in rows], [time for time, _ in rows], []


def _tags(path: Path) -> ElementTree.Element:
    """Root of a collection.

    Raises:
        ValueError: it is no XML, or not all of one.
    """
    try:
        return ElementTree.fromstring(read_whole(path))
    except ElementTree.ParseError as error:
        raise ValueError(f"{path} is no whole XML: {error}; if its writing was broken off, write "
                         "it again or close its tags") from error  # fmt: skip


def _require_all(paths: Sequence[Path], numbers: Sequence[Decimal], path: Path) -> None:
    """Refuse names whose numbers show that frames are missing; uneven counts of steps may pass.

    Raises:
        ValueError: whole numbers have a gap in a constant step; decimals are not uniform.
    """
    digits = min(int(each.as_tuple().exponent) for each in numbers)
    if digits < 0:  # Solvers round times, and leave zeros at their end away.
        times = np.array(numbers, np.float64)
        uniform_rate(times, f"{path}, numbers in the names", max(10.0**digits, last_digit(times, 0)))
        return
    counts = [int(each) for each in numbers]
    steps = [high - low for low, high in pairwise(counts)]
    usual = sorted(steps)[(len(steps) - 1) // 2]
    if min(steps) == 0:
        at = steps.index(0)
        raise ValueError(f"{path}: {paths[at].name} and {paths[at + 1].name} have one number; "
                         "leave one of them there")  # fmt: skip
    gaps = [(low, high) for low, high in pairwise(counts) if high - low > usual]
    if gaps and not any(step % usual for step in steps):
        first = range(gaps[0][0] + usual, gaps[0][1], usual)[:3]
        raise ValueError(f"{path}: {sum(steps) // usual - len(steps)} frames are missing, the "
                         f"first of numbers {', '.join(map(str, first))}; restore them, or keep "
                         "one stretch between the gaps")  # fmt: skip


def _time(path: Path) -> float | None:
    """Time that a frame states in its first bytes, s."""
    head = bytes_at(path, 0, HEAD)
    found = XML_TIME.search(head)
    with suppress(ValueError):
        if found is not None:
            return float(found[1])
        if STATED.search(head):  # as bytes, which may stand behind all else
            return parse_vtk(path).time
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
