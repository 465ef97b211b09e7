"""Surfaces with one frame a file or step: places and areas of their values, which are read once."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from torchliner.file_checks import naming, require_memory
from torchliner.io.plane_format import PlaneRequest, room
from torchliner.io.points import SAME, component_of, direction_of, place
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane

USUAL = re.compile(r"(?:U|u|v|[Vv]elocity|VELOCITY|vel)(?:[_:]?[xyz])?|[XYZxyz]_?[Vv]elocity")
PIXEL, VOXEL = 8, 11  # VTK's numbers: a rectangle and a box whose corners stand row by row
RINGS = (5, 7, PIXEL, 9)  # triangle, polygon, quad: what lies between their corners is a face
Faces = tuple[np.ndarray, np.ndarray, np.ndarray | None]  # corners, where those of each end, VTK's kinds (or polygons)


@dataclass(frozen=True)
class Frame:
    """Values at one time.

    Args:
        points: (N, 3).
        arrays: by name, whether values lie on faces, and the values, (N, components).
        faces: between the points; asked for where values lie on them.
        time: s, if the file states one.
    """

    points: np.ndarray
    arrays: Mapping[str, tuple[bool, np.ndarray]]
    faces: Callable[[], Faces | None] = lambda: None
    time: float | None = None

    def places(self, on_faces: bool, label: str) -> tuple[np.ndarray, np.ndarray | None]:
        """Where values stand, and the areas of faces."""
        if not on_faces:
            return self.points, None
        faces = self.faces()
        if faces is None:
            raise ValueError(f"{label} has no faces, but values on faces")
        return centres_of(self.points, *faces, label)


def centres_of(
    points: np.ndarray, corners: np.ndarray, ends: np.ndarray, kinds: np.ndarray | None, label: str
) -> tuple[np.ndarray, np.ndarray | None]:
    """Centroids (F, 3) and areas (F,) of faces, by triangles about the mean corner. Of boxes and other kinds that are
    no ``RINGS`` the mean corners, and no areas.

    Args:
        points: (N, 3).
        corners: of all faces one after another, numbers of points.
        ends: of each face, where its corners end, (F,).
        kinds: VTK's number of the kind of each face, (F,); None: polygons.
        label: for messages.
    Raises:
        ValueError: a face has less than three corners, or corners that are no points.
    """
    starts = np.append(0, ends[:-1])
    sizes = ends - starts
    if (sizes < 3).any() or ends[-1] != len(corners):
        raise ValueError(
            f"{label}: face {int((sizes < 3).argmax())} has {int(sizes.min())} corners of {len(corners)}; three at "
            "least are needed"
        )
    if corners.min() < 0 or corners.max() >= len(points):
        raise ValueError(f"{label}: faces name points {corners.min()} to {corners.max()}; there are {len(points)}")
    if kinds is not None and (kinds == PIXEL).any():  # whose corners stand row by row
        last = ends[kinds == PIXEL] - 1
        corners = corners.copy()
        corners[last - 1], corners[last] = corners[last], corners[last - 1]
    corner = points[corners]
    middle = np.add.reduceat(corner, starts) / sizes[:, None]
    if kinds is not None and not np.isin(kinds, RINGS).all():
        return middle, None
    hub = np.repeat(middle, sizes, 0)
    after = np.arange(1, len(corner) + 1)
    after[ends - 1] = starts
    triangle = 0.5 * np.cross(corner - hub, corner[after] - hub)
    vector = np.add.reduceat(triangle, starts)
    size = np.linalg.norm(triangle, axis=1)[:, None]
    total = np.add.reduceat(size, starts)
    moment = np.add.reduceat(size * (corner + corner[after] + hub) / 3, starts)
    centres = np.where(total > 0, moment / np.where(total > 0, total, 1), middle)
    return centres, np.linalg.norm(vector, axis=1)


def _pick(arrays: Mapping[str, tuple[bool, np.ndarray]], request: PlaneRequest, label: str) -> str:
    """Name of the velocity among the arrays of a frame."""
    if request.variable is not None:
        if request.variable not in arrays:
            raise ValueError(
                f"{label} has no variable {request.variable!r}{did_you_mean(request.variable, [*arrays])}; it holds "
                f"{', '.join(arrays) or 'none'}"
            )
        return request.variable
    axis = (request.normal or "").strip("+-")
    found = [name for name, (_, values) in arrays.items() if USUAL.fullmatch(name) and values.shape[1] == 3]
    if not found:
        along = {None} | ({"xyz".index(axis)} if axis in ("x", "y", "z") else set())
        found = [name for name in arrays if USUAL.fullmatch(name) and component_of(name) in along]
    if len(found) != 1:
        raise ValueError(f"{label} holds {', '.join(arrays) or 'no values'}; name the velocity (--variable)")
    return found[0]


def plane_of_frames(
    frames: Sequence[tuple[Path, Callable[[], Frame]]],
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
        request: what the user states.
        path: what the user named, for messages.
        factor, length: to m/s and m.
        about: for the provenance.
    Raises:
        ValueError: no velocity, or several; frames of other points; as ``place``.
    """
    file, read = frames[0]
    with naming(file):
        first = read()
    name = _pick(first.arrays, request, str(file))
    label = f"{file}:/{name}"
    on_faces, values = first.arrays[name]
    if values.shape[1] not in (1, 3):
        raise ValueError(f"{label} has {values.shape[1]} components; a vector, or one component, is needed")
    component = direction_of(name, request, label) if values.shape[1] == 1 else None
    points, area = Frame(length * first.points, {}, first.faces).places(on_faces, str(file))
    if len(points) != len(values):
        raise ValueError(f"{label} has {len(values)} values for {len(points)} {'faces' if on_faces else 'points'}")
    placed = place(points, request, f"{path}:/{name}", component, area=area)
    column = placed.axis if values.shape[1] == 3 else 0
    kind = np.float64 if values.dtype.itemsize > 4 else np.float32
    require_memory(8 * len(values), f"{label}: one frame")
    found, times = room((len(frames), len(values)), kind), []
    for i, (file, read) in enumerate(frames):
        with naming(file):
            frame = read() if i else first
            there, own = frame.arrays.get(name, (on_faces, values[:0]))
            if there != on_faces or own.shape != values.shape:
                raise ValueError(
                    f"{file} has {len(own) or 'no'} values of {name!r}, the first frame, {frames[0][0]}, has "
                    f"{len(values)}; a plane has the same points at all times"
                )
            found[i] = own[_order(frame, first, on_faces, file), column][placed.order]
        times.append(frame.time)
    if factor * placed.sign != 1:
        np.multiply(found, factor * placed.sign, out=found, casting="same_kind")
    about |= {"frames": len(frames), "values": "faces" if on_faces else "points"}
    return placed.plane(found, *clock(times), path, **about)


def _order(frame: Frame, first: Frame, on_faces: bool, file: Path) -> Any:
    """Which of the values of a frame is at each of the first one's places, as a restart on other cores has them in
    another order; a slice of all where they stand as they are.

    Raises:
        ValueError: they are at other places.
    """
    near = SAME * np.abs(first.points).max(initial=0)
    steady = first.points.shape == frame.points.shape and (np.abs(first.points - frame.points) <= near).all()
    if steady and (not on_faces or _same_faces(frame.faces(), first.faces())):
        return slice(None)
    (here, _), (there, _) = frame.places(on_faces, str(file)), first.places(on_faces, str(file))
    away, order = (np.asarray(each) for each in cKDTree(here).query(there))
    if (away > near).any():
        at = " ".join(f"{n:.9g}" for n in there[away.argmax()])
        raise ValueError(
            f"{file} has {int((away > near).sum())} of {len(there)} points elsewhere than the first frame, none at "
            f"({at}); a plane has the same points at all times: give each stretch of times on its own"
        )
    return order


def _same_faces(one: Faces | None, other: Faces | None) -> bool:
    if one is None or other is None:
        return one is other
    return one is other or (np.array_equal(one[0], other[0]) and np.array_equal(one[1], other[1]))
