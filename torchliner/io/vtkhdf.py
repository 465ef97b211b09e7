"""VTKHDF: HDF5 with a group VTKHDF, as ParaView and solvers write series of surfaces and grids.

Frames stand one behind another in each array; Steps says where each begins.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

from torchliner.file_checks import require_memory
from torchliner.io.clocks import clock_of
from torchliner.io.hdf5 import get_dataset, get_group, is_there, open_file, text_attribute
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.point_layout import (
    all_rows,
    direction_of,
    length_factor,
    named,
    plane_at,
    velocity_factor,
)
from torchliner.io.stored_values import read_values, require_numbers, require_stored
from torchliner.io.surface_frames import Frame, FrameArray, Surface, grid_surface, pick_array
from torchliner.io.text_rows import last_digit
from torchliner.records import VelocityPlane

KINDS = ("ImageData", "PolyData", "UnstructuredGrid")
TOGETHER = 16  # frames of a vector that are read at once, of which one component is kept
CELLS = ("Vertices", "Lines", "Polygons", "Strips")  # of PolyData, in the order of their values
Rows = tuple[int, int, int]  # of values in a frame: those of points or faces, before and after them
POLYGONS = CELLS.index("Polygons")


@dataclass
class Steps:
    """Component ``axis`` of the frames of an array, each ``count`` values from ``offsets`` on.

    Args:
        path, name: file and array, PointData/NAME.
        offsets: along the array's first axis, (T,).
        rows: along the first axis in a frame; 1 of a grid.
        axis: component; None of a scalar.
    """

    path: Path
    name: str
    offsets: np.ndarray
    rows: int
    axis: int | None

    def __call__(self, begin: int, end: int) -> np.ndarray:
        """Values, (t, N)."""
        out = []
        with open_file(self.path) as file:
            data = file[f"VTKHDF/{self.name}"]
            label = f"{self.path}:{data.name}"
            for first in range(begin, end, TOGETHER):
                low = self.offsets[first : min(first + TOGETHER, end)]
                steady = (np.diff(low) == self.rows).all()
                for at, last in [(low[0], low[-1])] if steady else zip(low, low, strict=True):
                    part = slice(int(at), int(last) + self.rows)
                    found = read_values(data, label, self.path, part)
                    all_rows(found, part.start, part.stop, self.path)
                    out.append(found if self.axis is None else found[..., self.axis].copy())
        return np.concatenate(out).reshape(end - begin, -1)


def recognises(path: Path, head: bytes) -> bool:
    """HDF5 with a group VTKHDF."""
    if head[:8] != b"\x89HDF\r\n\x1a\n":
        return False
    try:
        with open_file(path) as file:
            return isinstance(file.get("VTKHDF"), h5py.Group)
    except (OSError, ValueError):
        return False


def open_steps(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a VTKHDF file with steps in time.

    Args:
        path: file.
        request: units of length and velocity, which VTK does not state; ``sampling_rate``
            where the times of the steps are not in s.
    Raises:
        OSError, ValueError: as ``open_file``; another type of data; no steps; frames of other
            points; a frame that reaches beyond its array; as ``pick_array`` and ``plane_at``.
    """
    factor, length = velocity_factor(request, f"{path}"), length_factor(request, f"{path}")
    with open_file(path) as file:
        group = get_group(file, "VTKHDF", path)
        kind = text_attribute(group, "Type") or ""
        if kind not in KINDS:
            raise ValueError(f"{path}:/VTKHDF is of type {kind!r}; {', '.join(KINDS)} are read")
        if not is_there(group, "Steps", path):
            raise ValueError(f"{path}:/VTKHDF has no Steps: it is one frame, a plane needs several")
        steps = get_group(group, "Steps", path)
        whole = partial(_whole, path=path)
        time = whole(steps, "Values").astype(float).reshape(-1)
        if len(time) < 2:
            raise ValueError(f"{path}:/VTKHDF/Steps has {len(time)} step; two at least are needed")
        grid = kind == "ImageData"
        surface, count = (_grid(group, path) if grid
                          else _mesh(group, steps, whole, path, kind, len(time)))  # fmt: skip
        arrays = _arrays(group, path, _sizes(group) if grid else None)
        name = pick_array(Frame(lambda: Surface(np.empty((0, 3))), arrays), request, str(path))
        array = arrays[name]
        section = "CellData" if array.on_faces else "PointData"
        if array.on_faces:
            points, area = replace(surface, points=surface.points * length).faces(str(path))
        else:
            points, area = surface.points * length, None
        rows, before, after = (1, 0, 0) if grid else count[array.on_faces]
        if after:
            raise ValueError(f"{path}:/VTKHDF has {after} triangle strips, whose values are not "
                             "read: triangulate the surface")  # fmt: skip
        offsets = np.arange(len(time)) * (before + rows)
        if is_there(steps, f"{section}Offsets", path) and name in steps[f"{section}Offsets"]:
            offsets = whole(steps[f"{section}Offsets"], name).astype(np.int64).reshape(-1)
        if len(offsets) == len(time) + 1:  # VTK's own writer adds where the next one would begin
            offsets = offsets[:-1]
        offsets = offsets + before
        data = get_dataset(group[section], name, path)
        values = array.count if grid else rows
        if len(offsets) != len(time) or offsets.min() < 0 or offsets.max() + rows > len(data):
            raise ValueError(f"{path}:{data.name} has {len(data)} rows; {len(time)} frames of "
                             f"{rows} from {offsets.min()} to {offsets.max()} reach beyond: the "
                             "file is truncated")  # fmt: skip
        if values != len(points):
            raise ValueError(f"{path}:{data.name} has {values} values a frame for {len(points)} "
                             f"{'faces' if array.on_faces else 'points'}")  # fmt: skip
        require_stored(data, f"{path}:{data.name}", path)
    vectors = array.components == 3
    component = None if vectors else direction_of(name, request, f"{path}:/{section}/{name}")
    rate, start = clock_of(time, f"{path}:/VTKHDF/Steps/Values", request.sampling_rate,
                           last_digit(time, 7))  # fmt: skip
    return plane_at(
        points, request,
        lambda axis: Steps(path, f"{section}/{name}", offsets, rows, axis if vectors else None),
        len(time), rate, path=path, variable=f"VTKHDF/{section}/{name}", factor=factor, area=area,
        component=component, start=start,
        dtype=torch.float64 if array.wide else torch.float32, format=f"VTKHDF {kind}",
    )  # fmt: skip


def _whole(group: h5py.Group, name: str, path: Path) -> np.ndarray:
    """A small dataset."""
    return read_values(get_dataset(group, name, path), f"{path}:{group.name}/{name}", path)


def _sizes(group: h5py.Group) -> np.ndarray:
    """Points of a uniform grid along x, y and z."""
    return np.diff(np.asarray(group.attrs["WholeExtent"]).reshape(3, 2))[:, 0].astype(np.int64) + 1


def _arrays(group: h5py.Group, path: Path, size: np.ndarray | None) -> dict[str, FrameArray]:
    """Arrays on points and faces; of a grid (time, z, y, x[, component]), of which VTK's own writer
    leaves out the axes of one point.

    Args:
        group, path: of the data.
        size: of a grid, points along x, y and z; None of a mesh.
    """
    found = {}
    for on_faces, section in ((False, "PointData"), (True, "CellData")):
        for name in group[section] if is_there(group, section, path) else ():
            data = group[section][name]
            if not isinstance(data, h5py.Dataset) or not data.shape:
                continue
            require_numbers(data, f"{path}:{data.name}")
            least = 1
            if size is not None:
                full = np.maximum(size - on_faces, 1)[::-1].tolist()
                least += 3 if list(data.shape[1:4]) == full else int((size > 1).sum())
            width = data.shape[least] if data.ndim > least else 1
            count = int(np.prod(data.shape[1:least], dtype=np.int64))
            found[name] = FrameArray(on_faces, count, width, lambda axis: np.empty(0), data.dtype.itemsize > 4)
    return found


def _grid(group: h5py.Group, path: Path) -> tuple[Surface, dict[bool, Rows]]:
    """Points of a uniform grid."""
    extent, origin, spacing = (np.asarray(group.attrs.get(name, ())).reshape(-1)
                               for name in ("WholeExtent", "Origin", "Spacing"))  # fmt: skip
    turn = np.asarray(group.attrs.get("Direction", np.eye(3)), float).reshape(-1)
    if (len(extent), len(origin), len(spacing), len(turn)) != (6, 3, 3, 9):
        raise ValueError(f"{path}:/VTKHDF has WholeExtent {extent}, Origin {origin}, Spacing "
                         f"{spacing}; three axes are needed")  # fmt: skip
    low, high = extent[::2].astype(np.int64), extent[1::2].astype(np.int64)
    sizes = (high - low + 1).tolist()
    if min(sizes) < 1:
        raise ValueError(f"{path}:/VTKHDF has WholeExtent {extent}, which is upside down")
    require_memory(24.0 * sizes[0] * sizes[1] * sizes[2], f"{path}:/VTKHDF: points of its grid")
    axes = [np.arange(first, last + 1) for first, last in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes[::-1], indexing="ij")[::-1], -1).reshape(-1, 3)  # x runs fastest
    return grid_surface(origin + (spacing * places) @ turn.reshape(3, 3).T, high - low + 1), {}


def _mesh(
    group: h5py.Group, steps: h5py.Group, whole: Callable[..., Any], path: Path, kind: str,
    frames: int,
) -> tuple[Surface, dict[bool, Rows]]:  # fmt: skip
    """Points and faces of the first frame, and the values of each in all frames.

    Raises:
        ValueError: a later frame has others.
    """
    cells = get_group(group, "Polygons", path) if kind == "PolyData" else group
    homes = {"faces": group} if cells is group else {
        each.lower(): get_group(group, each, path) for each in CELLS if is_there(group, each, path)
    }  # fmt: skip
    numbers = {name: whole(each, "NumberOfCells").reshape(-1).astype(np.int64)
               for name, each in homes.items()}  # fmt: skip
    numbers["points"] = whole(group, "NumberOfPoints").reshape(-1).astype(np.int64)
    size = dict.fromkeys(("vertices", "lines", "strips"), 0)
    first, parts = np.zeros(frames, np.int64), np.ones(frames, np.int64)
    if is_there(steps, "PartOffsets", path):
        first = whole(steps, "PartOffsets").reshape(-1).astype(np.int64)
    if is_there(steps, "NumberOfParts", path):
        parts = whole(steps, "NumberOfParts").reshape(-1).astype(np.int64)
    if len(first) != frames or len(parts) != frames or (parts != 1).any() or (
        not 0 <= first.min() <= first.max() < len(numbers["points"])
    ):  # fmt: skip
        raise ValueError(f"{path}:/VTKHDF has frames of {parts.max()} parts; one part each is "
                         "read: merge the blocks")  # fmt: skip
    for name, each in numbers.items():
        counts = each[first.clip(max=len(each) - 1)]
        if (counts != counts[0]).any():
            at = int((counts != counts[0]).argmax())
            raise ValueError(f"{path}:/VTKHDF: frame {at} has {counts[at]} {name}, the first "
                             f"{counts[0]}; a plane has the same at all times")  # fmt: skip
        size[name] = int(counts[0])
    points, faces = size["points"], size["faces" if cells is group else "polygons"]

    def begin(name: str) -> int:
        if not is_there(steps, name, path):
            return 0
        found = whole(steps, name)
        return int(found[0] if found.ndim == 1 else found[0, POLYGONS % found.shape[1]])

    at = begin("PointOffsets")
    surface = Surface(
        read_values(get_dataset(group, "Points", path), f"{path}:/VTKHDF/Points", path,
                    slice(at, at + points)).astype(float))  # fmt: skip
    if faces:
        # Each part has one end more than faces, its first 0.
        at = begin("CellOffsets") + int(first[0])
        ends = read_values(get_dataset(cells, "Offsets", path), f"{path}: Offsets", path,
                           slice(at, at + faces + 1)).astype(np.int64)  # fmt: skip
        at = begin("ConnectivityIdOffsets")
        corners = read_values(get_dataset(cells, "Connectivity", path), f"{path}: Connectivity",
                              path, slice(at, at + int(ends[-1]))).astype(np.int64)  # fmt: skip
        kinds = None
        if is_there(cells, "Types", path):
            at = begin("CellOffsets")
            kinds = read_values(cells["Types"], f"{path}: Types", path, slice(at, at + faces))
        surface = Surface(surface.points, corners, ends[1:], kinds)
    return surface, {False: (points, 0, 0),
                     True: (faces, size["vertices"] + size["lines"], size["strips"])}  # fmt: skip


FORMAT = PlaneFormat(
    "VTKHDF", recognises, named(open_steps),
    ("variable", "velocity_units", "length_units", "sampling_rate", "normal"),
)  # fmt: skip
