"""OpenFOAM's probes: `# Probe i (x y z)`, rows `time (u v w) (u v w) ...`, one file a restart."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.checks import require_choice, tell
from torchliner.io.clocks import uniform_rate
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.point_layout import direction_of, named, plane_at
from torchliner.io.text_rows import TextRows, bytes_at, index_rows, number_of
from torchliner.names import OVERLAPS
from torchliner.records import VelocityPlane

PROBE = re.compile(r"#\s*Probe\s+(\d+)\s+\(\s*(\S+)\s+(\S+)\s+(\S+)\s*\)(.*)")
UNSET = 1e30  # beyond it: what the solver writes where a probe has no cell
SAME = 1e-5  # of the largest value: two runs' values of one instant as they are printed
COMPARED = 1 << 24  # bytes of an overlap, of which a longer one has samples spread over it


@dataclass
class ProbeColumns:
    """One component of all probes from rows of text."""

    rows: TextRows
    width: int
    columns: tuple[int, ...]

    def __call__(self, begin: int, end: int) -> np.ndarray:
        """Values, (t, N); nan where the solver had none."""
        found = self.rows.numbers(begin, end, self.width, self.columns)
        found[np.abs(found) > UNSET] = np.nan
        return found


def recognises(path: Path, head: bytes) -> bool:
    """A file of probes, or the folder of their restarts."""
    if not path.is_dir():
        return head.lstrip().startswith(b"# Probe 0")
    with suppress(OSError):
        return any(_is_probes(file) for folder in _times(path)[:1] for file in folder.iterdir())
    return False


def _is_probes(file: Path) -> bool:
    return file.is_file() and bytes_at(file, 0).startswith(b"# Probe 0")


def _times(path: Path) -> list[Path]:
    """Folders called by a time, in its order."""
    found = [each for each in path.iterdir() if number_of(each.name)[0] is not None]
    return sorted((each for each in found if each.is_dir()), key=lambda each: float(each.name))


def open_probes(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a file of probes, or of all restarts in ``postProcessing/NAME``.

    Raises:
        FileNotFoundError, OSError: no such file or folder.
        ValueError: no such quantity; restarts with other probes, with a gap, or with other values
            at the same times; as ``index_rows``, ``uniform_rate`` and ``plane_at``.
    Warns:
        DataWarning: probes outside the mesh, which are left out; a row that is not whole.
    """
    name = request.variable or ("U" if path.is_dir() else path.name)
    files = [path]
    if path.is_dir():
        files = [each / name for each in _times(path) if (each / name).is_file()]
        if not files:
            there = sorted({file.name for each in _times(path) for file in each.iterdir()})
            raise ValueError(f"{path} has no {name!r} in the folders of its times; there are: "
                             f"{', '.join(there)}; name one (--variable)")  # fmt: skip
    parts = [index_rows(file) for file in files]
    points, outside = _probes(parts[0], files[0])
    for part, file in zip(parts[1:], files[1:], strict=True):
        others, lost = _probes(part, file)
        if others.shape != points.shape or lost != outside or not np.allclose(others, points):
            raise ValueError(f"{file} has other probes ({len(others)}) than {files[0]} "
                             f"({len(points)}); give the restarts that have the same")  # fmt: skip
    probe = np.array([i for i in range(len(points)) if i not in set(outside)], np.int64)
    width = parts[0].width
    each = (width - 1) // len(points)
    if (width - 1) % len(points) or each not in (1, 3):
        raise ValueError(f"{files[0]}: rows have {width - 1} values for {len(points)} probes; "
                         "vectors, or one component, are needed")  # fmt: skip

    component = direction_of(name, request, f"{path}:/{name}") if each == 1 else None

    def columns(axis: int) -> tuple[int, ...]:
        return tuple((1 + each * probe + (axis if each == 3 else 0)).tolist())

    rows = _joined(parts, width, columns(0 if each == 1 else 1), request.overlap or "refuse")
    label = f"{path}:/{name}, time"
    if outside:
        tell(f"{path}:/{name}: probes {', '.join(map(str, outside[:8]))}"
             f"{' ...' if len(outside) > 8 else ''} lie outside the mesh ('Not Found'): left out, "
             f"{len(probe)} remain", depth=2)  # fmt: skip
    return plane_at(
        points[probe], request, lambda axis: ProbeColumns(rows, width, columns(axis)), len(rows),
        uniform_rate(rows.first, label, rows.rounding) if len(rows) > 1 else 1.0,
        path=path, variable=name, component=component,
        format="OpenFOAM probes", files=len(files), start=float(rows.first[0]),
    )  # fmt: skip


def _probes(rows: TextRows, path: Path) -> tuple[np.ndarray, list[int]]:
    """Points, (N, 3), and the numbers of those outside the mesh."""
    found = [match for line in rows.heading if (match := PROBE.fullmatch(line.strip()))]
    if [int(match[1]) for match in found] != list(range(len(found))) or not found:
        raise ValueError(f"{path}: its heading numbers no probes '# Probe 0 (x y z)' and so on; "
                         "restore it from the run")  # fmt: skip
    points = np.array([[float(match[i]) for i in (2, 3, 4)] for match in found])
    return points, [i for i, match in enumerate(found) if "Not Found" in match[5]]


def _joined(parts: list[TextRows], width: int, columns: tuple[int, ...], overlap: str) -> TextRows:
    """Rows of all restarts in the order of time, each instant once; ``overlap`` as of ``PlaneRequest``."""
    require_choice("overlap", overlap, OVERLAPS)
    whole = parts[0]
    for part in parts[1:]:
        step = np.median(np.diff(part.first if len(part) > 1 else whole.first))
        again = int(np.searchsorted(part.first, whole.first[-1] + step / 2))
        if overlap == "refuse":
            _require_same(whole, part.part(slice(0, again)), width, columns, step)
        elif again:
            tell(f"{part.paths[0]} begins {again} samples before {whole.paths[-1]} ends; the {overlap} ones count")
        if overlap == "later":
            whole, again = whole.part(slice(0, int(np.searchsorted(whole.first, part.first[0] - step / 2)))), 0
        rest = part.part(slice(again, None))
        joined: dict[str, Any] = {name: np.append(getattr(whole, name), getattr(rest, name))
                  for name in ("begin", "end", "line", "first")}  # fmt: skip
        whole = replace(
            whole, paths=(*whole.paths, *part.paths),
            file=np.append(whole.file, rest.file + len(whole.paths)),
            rounding=max(whole.rounding, part.rounding), **joined,
        )  # fmt: skip
    return whole


def _require_same(whole: TextRows, again: TextRows, width: int, columns: tuple[int, ...], step: float) -> None:
    """Refuse an overlap in which the later run has other values."""
    if not len(again):
        return
    begin = int(np.searchsorted(whole.first, again.first[0] - step / 2))
    count = min(len(again), len(whole) - begin)
    most = max(2, COMPARED // int((again.end - again.begin).max()))
    some = np.unique(np.linspace(0, count - 1, min(most, count)).astype(int))
    old, new = (part.part(rows).numbers(0, len(some), width, columns)
                for part, rows in ((whole, begin + some), (again, some)))  # fmt: skip
    error = np.abs(old - new).max(1)
    if not (error <= SAME * np.abs(old).max()).all():
        raise ValueError(
            f"{again.paths[0]} begins {count} samples before {whole.paths[-1]} ends, with other "
            f"values: at {again.first[some[error.argmax()]]:.9g} s they differ by up to "
            f"{error.max():.4g} m/s; say which count with overlap='later' or 'earlier' (--overlap)"
        )


FORMAT = PlaneFormat("OpenFOAM probes", recognises, named(open_probes), ("variable", "normal"))
