"""OpenFOAM's probes: `# Probe i (x y z)`, rows `time (u v w) (u v w) ...`, one file a restart."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from torchliner.checks import require_choice, tell
from torchliner.io.clocks import uniform_rate
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.point_layout import AXES, direction_of, named, plane_at, wall_normal
from torchliner.io.text_rows import Rows, TextFile, bytes_at, number_of, open_text
from torchliner.names import OVERLAPS
from torchliner.records import VelocityPlane

PROBE = re.compile(r"#\s*Probe\s+(\d+)\s+\(\s*(\S+)\s+(\S+)\s+(\S+)\s*\)(.*)")
UNSET = 1e30  # beyond it: what the solver writes where a probe has no cell
SAME = 1e-5  # of the largest value: two runs' values of one instant as they are printed


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
            at the same times; as ``TextFile.rows``, ``uniform_rate`` and ``plane_at``.
    Warns:
        DataWarning: probes outside the mesh, which are left out; a row that is not whole.
    """
    name = request.variable or ("U" if path.is_dir() else path.name)
    files = [path]
    if path.is_dir():
        files = [each / name for each in _times(path) if (each / name).is_file()]
        if not files:
            there = sorted({file.name for each in _times(path) for file in each.iterdir()})
            raise ValueError(
                f"{path} has no {name!r} in the folders of its times; there are: "
                f"{', '.join(there)}; name one (--variable)"
            )
    texts = [open_text(file) for file in files]
    points, outside = _probes(texts[0])
    for text in texts[1:]:
        others, lost = _probes(text)
        if others.shape != points.shape or lost != outside or not np.allclose(others, points):
            raise ValueError(
                f"{text.path} has other probes ({len(others)}) than {files[0]} ({len(points)}); give the restarts that "
                "have the same"
            )
    probe, width, label = np.delete(np.arange(len(points)), outside), texts[0].width, f"{path}:/{name}"
    each = (width - 1) // len(points)
    if (width - 1) % len(points) or each not in (1, 3) or not len(probe):
        raise ValueError(
            f"{files[0]}: rows have {width - 1} values for {len(points)} probes, {len(probe)} of them in the mesh; "
            "vectors, or one component, are needed"
        )
    if outside:
        tell(
            f"{label}: probes {', '.join(map(str, outside[:8]))}{' ...' if len(outside) > 8 else ''} lie outside the "
            f"mesh ('Not Found'): left out, {len(probe)} remain",
            depth=2,
        )
    component = direction_of(name, request, label) if each == 1 else None
    axis, sign = wall_normal(points[probe], request, label, component)
    rows = _joined(texts, (1 + each * probe + (axis if each == 3 else 0)).tolist(), request.overlap or "refuse")
    return plane_at(
        points[probe],
        replace(request, normal=f"{'-' if sign < 0 else ''}{AXES[axis]}"),
        lambda axis: rows,
        len(rows.time),
        uniform_rate(rows.time, f"{label}, time", rows.rounding),
        path=path,
        variable=name,
        component=component,
        format="OpenFOAM probes",
        files=len(files),
        start=float(rows.time[0]),
    )


def _probes(text: TextFile) -> tuple[np.ndarray, list[int]]:
    """Points, (N, 3), and the numbers of those outside the mesh."""
    found = [match for line in text.heading if (match := PROBE.fullmatch(line.strip()))]
    if [int(match[1]) for match in found] != list(range(len(found))) or not found:
        raise ValueError(
            f"{text.path}: its heading numbers no probes '# Probe 0 (x y z)' and so on; restore it from the run"
        )
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
        elif not (error <= SAME * np.abs(old[np.isfinite(old)]).max(initial=0.0)).all():
            raise ValueError(
                f"{text.path} begins {len(old)} samples before {before.path} ends, with other values: at "
                f"{part.time[error.argmax()]:.9g} s they differ by up to {error.max():.4g} m/s; say which "
                "count with overlap='later' or 'earlier' (--overlap)"
            )
        if overlap == "later":
            whole, again = Rows(whole.time[:begin], whole.rounding, whole.values[:begin]), 0
        whole = Rows(
            np.append(whole.time, part.time[again:]),
            max(whole.rounding, part.rounding),
            np.concatenate([whole.values, part.values[again:]]),
        )
    values = np.where(np.abs(whole.values) > UNSET, np.nan, whole.values)
    return replace(whole, values=values)


FORMAT = PlaneFormat("OpenFOAM probes", recognises, named(open_probes), ("variable", "normal"))
