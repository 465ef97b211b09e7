"""OpenFOAM's probes (`# Probe i (x y z)`, rows `time (u v w) ...`, one file a restart) and sampled surfaces: a folder
for each time, in it files of VTK or raw."""

from __future__ import annotations

import re
from contextlib import suppress
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from torchliner.checks import require_choice, tell
from torchliner.io.clocks import uniform_rate
from torchliner.io.frames import Frame, plane_of_frames
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.points import direction_of, named, place
from torchliner.io.text_rows import SPACES, Rows, TextFile, last_digit, number_of, open_text, parse_rows
from torchliner.io.vtk import read_frame
from torchliner.names import OVERLAPS
from torchliner.records import VelocityPlane

PROBE = re.compile(r"#\s*Probe\s+(\d+)\s+\(\s*(\S+)\s+(\S+)\s+(\S+)\s*\)(.*)")
UNSET = 1e30  # beyond it: what the solver writes where a probe has no cell
SAME_VALUE = 1e-5  # of the largest value: two runs' values of one instant as they are printed
# `# U  FACE_DATA 4`, then `# x y z U_x U_y U_z`.
RAW = re.compile(rb"#\s*(\w+)\s+(FACE|POINT)_DATA\s+(\d+)\s*\n#[^\n]*\n")
RAW_NAME = re.compile(r"(?:U_(.+)|(.+)_U)\.raw")
OF_VTK = (".vtp", ".vtk", ".vtu")


def time_folders(path: Path) -> list[Path]:
    """Folders called by a time, in its order."""
    found = [each for each in path.iterdir() if number_of(each.name)[0] is not None and each.is_dir()]
    return sorted(found, key=lambda each: float(each.name))


def are_probes(path: Path, head: bytes) -> bool:
    """A file of probes, or the folder of their restarts."""
    if not path.is_dir():
        return head.lstrip().startswith(b"# Probe 0")
    with suppress(OSError):
        files = [each for folder in time_folders(path)[:1] for each in folder.iterdir() if each.is_file()]
        return any(each.read_bytes()[:9] == b"# Probe 0" for each in files)
    return False


def open_probes(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a file of probes, or of all restarts in ``postProcessing/NAME``.

    Raises:
        FileNotFoundError, OSError: no such file or folder.
        ValueError: no such quantity; restarts with other probes, with a gap, or with other values
            at the same times; as ``TextFile.rows``, ``uniform_rate`` and ``place``.
    Warns:
        DataWarning: probes outside the mesh, which are left out; a row that is not whole.
    """
    name = request.variable or ("U" if path.is_dir() else path.name)
    files = [path]
    if path.is_dir():
        files = [each / name for each in time_folders(path) if (each / name).is_file()]
        if not files:
            there = sorted({file.name for each in time_folders(path) for file in each.iterdir()})
            raise ValueError(f"{path} has no {name!r} in the folders of its times; there are: {', '.join(there)}")
    texts, label = [open_text(file) for file in files], f"{path}:/{name}"
    points, outside = _probes(texts[0])
    for text in texts[1:]:
        others, lost = _probes(text)
        if others.shape != points.shape or lost != outside or not np.allclose(others, points):
            raise ValueError(f"{text.path} has other probes ({len(others)}) than {files[0]} ({len(points)})")
    probe, width = np.delete(np.arange(len(points)), outside), texts[0].width
    each = (width - 1) // len(points)
    if (width - 1) % len(points) or each not in (1, 3) or not len(probe):
        raise ValueError(
            f"{files[0]}: rows have {width - 1} values for {len(points)} probes, {len(probe)} of them in the mesh; "
            "vectors, or one component, are needed"
        )
    if outside:
        tell(
            f"{label}: probes {', '.join(map(str, outside[:8]))}{' ...' if len(outside) > 8 else ''} lie outside the "
            f"mesh ('Not Found'): left out, {len(probe)} remain"
        )
    placed = place(points[probe], request, label, direction_of(name, request, label) if each == 1 else None)
    columns = 1 + each * probe[placed.order] + (placed.axis if each == 3 else 0)
    rows = _joined(texts, columns.tolist(), request.overlap or "refuse")
    values = rows.values
    values *= placed.sign
    values[(values > UNSET) | (values < -UNSET)] = np.nan
    rate = uniform_rate(rows.time, f"{label}, time", rows.rounding)
    return placed.plane(values, rate, float(rows.time[0]), path, format="OpenFOAM probes", files=len(files))


def _probes(text: TextFile) -> tuple[np.ndarray, list[int]]:
    """Points, (N, 3), and the numbers of those outside the mesh."""
    found = [match for line in text.heading if (match := PROBE.fullmatch(line.strip()))]
    if [int(match[1]) for match in found] != list(range(len(found))) or not found:
        raise ValueError(f"{text.path}: its heading numbers no probes '# Probe 0 (x y z)' and so on")
    points = np.array([[float(match[i]) for i in (2, 3, 4)] for match in found])
    return points, [i for i, match in enumerate(found) if "Not Found" in match[5]]


def _joined(texts: list[TextFile], columns: list[int], overlap: str) -> Rows:
    """Rows of all restarts in the order of time, each instant once; ``overlap`` as of ``PlaneRequest``.

    Raises:
        ValueError: an overlap in which the later run has other values.
    """
    require_choice("overlap", overlap, OVERLAPS)
    whole = texts[0].rows(0, columns)
    for before, text in pairwise(texts):
        part = text.rows(0, columns)
        step = np.median(np.diff(part.time if len(part.time) > 1 else whole.time))
        again = int(np.searchsorted(part.time, whole.time[-1] + step / 2))
        begin = int(np.searchsorted(whole.time, part.time[0] - step / 2))
        old = whole.values[begin : begin + again]
        new = part.values[: len(old)]
        with np.errstate(invalid="ignore"):  # inf, where a probe has no cell, in both
            error = np.where(old == new, 0.0, np.abs(old - new)).max(1, initial=0.0)
        if overlap != "refuse" and len(old):
            tell(f"{text.path} begins {len(old)} samples before {before.path} ends; the {overlap} ones count")
        elif not (error <= SAME_VALUE * np.abs(old[np.isfinite(old)]).max(initial=0.0)).all():
            raise ValueError(
                f"{text.path} begins {len(old)} samples before {before.path} ends, with other values: at "
                f"{part.time[error.argmax()]:.9g} s they differ by up to {error.max():.4g} m/s; say which "
                "count with overlap='later' or 'earlier' (--overlap)"
            )
        kept, again = (begin, 0) if overlap == "later" else (len(whole.time), again)
        whole = Rows(
            np.append(whole.time[:kept], part.time[again:]),
            max(whole.rounding, part.rounding),
            np.concatenate([whole.values[:kept], part.values[again:]]),
        )
    return whole


def surfaces_of(folder: Path) -> dict[str, Path]:
    """Files of VTK or raw in a time folder by the name of their surface, or its folder in the format foamFile."""
    found: dict[str, Path] = {}
    for each in sorted(folder.iterdir()):
        raw = RAW_NAME.fullmatch(each.name)
        if raw is not None or each.suffix in OF_VTK or (each / "points").is_file():
            found.setdefault((raw[1] or raw[2]) if raw else each.stem if each.is_file() else each.name, each)
    return found


def _series(path: Path) -> tuple[Path, list[Path], str | None]:
    """The folder of the time folders that a path, its folder or that of this is, these, and the surface of a file."""
    for root in (path, path.parent, path.parent.parent):
        folders = time_folders(root) if root.is_dir() else []
        if not folders or (root != path and root / path.relative_to(root).parts[0] not in folders):
            continue
        if root in (path, path.parent):
            return root, folders, None
        # A folder called 2024 is no time: a surface stands in several of them.
        name = next((name for name, file in surfaces_of(path.parent).items() if file == path), None)
        several = sum((each / path.name).exists() for each in folders[:3]) > 1
        return root, folders if several and name is not None else [], name
    return path, [], None


def are_surfaces(path: Path, head: bytes) -> bool:
    """A folder of time folders that hold surfaces, or one of them, or a file in one."""
    with suppress(OSError):
        _, folders, _ = _series(path)
        return bool(folders) and bool(surfaces_of(folders[0]))
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
    root, folders, name = _series(path)
    listed = [surfaces_of(folder) for folder in folders]
    there = {each for found in listed for each in found}
    group = request.group or name or (", ".join(there) if len(there) == 1 else None)
    if group not in there:
        raise ValueError(f"{path} holds the surfaces {', '.join(sorted(there))}; name one as group (--group)")
    absent = [folder.name for folder, found in zip(folders, listed, strict=True) if group not in found]
    if absent:
        raise ValueError(
            f"{root}: {len(absent)} of {len(folders)} times, {', '.join(absent[:3])}, have no surface {group!r}; "
            "sample it at all times, or give only those that have it"
        )
    files = [found[group] for found in listed]
    if files[0].is_dir():
        raise ValueError(f"{files[0]} is a surface in the format foamFile: sample with surfaceFormat vtk or raw")
    time = np.array([float(folder.name) for folder in folders])
    digits = max(number_of(folder.name)[1] for folder in folders)
    rate = uniform_rate(time, f"{root}, times", last_digit(time, digits))
    frames = [(file, partial(read_raw if file.suffix == ".raw" else read_frame, file)) for file in files]
    start = float(time[0])
    return plane_of_frames(frames, lambda _: (rate, start), request, root, format=f"OpenFOAM surface {group}")


def read_raw(path: Path) -> Frame:
    """A file `# U FACE_DATA 4`, `# x y z U_x U_y U_z` and its rows; its points are centres already."""
    text = path.read_bytes()
    head = RAW.match(text)
    if head is None:
        raise ValueError(f"{path} begins with {text[:30]!r}, not '# U FACE_DATA N'")
    rows = text[head.end() :].translate(SPACES)
    table = parse_rows(rows, len(rows.partition(b"\n")[0].split()), str(path))
    if len(table) != int(head[3]):
        raise ValueError(f"{path}: {len(table)} rows; {int(head[3])} are needed")
    return Frame(table[:, :3], {head[1].decode(): (False, table[:, 3:].astype(np.float32))})


PROBES = PlaneFormat("OpenFOAM probes", are_probes, named(open_probes), ("variable", "normal"))
SURFACES = PlaneFormat("OpenFOAM surfaces", are_surfaces, named(open_surfaces), ("variable", "group", "normal"))
