"""Series of frames that VTK reads, through pyvista: collections (.pvd, .vtp.series), EnSight and VTKHDF, which state
times; numbered files, or their folder."""

import re
from collections.abc import Callable
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.file_checks import Unwritten, require_memory, require_regular
from torchliner.io.hdf5 import is_there, open_file, require_stored
from torchliner.io.plane_format import HDF5_SIGNATURE, PlaneFormat, PlaneRequest
from torchliner.io.points import Frame, Frames, Places, centres_of, plane_of_frames
from torchliner.records import VelocityPlane
from torchliner.records.origin import numbered_series

ENDINGS = (".vtp", ".vtk", ".vtu", ".vti", ".vts", ".vtr", ".vtm")
HEADS = re.compile(rb'# vtk DataFile|[^\0]*<VTKFile|\s*{\s*"file-series-version"|(#.*\s+)*FORMAT\s+type:\s*ensight')


def recognises(path: Path, head: bytes) -> bool:
    """A VTK file, a collection of them, EnSight, or a folder that holds some."""
    if path.is_dir():
        return any(each.suffix in ENDINGS for each in path.iterdir())
    if head.startswith(HDF5_SIGNATURE):
        with open_file(path) as file:
            return is_there(file, "VTKHDF", path) and isinstance(file["VTKHDF"], h5py.Group)
    return HEADS.match(head[:1024]) is not None


def open_series(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a series of frames: a collection, any of the numbered files, or their folder. ``group`` names the
    series where a folder has several, or the block; units are always to be stated, the rate where no file has times."""
    if path.is_dir() or path.suffix in ENDINGS:
        numbers, timed = _numbered(path, request.group), False
        frames: Frames = [(each, partial(read_frame, each, request.group), float(n)) for each, n in numbers.items()]
    else:
        frames, timed = _steps(path, request.group)
    return plane_of_frames(frames, request, path, timed=timed, si=False, format="VTK series")


def _numbered(path: Path, group: str | None) -> dict[Path, Decimal]:
    """Files of the series of a folder, or of the one that a file is of, and their numbers."""
    if not path.is_dir():
        series = numbered_series(path.parent, (path.suffix,))
        return next((files for files in series.values() if path in files), {path: Decimal(0)})
    series = numbered_series(path, ENDINGS)
    files = series.get(group or ", ".join(series))
    if files is None:
        raise ValueError(f"{path} holds the series {', '.join(sorted(series)) or 'none'}; name one (--group)")
    return files


def _steps(path: Path, group: str | None) -> tuple[Frames, bool]:
    """Frames of a file that names several or holds them, collections, EnSight, VTKHDF, and whether it states times."""
    if h5py.is_hdf5(path):  # which would give zeros where values were never written
        with open_file(path) as file:
            for section in ("PointData", "CellData"):
                for data in file["VTKHDF"].get(section, {}).values():
                    require_stored(data, f"{path}:{data.name}", path)
    reader = _reader(path)
    times = getattr(reader, "time_values", None)  # VTKHDF states them in each frame
    go = getattr(reader, "set_active_time_point", None) or reader.reader.SetStep

    def read(i: int) -> Frame:
        _by_vtk(path, partial(go, i))
        return _frame(reader, path, group)

    steps = times if times is not None else range(reader.reader.GetNumberOfSteps())
    return [(path, partial(read, i), float(time)) for i, time in enumerate(steps)], times is not None


def read_frame(path: Path, group: str | None = None) -> Frame:
    """A file of one frame; of an array on points and on faces, that on faces; of several blocks, that of the name."""
    require_regular(path)
    require_memory(path.stat().st_size, f"{path}")
    return _frame(_reader(path), path, group)


def _reader(path: Path) -> Any:
    try:
        import pyvista
    except ImportError as error:
        raise ImportError(f"{path}: files of VTK are read by pyvista: pip install 'torchliner[vtk]'") from error
    return _by_vtk(path, partial(pyvista.get_reader, path))


def _by_vtk(path: Path, work: Callable[[], Any]) -> Any:
    """What VTK does; errors that it only prints are errors."""
    import pyvista

    with pyvista.VtkErrorCatcher(send_to_logging=False) as caught:
        try:
            found = work()
        except Exception as error:  # whatever it says of damage
            raise ValueError(f"{path} is nothing that VTK reads: {' '.join(str(error).split())}") from error
    if caught.error_events:
        text = " ".join(str(caught.error_events[0].alert).split())
        raise Unwritten(f"VTK cannot read all of {path}, which may be truncated: {text}")
    return found


def _frame(reader: Any, path: Path, group: str | None) -> Frame:
    """What a reader gives, as a frame."""
    mesh = _by_vtk(path, reader.read)
    if hasattr(mesh, "recursive_iterator"):
        blocks = dict(mesh.recursive_iterator("items", skip_none=True, skip_empty=True))
        names = [group] if group in blocks else [*blocks]
        if len(names) != 1:
            raise ValueError(f"{path} has {len(blocks)} blocks, {', '.join(map(str, blocks))}; name one (--group)")
        mesh = blocks[names[0]]
    mesh = mesh.copy(deep=False)  # a reader of steps fills the same one again
    arrays = {name: (False, np.asarray(v).reshape(len(v), -1)) for name, v in mesh.point_data.items()}
    arrays |= {name: (True, np.asarray(v).reshape(len(v), -1)) for name, v in mesh.cell_data.items()}
    times = [mesh.field_data[name] for name in mesh.field_data if name.lower() in ("time", "timevalue")]
    return Frame(arrays, partial(_places, mesh, path), float(times[0].flat[0]) if times and times[0].size else None)


def _places(mesh: Any, path: Path, on_faces: bool) -> Places:
    """Points, or centres of cells and areas of those that are flat."""
    from pyvista import convert_array

    if not on_faces:
        return np.asarray(mesh.points, np.float64), None
    if hasattr(mesh, "GetPolys"):  # VTK's own centres of polygons are not their centroids
        faces = mesh.GetPolys()
        corners, ends = (convert_array(each) for each in (faces.GetConnectivityArray(), faces.GetOffsetsArray()))
        return centres_of(np.asarray(mesh.points, np.float64), corners, ends[1:], str(path))
    area = np.asarray(mesh.compute_cell_sizes(length=False, volume=False).cell_data["Area"], np.float64)
    return np.asarray(mesh.cell_centers().points, np.float64), area if (area > 0).all() else None


TAKES = ("variable", "group", "velocity_units", "length_units", "sampling_rate", "normal")
FORMAT = PlaneFormat("VTK series", recognises, open_series, TAKES)
