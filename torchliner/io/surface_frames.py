"""Series of files with one frame of a sampled surface each: places, areas, and reading them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.file_checks import naming, require_memory, require_regular
from torchliner.io.plane_format import PlaneRequest
from torchliner.io.point_layout import Arranged, component_of, direction_of, plane_at
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane

USUAL = re.compile(r"(?:U|u|v|[Vv]elocity|VELOCITY|vel)(?:[_:]?[xyz])?|[XYZxyz]_?[Vv]elocity")
PIXEL, VOXEL = 8, 11  # VTK's numbers: a rectangle and a box whose corners stand row by row
RINGS = (5, 7, PIXEL, 9)  # triangle, polygon, quad: what lies between their corners is a face


@dataclass(frozen=True)
class Surface:
    """Points, and the faces between them.

    Args:
        points: m, (N, 3).
        corners: of all faces one after another, numbers of points; None: points alone.
        ends: of each face, where its corners end; (F,).
        kinds: VTK's number of the kind of each face, (F,); None: polygons.
        size: of a grid, number of points along each axis, x first; its cells are its faces.
    """

    points: np.ndarray
    corners: np.ndarray | None = None
    ends: np.ndarray | None = None
    kinds: np.ndarray | None = None
    size: np.ndarray | None = None

    def faces(self, label: str) -> tuple[np.ndarray, np.ndarray | None]:
        """Centroids (F, 3), m, and areas (F,), m2; by triangles about the mean corner. Of boxes and
        other kinds that are no ``RINGS`` the mean corners, and no areas.

        Raises:
            ValueError: there are no faces, a face has two corners, or corners that are no points.
        """
        if self.size is not None:
            return _cells_of_grid(self.points, self.size).faces(label)
        if self.corners is None or self.ends is None or not len(self.ends):
            raise ValueError(f"{label} has no faces, but values on faces")
        starts = np.append(0, self.ends[:-1])
        sizes = self.ends - starts
        if (sizes < 3).any() or self.ends[-1] != len(self.corners):
            raise ValueError(f"{label}: face {int((sizes < 3).argmax())} has "
                             f"{int(sizes.min())} corners of {len(self.corners)}; three at "
                             "least are needed")  # fmt: skip
        if self.corners.min() < 0 or self.corners.max() >= len(self.points):
            raise ValueError(f"{label}: faces name points {self.corners.min()} to "
                             f"{self.corners.max()}; there are {len(self.points)}")  # fmt: skip
        corner = self.points[in_circles(self.corners, self.ends, self.kinds)]
        middle = np.add.reduceat(corner, starts) / sizes[:, None]
        if self.kinds is not None and not np.isin(self.kinds, RINGS).all():
            return middle, None
        hub = np.repeat(middle, sizes, 0)
        after = np.arange(1, len(corner) + 1)
        after[self.ends - 1] = starts
        triangle = 0.5 * np.cross(corner - hub, corner[after] - hub)
        vector = np.add.reduceat(triangle, starts)
        size = np.linalg.norm(triangle, axis=1)[:, None]
        total = np.add.reduceat(size, starts)
        moment = np.add.reduceat(size * (corner + corner[after] + hub) / 3, starts)
        centres = np.where(total > 0, moment / np.where(total > 0, total, 1), middle)
        return centres, np.linalg.norm(vector, axis=1)


def grid_surface(points: np.ndarray, size: np.ndarray) -> Surface:
    """Points of a grid, the cells between them formed where values stand on these.

    Args:
        points: m, (N, 3), x running fastest.
        size: number of points along each axis, x first, (3,).
    Raises:
        ValueError: these are not as many as the points.
    """
    if math.prod(size.tolist()) != len(points):
        raise ValueError(f"a grid of {size.tolist()} points has {len(points)}")
    return Surface(points, size=size)


def _cells_of_grid(points: np.ndarray, size: np.ndarray) -> Surface:
    number = np.arange(len(points)).reshape(size[::-1])
    sides = [(slice(None, -1), slice(1, None)) if n > 1 else (slice(None),) for n in size[::-1]]
    corners = np.stack([number[each].reshape(-1) for each in product(*sides)], 1)
    count, each = corners.shape
    kinds = np.full(count, PIXEL if each <= 4 else VOXEL)
    return Surface(points, corners.reshape(-1), each * np.arange(1, count + 1), kinds)


def in_circles(corners: np.ndarray, ends: np.ndarray, kinds: np.ndarray | None) -> np.ndarray:
    """Corners in order around each face: those of VTK's pixels stand row by row.

    Args:
        corners, ends: as of ``Surface``.
        kinds: VTK's number of the kind of each cell, (F,).
    """
    if kinds is None or not (kinds == PIXEL).any():
        return corners
    last = ends[kinds == PIXEL] - 1
    found = corners.copy()
    found[last - 1], found[last] = corners[last], corners[last - 1]
    return found


def read_whole(path: Path) -> bytes:
    """A file of one frame.

    Raises:
        OSError, FileNotFoundError, ValueError: it is none, or larger than memory.
    """
    require_regular(path)
    require_memory(path.stat().st_size, f"{path}")
    return path.read_bytes()


@dataclass(frozen=True)
class Frame:
    """One file of a series, its values not read before they are asked for.

    Args:
        surface: of the file; asked for in the first one alone.
        arrays: by name, whether values lie on faces, their number, components, and a function of
            an axis (None: all) to values.
        time: s, if the file states one.
    """

    surface: Callable[[], Surface]
    arrays: dict[str, FrameArray]
    time: float | None = None


@dataclass(frozen=True)
class FrameArray:
    """Values of a frame: ``read`` gives component ``axis`` of each, (N,), of 1 or 3 components."""

    on_faces: bool
    count: int
    components: int
    read: Callable[[int], np.ndarray]
    wide: bool = False  # float64


def pick_array(frame: Frame, request: PlaneRequest, label: str) -> str:
    """Name of the velocity among the arrays of a frame.

    Raises:
        ValueError: none or several may be it, or none has the name asked for.
    """
    there = list(frame.arrays)
    if request.variable is not None:
        if request.variable not in there:
            raise ValueError(f"{label} has no variable {request.variable!r}"
                             f"{did_you_mean(request.variable, there)}; it holds "
                             f"{', '.join(there) or 'none'}")  # fmt: skip
        return request.variable
    axis = (request.normal or "").strip("+-")
    found = [name for name in there if USUAL.fullmatch(name) and frame.arrays[name].components == 3]
    if not found:
        along = {None} | ({"xyz".index(axis)} if axis in ("x", "y", "z") else set())
        found = [n for n in there if USUAL.fullmatch(n) and component_of(n) in along]
    if len(found) != 1:
        raise ValueError(f"{label} holds {', '.join(there) or 'no values'}; name the velocity "
                         "(--variable)")  # fmt: skip
    return found[0]


@dataclass
class FrameFiles:
    """Frames of a series, one file each.

    Args:
        paths: files, in the order of time.
        parse: of a path, its frame.
        name, axis: of the array, and which component.
        count: values in each; float64 if ``wide``.
    """

    paths: Sequence[Path]
    parse: Callable[[Path], Frame]
    name: str
    axis: int
    count: int
    wide: bool

    def __call__(self, begin: int, end: int) -> np.ndarray:
        """Values, (t, N)."""
        out = np.empty((end - begin, self.count), np.float64 if self.wide else np.float32)
        for row, path in zip(out, self.paths[begin:end], strict=True):
            with naming(path):
                array = self.parse(path).arrays.get(self.name)
                if array is None or array.count != self.count:
                    raise ValueError(
                        f"{path} has {'no' if array is None else array.count} values of "
                        f"{self.name!r}, the first frame, {self.paths[0]}, has {self.count}; a "
                        "plane has the same points at all times"
                    )
                row[:] = array.read(self.axis)
        return out


def frames_of(velocity: Any) -> Sequence[Path]:
    """The files of a series that velocity is read from; none where it is no series."""
    source = getattr(velocity, "source", None)
    source = source.source if isinstance(source, Arranged) else source
    return source.paths if isinstance(source, FrameFiles) else ()


def plane_of_frames(
    paths: Sequence[Path], parse: Callable[[Path], Frame], request: PlaneRequest, rate: float,
    path: Path, factor: float = 1.0, length: float = 1.0, **about: Any,
) -> VelocityPlane:  # fmt: skip
    """The plane of a series of frames.

    Args:
        paths: files, in the order of time.
        parse: of a path, its frame.
        request: what the user states.
        rate: Hz.
        path: what the user named, for messages.
        factor, length: to m/s and m.
        about: for the provenance.
    Raises:
        ValueError: as ``pick_array`` and ``plane_at``; values on faces that are not there.
    """
    with naming(paths[0]):
        frame = parse(paths[0])
        name = pick_array(frame, request, str(paths[0]))
        array = frame.arrays[name]
        surface = frame.surface()
    label = f"{paths[0]}:/{name}"
    if array.components not in (1, 3):
        raise ValueError(f"{label} has {array.components} components; a vector, or one component, "
                         "is needed")  # fmt: skip
    require_memory(8 * array.count, f"{label}: one frame")
    points, area = surface.points * length, None
    if array.on_faces:
        points, area = replace(surface, points=points).faces(str(paths[0]))
    if len(points) != array.count:
        raise ValueError(f"{label} has {array.count} values for {len(points)} "
                         f"{'faces' if array.on_faces else 'points'}")  # fmt: skip
    vectors = array.components == 3
    component = None if vectors else direction_of(name, request, label)
    return plane_at(
        points, request,
        lambda axis: FrameFiles(paths, parse, name, vectors * axis, array.count, array.wide),
        len(paths), rate, path=path, variable=name, factor=factor, area=area,
        component=component,
        dtype=torch.float64 if array.wide else torch.float32,
        frames=len(paths), values="faces" if array.on_faces else "points", **about,
    )  # fmt: skip
