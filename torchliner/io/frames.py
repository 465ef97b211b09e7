"""Surfaces with one frame a file or step: places and areas of their values, which are read once."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.file_checks import naming, require_memory
from torchliner.io.plane_format import PlaneRequest, room
from torchliner.io.points import AXES, SAME, component_of, direction_of, place
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane

USUAL = re.compile(r"(?:U|u|v|[Vv]elocity|VELOCITY|vel)(?:[_:]?[xyz])?|[XYZxyz]_?[Vv]elocity")
Places = tuple[np.ndarray, np.ndarray | None]  # (N, 3), and areas of faces
Read = Callable[[], "Frame"]


@dataclass(frozen=True)
class Frame:
    """Values at one time: points, (N, 3); arrays by name, whether they lie on faces, and (N, components); where faces
    stand, and their areas; what tells, beside points, whether two frames have the same faces; the time stated."""

    points: np.ndarray
    arrays: Mapping[str, tuple[bool, np.ndarray]]
    faces: Callable[[], Places] | None = None
    corners: tuple[np.ndarray, ...] = ()
    time: float | None = None


def centres_of(points: np.ndarray, corners: np.ndarray, ends: np.ndarray, label: str) -> Places:
    """Centroids (F, 3) and areas (F,) of faces, by triangles about the mean corner; ``corners`` are numbers of points,
    (N, 3), of all faces one after another, ``ends`` where those of each end, (F,)."""
    starts = np.append(0, ends[:-1])
    sizes = ends - starts
    if not len(ends) or (sizes < 3).any() or ends[-1] != len(corners):
        raise ValueError(f"{label}: faces have {sizes.min(initial=3)} corners of {len(corners)}; three are needed")
    if corners.min() < 0 or corners.max() >= len(points):
        raise ValueError(f"{label}: faces name points {corners.min()} to {corners.max()}; there are {len(points)}")
    corner = points[corners]
    middle = np.add.reduceat(corner, starts) / sizes[:, None]
    hub = np.repeat(middle, sizes, 0)
    after = np.arange(1, len(corner) + 1)
    after[ends - 1] = starts
    triangle = 0.5 * np.cross(corner - hub, corner[after] - hub)
    size = np.linalg.norm(triangle, axis=1)[:, None]
    total = np.add.reduceat(size, starts)
    moment = np.add.reduceat(size * (corner + corner[after] + hub) / 3, starts)
    centres = np.where(total > 0, moment / np.where(total > 0, total, 1), middle)
    return centres, np.linalg.norm(np.add.reduceat(triangle, starts), axis=1)


def _pick(arrays: Mapping[str, tuple[bool, np.ndarray]], request: PlaneRequest, label: str) -> str:
    """Name of the velocity among the arrays of a frame: stated, or a vector or the stated component by its name."""
    held, name = ", ".join(arrays) or "none", request.variable
    if name is not None and name not in arrays:
        raise ValueError(f"{label} has no variable {name!r}{did_you_mean(name, [*arrays])}; it holds {held}")
    usual = {name: values.shape[1] for name, (_, values) in arrays.items() if USUAL.fullmatch(name)}
    along = {None} | ({AXES.index(request.normal[-1])} if request.normal else set())
    found = [name for name, size in usual.items() if size == 3] or [n for n in usual if component_of(n) in along]
    if name is None and len(found) != 1:
        raise ValueError(f"{label} holds {held}; name the velocity (--variable)")
    return name or found[0]


def plane_of_frames(
    frames: Sequence[tuple[Path, Read]],
    clock: Callable[[list[float | None]], tuple[float, float]],
    request: PlaneRequest,
    path: Path,
    factor: float = 1.0,
    length: float = 1.0,
    **about: Any,
) -> VelocityPlane:
    """The plane of a series of frames, which are read here, one after another.

    Args:
        frames: of each, in the order of time, its file and a function that reads it.
        clock: sampling rate, Hz, and start, s, from the times that the frames state.
        request, path: what the user states, and named.
        factor, length: to m/s and m.
        about: for the provenance.
    Raises:
        ValueError: no velocity, or several; frames of other points, or with these in another order; as ``place``.
    """
    file, read = frames[0]
    with naming(file):
        first = read()
    name = _pick(first.arrays, request, str(file))
    label, (on_faces, values) = f"{file}:/{name}", first.arrays[name]
    if values.shape[1] not in (1, 3):
        raise ValueError(f"{label} has {values.shape[1]} components; a vector, or one component, is needed")
    component = direction_of(name, request, label) if values.shape[1] == 1 else None
    points, area = first.faces() if on_faces and first.faces else (first.points, None)
    if len(points) != len(values):
        raise ValueError(f"{label} has {len(values)} values for {len(points)} {'faces' if on_faces else 'points'}")
    area = None if area is None else area * length**2
    placed = place(length * points, request, f"{path}:/{name}", component, area=area)
    column = placed.axis if values.shape[1] == 3 else 0
    require_memory(8 * len(values), f"{label}: one frame")
    found, times = room((len(frames), len(values)), np.float64 if values.dtype.itemsize > 4 else np.float32), []
    for i, (file, read) in enumerate(frames):
        with naming(file):
            frame = read() if i else first
        there, own = frame.arrays.get(name, (on_faces, values[:0]))
        if there != on_faces or own.shape != values.shape or not _stand_alike(frame, first):
            raise ValueError(
                f"{file} has {len(own)} values of {name!r}, the first frame, {frames[0][0]}, {len(values)}, or their "
                "points or faces are others, or in another order; a plane has the same at all times: give each "
                "stretch of times on its own"
            )
        found[i] = own[placed.order, column]
        times.append(frame.time)
    if factor * placed.sign != 1:
        np.multiply(found, factor * placed.sign, out=found, casting="same_kind")
    about |= {"frames": len(frames), "values": "faces" if on_faces else "points"}
    return placed.plane(found, *clock(times), path, **about)


def _stand_alike(frame: Frame, first: Frame) -> bool:
    """Whether points, to the digits of text, and faces are the same, in the same order."""
    near = SAME * np.abs(first.points).max(initial=0)
    same = frame.points.shape == first.points.shape and (np.abs(frame.points - first.points) <= near).all()
    return bool(same) and all(map(np.array_equal, frame.corners, first.corners))
