"""Files of one frame as VTK reads them, through pyvista: points, faces and values."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.file_checks import require_memory, require_regular
from torchliner.io.point_layout import SAME
from torchliner.io.surface_frames import Frame, FrameArray, Surface, grid_surface
from torchliner.io.text_rows import bytes_at

TIMES = ("time", "timevalue")  # names of the clock in a file, in any case
XML_KIND = re.compile(rb"<VTKFile[^>]*\btype=[\"'](\w+)")
ENDINGS = {
    "PolyData": ".vtp",
    "UnstructuredGrid": ".vtu",
    "ImageData": ".vti",
    "StructuredGrid": ".vts",
    "RectilinearGrid": ".vtr",
}
Faces = tuple[np.ndarray, np.ndarray]
PARTS = ("points", "point_data", "cell_data")


def is_vtk(head: bytes) -> bool:
    """Whether the first bytes of a file are those of VTK, of any kind of data."""
    return head.startswith(b"# vtk DataFile") or b"<VTKFile" in head[:1024]


def vtk_parser(first: Path) -> Callable[[Path], Frame]:
    """The function that parses the frames of a series, whose points and faces are those of the first."""
    mesh = _read(first)
    return partial(parse_vtk, points=np.asarray(mesh.points), faces=_corners(mesh))


def parse_vtk(path: Path, points: np.ndarray | None = None, faces: Faces | None = None) -> Frame:
    """What a file of one frame offers; of an array on points and on faces, that on faces.

    Args:
        path: file.
        points: where those of the file must be, (N, 3), if there are as many.
        faces: what those of the file must be then.
    Raises:
        ImportError: pyvista is not installed.
        ValueError: VTK cannot read all of it, it holds several blocks, or its points or faces are others.
    """
    mesh = _read(path)
    if points is not None and points.shape == mesh.points.shape:
        away = np.abs(mesh.points - points).max(1, initial=0) > SAME * np.abs(points).max(initial=0)
        if away.any():
            raise ValueError(
                f"{path} has {int(away.sum())} points elsewhere than the first frame, or in another order; a plane has "
                "the same at all times: give each stretch of times on its own"
            )
        here = _corners(mesh)
        if faces is not None and here is not None and not all(map(np.array_equal, here, faces)):
            raise ValueError(
                f"{path} has other faces than the first frame, or in another order; a plane has the same at all times: "
                "give each stretch of times on its own"
            )
    arrays = {name: _array(False, mesh.point_data[name]) for name in mesh.point_data}
    first, count = _faces_of(mesh, path)
    for name in mesh.cell_data:
        arrays[name] = _array(True, mesh.cell_data[name][first : first + count])
    clocks = [mesh.field_data[name] for name in mesh.field_data if name.lower() in TIMES]
    times = [float(time) for clock in clocks for time in clock.flat[:1]]
    return Frame(partial(_surface, mesh), arrays, times[0] if times else None)


def _read(path: Path) -> Any:
    """The one data set of a file."""
    try:
        import pyvista
    except ImportError as error:
        raise ImportError(f"{path}: files of VTK are read by pyvista: pip install 'torchliner[vtk]'") from error
    require_regular(path)
    require_memory(path.stat().st_size, f"{path}")
    with pyvista.VtkErrorCatcher(send_to_logging=False) as caught:
        try:
            found = pyvista.get_reader(path, _ending(path)).read()
        except (ValueError, RuntimeError, TypeError, AttributeError) as error:
            raise ValueError(f"{path} is nothing that VTK reads: {' '.join(str(error).split())}") from error
    if caught.error_events:
        text = " ".join(str(caught.error_events[0].alert).split())
        raise ValueError(f"VTK cannot read all of {path}, which may be truncated: {text}")
    if isinstance(found, pyvista.MultiBlock):
        blocks = list(found.recursive_iterator(skip_none=True, skip_empty=True))
        if len(blocks) != 1:
            raise ValueError(f"{path} has {len(blocks)} blocks; write one surface in a file, or merge the blocks")
        found = blocks[0]
    if found is None or not all(hasattr(found, name) for name in PARTS):
        raise ValueError(f"{path} holds {type(found).__name__}, no points with values")
    return found


def _ending(path: Path) -> str:
    """The ending that says of what kind the content of a file is, whatever its own."""
    head = bytes_at(path, 0, 1024)
    kind = XML_KIND.search(head)
    if head.startswith(b"# vtk DataFile"):
        return ".vtk"
    return path.suffix if kind is None else ENDINGS.get(kind[1].decode(), path.suffix)


def _array(on_faces: bool, values: np.ndarray) -> FrameArray:
    values = np.asarray(values)
    columns = values.reshape(len(values), -1)
    return FrameArray(on_faces, len(values), columns.shape[1], lambda axis: columns[:, axis], values.itemsize > 4)


def _faces_of(mesh: Any, path: Path) -> tuple[int, int]:
    """The first of the cells that are faces, and their number."""
    if not hasattr(mesh, "GetPolys"):
        return 0, mesh.n_cells
    if strips := mesh.GetNumberOfStrips():
        raise ValueError(f"{path} has {strips} triangle strips, whose values are not read: triangulate the surface")
    return mesh.GetNumberOfVerts() + mesh.GetNumberOfLines(), mesh.GetNumberOfPolys()


def _surface(mesh: Any) -> Surface:
    """Points and faces."""
    points = np.asarray(mesh.points, np.float64)
    if hasattr(mesh, "dimensions"):
        return grid_surface(points, np.array(mesh.dimensions))
    faces = _corners(mesh)
    return Surface(points) if faces is None else Surface(points, *faces, getattr(mesh, "celltypes", None))


def _corners(mesh: Any) -> Faces | None:
    """Corners of all faces, and where those of each end; None of grids and of points alone."""
    if hasattr(mesh, "dimensions"):
        return None
    faces = mesh.GetCells() if hasattr(mesh, "GetCells") else mesh.GetPolys()
    if not faces.GetNumberOfCells():
        return None
    from pyvista import convert_array

    corners, ends = (convert_array(each) for each in (faces.GetConnectivityArray(), faces.GetOffsetsArray()))
    return corners, ends[1:]
