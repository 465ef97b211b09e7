"""OpenFOAM's probes (`# Probe i (x y z)`, rows `time (u v w) ...`, one file a restart) and sampled surfaces: a folder
for each time, in it files of VTK or raw."""

import math
import re
from functools import partial
from pathlib import Path

import numpy as np

from torchliner.io.histories import open_text
from torchliner.io.plane_format import PlaneFormat, PlaneRequest, clock_of
from torchliner.io.plane_parts import join_planes
from torchliner.io.points import Frame, Frames, column_of, place, plane_of_frames
from torchliner.io.vtk import read_frame
from torchliner.records import VelocityPlane
from torchliner.text_columns import number_of

PROBE = re.compile(r"#\s*Probe\s+(\d+)\s+\(\s*(\S+)\s+(\S+)\s+(\S+)\s*\)")
UNSET = 1e30  # beyond it: what the solver writes where a probe has no cell
RAW = re.compile(r"#\s*(\w+)\s+(?:FACE|POINT)_DATA\s+(\d+)$")  # before `# x y z U_x U_y U_z`
SURFACE = re.compile(r"(?:U_(.+)|(.+)_U)\.raw|(.+)\.(?:vtp|vtk|vtu)")


def time_folders(path: Path) -> list[Path]:
    """Folders called by a time, in its order."""
    found = [each for each in path.iterdir() if math.isfinite(number_of(each.name)) and each.is_dir()]
    return sorted(found, key=lambda each: float(each.name))


def are_probes(path: Path, head: bytes) -> bool:
    """A file of probes, or the folder of their restarts."""
    if not path.is_dir():
        return head.lstrip().startswith(b"# Probe 0")
    files = [each for folder in time_folders(path)[:1] for each in folder.iterdir() if each.is_file()]
    return any(each.read_bytes()[:9] == b"# Probe 0" for each in files)


def open_probes(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a file of probes, or of all restarts in ``postProcessing/NAME``, which are joined; what the solver
    writes for probes outside the mesh is nan."""
    if not path.is_dir():
        return _one_run(path, request.variable or path.name, request)
    name = request.variable or "U"
    files = [each / name for each in time_folders(path) if (each / name).is_file()]
    if not files:
        there = sorted({file.name for each in time_folders(path) for file in each.iterdir()})
        raise ValueError(f"{path} has no {name!r} in the folders of its times; there are: {', '.join(there)}")
    return join_planes([_one_run(each, name, request) for each in files], overlap=request.overlap or "refuse")


def _one_run(path: Path, name: str, request: PlaneRequest) -> VelocityPlane:
    text, label = open_text(path), f"{path}:/{name}"
    found = [match for line in text.heading if (match := PROBE.match(line.strip()))]
    if [int(match[1]) for match in found] != list(range(len(found))) or not found:
        raise ValueError(f"{path}: its heading numbers no probes '# Probe 0 (x y z)' and so on")
    points = np.array([[float(match[i]) for i in (2, 3, 4)] for match in found])
    each, rest = divmod(text.width - 1, len(points))
    if rest:
        raise ValueError(f"{path}: rows have {text.width - 1} values for {len(points)} probes")
    column = column_of(name, each, request, label)
    placed = place(points, request, label)
    rows = text.rows()
    values = rows[:, 1 + each * placed.order + column]
    values[np.abs(values) > UNSET] = np.nan
    rate, start = clock_of(rows[:, 0], f"{label}, time", None)
    return placed.plane((placed.sign * values).astype(np.float32), rate, start, path, format="OpenFOAM probes")


def surfaces_of(folder: Path) -> dict[str, Path]:
    """Files of VTK or raw in a time folder by the name of their surface."""
    found = {each: SURFACE.fullmatch(each.name) for each in sorted(folder.iterdir())}
    return {name[1] or name[2] or name[3]: each for each, name in found.items() if name}


def are_surfaces(path: Path, head: bytes) -> bool:
    """A folder of time folders that hold surfaces."""
    return path.is_dir() and any(surfaces_of(each) for each in time_folders(path)[:1])


def open_surfaces(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of one surface, ``group`` of several, at all times in ``postProcessing/NAME``."""
    listed = {folder.name: surfaces_of(folder) for folder in time_folders(path)}
    names = sorted({each for found in listed.values() for each in found})
    group = request.group or ", ".join(names)
    absent = [time for time, found in listed.items() if group not in found]
    if absent:
        raise ValueError(
            f"{path} holds the surfaces {', '.join(names)}; {len(absent)} of {len(listed)} times, "
            f"{', '.join(absent[:3])}, have no surface {group!r}: name one as group (--group) that all have"
        )
    files = [found[group] for found in listed.values()]
    readers = [partial(read_raw if file.suffix == ".raw" else read_frame, file) for file in files]
    frames: Frames = list(zip(files, readers, map(float, listed), strict=True))
    return plane_of_frames(frames, request, path, timed=True, si=True, format=f"OpenFOAM surface {group}")


def read_raw(path: Path) -> Frame:
    """A file `# U FACE_DATA 4`, `# x y z U_x U_y U_z` and its rows; its points are centres already."""
    text = open_text(path)
    head = RAW.match(text.heading[0])
    table = text.rows(whole=True)
    if head is None or len(table) != int(head[2]):
        raise ValueError(f"{path}: '# U FACE_DATA {len(table)}' is needed, not {text.heading[0]!r}")
    return Frame({head[1]: (False, table[:, 3:].astype(np.float32))}, lambda _: (table[:, :3], None))


PROBES = PlaneFormat("OpenFOAM probes", are_probes, open_probes, ("variable", "normal"))
SURFACES = PlaneFormat("OpenFOAM surfaces", are_surfaces, open_surfaces, ("variable", "group", "normal"))
