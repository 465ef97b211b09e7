"""Series of frames that VTK reads, through pyvista: collections (.pvd, .series), EnSight and VTKHDF, which state
times; numbered files, or their folder."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from decimal import Decimal
from functools import cache, partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import h5py
import numpy as np

from torchliner.file_checks import Unwritten, naming, require_memory, require_regular
from torchliner.io.clocks import clock_of
from torchliner.io.frames import Faces, Frame, plane_of_frames
from torchliner.io.hdf5 import is_there, open_file
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.points import stated_factor
from torchliner.io.stored_values import require_stored
from torchliner.io.text_rows import last_digit
from torchliner.records import VelocityPlane
from torchliner.records.numbered_files import numbered_series

ENDINGS = (".vtp", ".vtk", ".vtu", ".vti", ".vts", ".vtr", ".vtm")
TIMES = ("time", "timevalue")  # names of the clock in a file, in any case
XML_KIND = re.compile(rb"<VTKFile[^>]*\btype=[\"'](\w+)")
KINDS = {
    "PolyData": ".vtp",
    "UnstructuredGrid": ".vtu",
    "ImageData": ".vti",
    "StructuredGrid": ".vts",
    "RectilinearGrid": ".vtr",
    "vtkMultiBlockDataSet": ".vtm",
}
PARTS = ("points", "point_data", "cell_data")
TEXT_DIGITS = 7  # that writers of times give at least
Series = tuple[list[tuple[Path, Callable[[], Frame]]], list[float], list[Decimal]]


def recognises(path: Path, head: bytes) -> bool:
    """A VTK file, a collection of them, EnSight, or a folder that holds some."""
    with suppress(OSError, ValueError):
        if path.is_dir():
            return any(each.suffix in (*ENDINGS, ".pvd") for each in path.iterdir())
        if head.startswith(b"\x89HDF\r\n\x1a\n"):
            with open_file(path) as file:
                return is_there(file, "VTKHDF", path) and isinstance(file["VTKHDF"], h5py.Group)
    return _ending(path, head) in (*ENDINGS, ".pvd", ".series", ".case")


def _ending(path: Path, head: bytes) -> str:
    """The ending that says of what kind a file is by its content; "" of others."""
    kind = XML_KIND.search(head[:1024])
    if head.startswith(b"# vtk DataFile"):
        return ".vtk"
    if b'"file-series-version"' in head:
        return ".series"
    if re.match(rb"(#.*\s+)*FORMAT\s+type:\s*ensight", head):
        return ".case"
    if kind is None:
        return ".vtp" if b"<VTKFile" in head[:1024] else ""
    return ".pvd" if kind[1] == b"Collection" else KINDS.get(kind[1].decode(), path.suffix)


def open_series(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a series of frames.

    Args:
        path: collection, any of the numbered files, or their folder.
        request: units of length and velocity, which VTK does not state; ``group`` names the series
            where a folder has several, or the block; ``sampling_rate`` where none states its time, or not in s.
    Raises:
        ImportError: pyvista is not installed.
        ValueError: VTK cannot read a frame; a unit or the rate is missing; several series; fewer than two frames;
            frames are missing; as ``clock_of`` and ``plane_of_frames``.
    """
    with naming(path):
        frames, times, numbers = _series(path, request.group)
    absent = [file for file, _ in frames if not file.is_file()]
    if absent:
        raise ValueError(f"{path}: {len(absent)} of {len(frames)} frames are not there, the first {absent[0]}")
    if len(frames) < 2:
        raise ValueError(
            f"{path} is one frame; a plane needs the series: numbered files of one name, or a .pvd of them"
        )
    first, rate = frames[0][1](), request.sampling_rate
    factor, length = (stated_factor(request, quantity, f"{path}") for quantity in ("velocity", "length"))
    if not times and first.time is None:
        if rate is None or not numbers:
            raise ValueError(f"{frames[0][0]} states no time (TimeValue); state sampling_rate=... (--sampling-rate HZ)")
        _require_all(numbers, path)

    def clock(stated: list[float | None]) -> tuple[float, float]:
        known = np.array(times or stated, np.float64)
        if np.isnan(known).all() and rate is not None:
            return rate, 0.0
        return clock_of(known, f"{path}, times", rate, last_digit(known, TEXT_DIGITS))

    return plane_of_frames(frames, clock, request, path, factor, length, format="VTK series")


def _series(path: Path, group: str | None) -> Series:
    """Frames of a series in order; their times where it states them, or the numbers of its files."""
    if path.is_dir():
        collections = sorted(path.glob("*.pvd"))
        if group is None and len(collections) == 1:
            return _series(collections[0], None)
        series = numbered_series(path, ENDINGS)
        files = series.get(group or ", ".join(series))
        if files is None:
            raise ValueError(f"{path} holds the series {', '.join(sorted(series)) or 'none'}; name one (--group)")
        return [(each, partial(read_frame, each)) for each in files], [], [*files.values()]
    require_regular(path)
    with path.open("rb") as file:
        ending = _ending(path, file.read(4096))
    if ending in (".pvd", ".series"):
        rows = sorted(_listed(path, ending), key=lambda row: row[0])
        found = [path.parent / name for _, name in rows]
        return [(each, partial(read_frame, each, group)) for each in found], [time for time, _ in rows], []
    if ending in (".case", ""):
        return _steps(path, ending or ".vtkhdf", group)
    series = numbered_series(path.parent, (path.suffix,))
    files = next((files for files in series.values() if path in files), {path: Decimal(0)})
    return [(each, partial(read_frame, each, group)) for each in files], [], [*files.values()]


def _listed(path: Path, ending: str) -> list[tuple[float, str]]:
    """Times and files of a collection."""
    if ending == ".series":
        return [(float(each["time"]), str(each["name"])) for each in json.loads(path.read_bytes())["files"]]
    try:
        tags = ElementTree.fromstring(path.read_bytes()).iter("DataSet")
    except ElementTree.ParseError as error:
        raise ValueError(f"{path} is no whole XML: {error}; write it again, or close its tags") from error
    return [(float(tag.attrib["timestep"]), tag.attrib["file"]) for tag in tags]


def _steps(path: Path, ending: str, group: str | None) -> Series:
    """Frames of a file that holds several: EnSight, VTKHDF."""
    if ending == ".vtkhdf":
        _require_written(path)
    reader = _reader(path, ending)
    if ending == ".case":
        times, go = list(reader.time_values), reader.set_active_time_point
    else:
        times, go = [0.0] * reader.reader.GetNumberOfSteps(), reader.reader.SetStep

    def read(i: int) -> Frame:
        go(i)
        return _frame(reader, path, group)

    frames: list[tuple[Path, Callable[[], Frame]]] = [(path, partial(read, i)) for i in range(len(times))]
    return frames, times if ending == ".case" else [], []


def _require_written(path: Path) -> None:
    """Refuse a VTKHDF file whose values were never all written: HDF5 would give zeros for the others."""
    with open_file(path) as file:
        if "Steps" not in file["VTKHDF"]:
            raise ValueError(f"{path}:/VTKHDF has no Steps: it is one frame, a plane needs several")
        for section in ("PointData", "CellData"):
            for data in file["VTKHDF"].get(section, {}).values():
                if isinstance(data, h5py.Dataset):
                    require_stored(data, f"{path}:{data.name}", path)


def read_frame(path: Path, group: str | None = None) -> Frame:
    """A file of one frame; of an array on points and on faces, that on faces.

    Args:
        path: file.
        group: name of the block that is read, where there are several.
    Raises:
        ImportError: pyvista is not installed.
        ValueError: VTK cannot read all of it, or it holds several blocks.
    """
    require_regular(path)
    require_memory(path.stat().st_size, f"{path}")
    with path.open("rb") as file:
        ending = _ending(path, file.read(1024))
    return _frame(_reader(path, ending or path.suffix), path, group)


def _reader(path: Path, ending: str) -> Any:
    try:
        import pyvista
    except ImportError as error:
        raise ImportError(f"{path}: files of VTK are read by pyvista: pip install 'torchliner[vtk]'") from error
    return _by_vtk(path, partial(pyvista.get_reader, path, ending))


def _by_vtk(path: Path, work: Callable[[], Any]) -> Any:
    """What VTK does; errors that it only prints are errors."""
    import pyvista

    with pyvista.VtkErrorCatcher(send_to_logging=False) as caught:
        try:
            found = work()
        except (ValueError, RuntimeError, TypeError, AttributeError, KeyError) as error:
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
    if mesh is None or not all(hasattr(mesh, name) for name in PARTS):
        raise ValueError(f"{path} holds {type(mesh).__name__}, no points with values")
    mesh = mesh.copy(deep=False)  # a reader of steps fills the same one again
    first, count = 0, mesh.n_cells
    if hasattr(mesh, "GetPolys"):
        if strips := mesh.GetNumberOfStrips():
            raise ValueError(f"{path} has {strips} triangle strips, whose values are not read: triangulate the surface")
        first, count = mesh.GetNumberOfVerts() + mesh.GetNumberOfLines(), mesh.GetNumberOfPolys()
    arrays = {name: (False, _columns(mesh.point_data[name])) for name in mesh.point_data}
    for name in mesh.cell_data:
        arrays[name] = (True, _columns(mesh.cell_data[name])[first : first + count])
    times = [
        float(time) for name in mesh.field_data if name.lower() in TIMES for time in mesh.field_data[name].flat[:1]
    ]
    return Frame(np.asarray(mesh.points, np.float64), arrays, cache(partial(_faces, mesh)), times[0] if times else None)


def _columns(values: Any) -> np.ndarray:
    return np.asarray(values).reshape(len(values), -1)


def _faces(mesh: Any) -> Faces | None:
    """Corners of all faces, where those of each end, and kinds; None of points alone."""
    from pyvista import convert_array

    if hasattr(mesh, "dimensions"):
        mesh = mesh.cast_to_unstructured_grid()
    faces = mesh.GetCells() if hasattr(mesh, "GetCells") else mesh.GetPolys()
    if not faces.GetNumberOfCells():
        return None
    corners, ends = (convert_array(each) for each in (faces.GetConnectivityArray(), faces.GetOffsetsArray()))
    return corners, ends[1:], getattr(mesh, "celltypes", None)


def _require_all(numbers: Sequence[Decimal], path: Path) -> None:
    """Refuse names whose numbers show that frames are missing; uneven counts of steps may pass.

    Raises:
        ValueError: two have one number, or multiples of a step have a gap.
    """
    steps = np.diff(np.array(numbers, np.float64))
    usual = float(np.median(steps))
    if steps.min() <= 0:
        raise ValueError(f"{path}: two frames have the number {numbers[int(steps.argmin())]}; leave one of them there")
    lost = np.rint(steps / usual) - 1
    if lost.any() and (np.abs(steps / usual - lost - 1) < 0.1).all():
        before = numbers[int((lost > 0).argmax())]
        raise ValueError(
            f"{path}: {int(lost.sum())} frames are missing, the first after number {before}; restore them, or keep one "
            "stretch between the gaps"
        )


FORMAT = PlaneFormat(
    "VTK series",
    recognises,
    open_series,
    ("variable", "group", "velocity_units", "length_units", "sampling_rate", "normal"),
)
