"""OpenFOAM's sampled surfaces: a folder for each time, in it files of VTK or raw."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.io.clocks import uniform_rate
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.point_layout import SAME, named
from torchliner.io.surface_frames import Frame, FrameArray, Surface, plane_of_frames, read_whole
from torchliner.io.text_rows import SPACES, last_digit, number_of, parse_rows
from torchliner.io.vtk_frames import vtk_parser
from torchliner.records import VelocityPlane

# `# U  FACE_DATA 4`, then `# x y z U_x U_y U_z`.
RAW = re.compile(rb"#\s*(\w+)\s+(FACE|POINT)_DATA\s+(\d+)\s*\n#[^\n]*\n")
RAW_NAME = re.compile(r"(?:U_(.+)|(.+)_U)\.raw")


def time_folders(path: Path) -> tuple[Path, list[Path]]:
    """The folder of a series of time folders in which a path lies, and these in order of time."""
    roots = [path] + [each.parent for each in [path, *path.parents][:3]
                      if number_of(each.name)[0] is not None]  # fmt: skip
    for root in filter(Path.is_dir, roots):
        found = [each for each in root.iterdir() if number_of(each.name)[0] is not None]
        found = [each for each in found if each.is_dir()]
        if found:
            return root, sorted(found, key=lambda each: float(each.name))
    return path, []


def surfaces_of(folder: Path) -> dict[str, list[Path]]:
    """Files, or folders of foamFile, in a time folder by the name of their surface."""
    found: dict[str, list[Path]] = {}
    for each in sorted(folder.iterdir()):
        raw = RAW_NAME.fullmatch(each.name)
        if raw is not None:
            found.setdefault(raw[1] or raw[2], []).append(each)
        elif each.suffix in (".vtp", ".vtk", ".vtu") or (each / "points").is_file():
            found.setdefault(each.stem if each.is_file() else each.name, []).append(each)
    return found


def recognises(path: Path, head: bytes) -> bool:
    """A folder of time folders that hold surfaces, or one of them, or a file in one."""
    with suppress(OSError):
        root, folders = time_folders(path)
        inside = path.relative_to(root).parts
        there = [each for files in surfaces_of(root / inside[0] if inside else folders[0]).values()
                 for each in files] if folders else []  # fmt: skip
        # A folder called 2024 is no time: a surface stands in several of them.
        return bool(there) and (len(inside) < 2 or (
            root / inside[0] / inside[1] in there
            and sum((each / inside[1]).exists() for each in folders[:3]) > 1))  # fmt: skip
    return False


def open_surfaces(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of one surface at all times.

    Args:
        path: ``postProcessing/NAME``, or a file in it, which names the surface.
        request: ``group`` names the surface where there are several.
    Raises:
        ValueError: several surfaces, or none of that name; times without it; as ``uniform_rate``
            and ``plane_of_frames``.
    """
    root, folders = time_folders(path)
    listed = {folder.name: surfaces_of(folder) for folder in folders}
    there = {name: None for found in listed.values() for name in found}
    group, inside = request.group, path.relative_to(root).parts[:2]
    if group is None and len(inside) == 2:
        group = next((name for name, files in listed[inside[0]].items()
                      if root.joinpath(*inside) in files), None)  # fmt: skip
    if group is None and len(there) == 1:
        group = next(iter(there))
    if group is None or group not in there:
        raise ValueError(f"{path} holds the surfaces {', '.join(there)}"
                         f"{'' if group is None else f', no {group!r}'}; name one as group "
                         "(--group)")  # fmt: skip
    absent = [name for name, found in listed.items() if group not in found]
    if absent:
        raise ValueError(f"{root}: {len(absent)} of {len(folders)} times, {', '.join(absent[:3])}, "
                         f"have no surface {group!r}; sample it at all times, or give only those "
                         "that have it")  # fmt: skip
    kinds = [found[group] for found in listed.values()]
    if len({each.suffix for files in kinds for each in files}) > 1:
        raise ValueError(f"{root} has {group!r} in several formats; leave one of them there")
    paths = [files[0] for files in kinds]
    if paths[0].is_dir():
        raise ValueError(
            f"{paths[0]} is a surface in the format foamFile, which is not read: sample with surfaceFormat vtk or raw"
        )
    parse = (raw_parser if paths[0].suffix == ".raw" else vtk_parser)(paths[0])
    time = np.array([float(folder.name) for folder in folders])
    digits = max(number_of(folder.name)[1] for folder in folders)
    if len(time) < 2:
        raise ValueError(f"{root} has one time, {folders[0].name}; two at least are needed")
    rate = uniform_rate(time, f"{root}, times", last_digit(time, digits))
    return plane_of_frames(
        paths, parse, request, rate, root, format=f"OpenFOAM surface {group}",
        start=float(time[0]),
    )  # fmt: skip


def raw_parser(first: Path) -> Callable[[Path], Frame]:
    """The function that parses `raw` files, their rows in the order of those of the first."""
    return partial(parse_raw, first=first, points=parse_raw(first).surface().points)


def parse_raw(path: Path, first: Path | None = None, points: np.ndarray | None = None) -> Frame:
    """A file `# U FACE_DATA 4`, `# x y z U_x U_y U_z` and its rows, in the order of ``points``."""
    text = read_whole(path)
    head = RAW.match(text)
    if head is None:
        raise ValueError(f"{path} begins with {text[:30]!r}, not '# U FACE_DATA N'")
    count, rows = int(head[3]), text[head.end() :].translate(SPACES)
    width = len(rows.partition(b"\n")[0].split())
    if width not in (4, 6):
        raise ValueError(f"{path}: rows have {width} numbers; x y z and one or three values are needed")

    def found() -> np.ndarray:
        table = parse_rows(rows, width, str(path))
        if len(table) != count:
            raise ValueError(f"{path}: {len(table)} rows; {count} are needed")
        return table

    def values(axis: int) -> np.ndarray:
        table = found()
        return table[:, 3 + axis] if points is None else table[same_places(table, points, path, first), 3 + axis]

    # Its points are centres already where values lie on faces.
    array = FrameArray(False, count, width - 3, values)
    return Frame(lambda: Surface(found()[:, :3]), {head[1].decode(): array})


def same_places(rows: np.ndarray, points: np.ndarray, path: Path, first: Path | None) -> Any:
    """Which of ``rows``, x y z ..., is at each of the points, as a restart on other cores has them
    in another order; a slice of all where they stand as they are.

    Raises:
        ValueError: they are at other points.
    """
    near = SAME * np.abs(points).max()
    if (np.abs(rows[:, :3] - points) <= near).all():
        return slice(None)
    order = np.empty(len(points), np.int64)
    order[np.lexsort(points.T)] = np.lexsort(rows[:, :3].T)
    if (np.abs(rows[order, :3] - points) > near).any():
        known = set(map(tuple, points.tolist()))
        row = next((i for i, p in enumerate(rows[:, :3].tolist()) if tuple(p) not in known), 0)
        nearest = np.abs(points - rows[row, :3]).max(1).argmin()
        here, there = (" ".join(f"{n:.9g}" for n in p) for p in (rows[row, :3], points[nearest]))
        raise ValueError(
            f"{path}, row {row + 1}, is at ({here}) m, which is no point of the first time, "
            f"{first}: the nearest is ({there}) m. A plane has the same points at all times: "
            "sample one that stands still, or give each stretch of times on its own"
        )
    return order


FORMAT = PlaneFormat("OpenFOAM surfaces", recognises, named(open_surfaces), ("variable", "group", "normal"))
