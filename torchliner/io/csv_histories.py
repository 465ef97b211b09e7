"""Time histories as text: rows `time p1 p2 ...` of one variable, and where the points are.

Points stand in lines of the heading, or in a list of their own, which may begin with a line
`length_unit = m` and one with the names of its columns. Cells are parted by blanks, tabs, commas or
semicolons (then the decimal mark may be a comma).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import naming
from torchliner.io.arrays import read_array
from torchliner.io.clocks import clock_of, require_same_rate
from torchliner.io.plane_format import FrameVelocity, PlaneFormat, PlaneRequest
from torchliner.io.point_layout import (
    AXES,
    component_of,
    length_factor,
    named,
    plane_at,
    velocity_factor,
)
from torchliner.io.text_rows import TextRows, index_rows, number_of
from torchliner.names import ARRAY_ENDINGS
from torchliner.records import VelocityPlane
from torchliner.units import si_factor

UNIT = re.compile(r"(length|velocity)_unit\w*\s*[=:]?\s*(\S+)", re.IGNORECASE)
# `x [mm], 0.1, 0.2, ...`
COORDINATE = re.compile(r"([xyz])\s*(?:\[(.*?)\]|\((.*?)\))?\s*[,;:=\s]\s*(.*)", re.IGNORECASE)
LABEL = re.compile(r"([A-Za-z]\w*)\s*(?:\[([^\]]*)\]|\(([^)]*)\))?")
TIMES = ("time", "t")
COUNTER = re.compile(r"(iter|iterations?|(time ?)?steps?|cycles?|frames?)\b.*", re.IGNORECASE)
VECTOR = re.compile(r"(.*):(\d|magnitude)", re.IGNORECASE)


@dataclass
class Columns:
    """All columns but the first."""

    rows: TextRows
    width: int

    def __call__(self, begin: int, end: int) -> np.ndarray:
        """Values, (t, N)."""
        return self.rows.numbers(begin, end, self.width, range(1, self.width))


def recognises(path: Path, head: bytes) -> bool:
    """Text whose first row of numbers has two at least, or that begins with a remark or `time`."""
    if not head or b"\0" in head:
        return False
    lines = [line.strip("\ufeff\r ") for line in head.decode("utf-8", "replace").split("\n")]
    if lines[0].startswith("#") or lines[0].lower().startswith(TIMES[0]):
        return True
    cells = [_cells(line) for line in lines]
    return any(len(row) > 1 and all(number_of(c)[0] is not None for c in row) for row in cells)


def _cells(line: str) -> list[str]:
    return re.split(r"[\s,;()]+", line.strip(" \t\r,;()"))


def open_histories(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a file of histories.

    Args:
        path: text.
        request: ``points``, a list of them, text or array, whose columns are x, y, z, or named in
            it, or in the order of ``axes``; units that the files do not state; ``sampling_rate``
            where the times have no unit; ``normal``.
    Raises:
        ValueError: a unit is missing; another number of points than columns; as ``index_rows``,
            ``clock_of`` and ``plane_at``.
    """
    with naming(path):
        rows = index_rows(path)
        width = rows.width
    heading = [line.strip("# \t\r") for line in rows.heading]
    count, label = width - 1, str(path)
    units = {found[1].lower(): found[2] for line in heading if (found := UNIT.match(line))}
    labels = next((cells for line in reversed(heading) if (cells := LABEL.findall(line))
                   and cells[0][0].lower() in TIMES), [])  # fmt: skip
    _require_columns(heading, width, path)
    stated = {a or b for _, a, b in labels[1:]} - {""} or {units.get("velocity", "")} - {""}
    if len(stated) > 1:
        raise ValueError(f"{path}: columns are in {', '.join(sorted(stated))}; one unit is needed")
    if stated:
        factor = si_factor("velocity", stated.pop(), f"{path}: velocity")
    else:
        factor = velocity_factor(request, label)
    rate, start = _clock(rows, (labels[0][1] or labels[0][2]) if labels else "", request, path)
    points = _points_of(heading, count, units.get("length"), request, path) if (
        request.points is None) else read_points(Path(request.points), request)  # fmt: skip
    name = request.variable or path.stem
    source = Columns(rows, width)
    if points is None:
        turned = (request.normal or "").startswith("-")
        velocity = FrameVelocity(source, (count, len(rows)), label, -factor if turned else factor)
        return VelocityPlane(velocity, sampling_rate=rate, start=start, name=label, title=path.stem)
    if len(points) != count:
        raise ValueError(f"{path} has {count} columns of values, its points are {len(points)}"
                         f"{'' if request.points is None else f' ({request.points})'}")  # fmt: skip
    return plane_at(
        points, request, lambda axis: source, len(rows), rate, path=path, variable=name,
        component=component_of(name), factor=factor, start=start, format="time histories",
    )  # fmt: skip


def _require_columns(heading: Sequence[str], width: int, path: Path) -> None:
    """Columns that a heading parts as cells are must be those of the rows, and velocities of
    probes.

    Raises:
        ValueError: more or fewer; a counter; components of a vector.
    """
    line = next((each for each in reversed(heading) if each.lower().lstrip('"').startswith(TIMES)),
                "")  # fmt: skip
    mark = next((each for each in "\t;," if each in line), None)
    names = [each.strip('" ') for each in line.split(mark)]
    if mark is not None and names[-1:] == [""]:
        names.pop()
    if mark is not None and len(names) != width:
        raise ValueError(
            f"{path}: its heading names {len(names)} columns, {', '.join(names[:4])} ..., and its "
            f"first row holds {width} numbers; leave empty columns out, and write decimals with "
            "points, or commas between semicolons or tabs"
        )
    for name in names[1:]:
        if COUNTER.fullmatch(name):
            raise ValueError(f"{path}: its column {name!r} counts and is no velocity; leave it out")
        if VECTOR.fullmatch(name):
            raise ValueError(
                f"{path}: its column {name!r} is a component of a vector; leave the one along the "
                "wall normal alone for each probe"
            )


def _clock(rows: TextRows, unit: str, request: PlaneRequest, path: Path) -> tuple[float, float]:
    """Sampling rate, Hz, and time of the first row, s."""
    if len(rows) < 2:
        raise ValueError(f"{path} has one row; two at least are needed")
    if not unit and request.sampling_rate is None:
        raise ValueError(f"{path}: its times have no unit; write 'time [s]' above them, or state "
                         "sampling_rate=... (--sampling-rate HZ)")  # fmt: skip
    factor = si_factor("time", unit, f"{path}: time") if unit else 1.0
    stated = request.sampling_rate
    rate, start = clock_of(rows.first * factor, f"{path}, time", None if unit else stated, rows.rounding * factor)
    require_same_rate(rate, stated, str(path), unit)
    return stated or rate, start


def _points_of(
    heading: Sequence[str], count: int, unit: str | None, request: PlaneRequest, path: Path
) -> np.ndarray | None:
    """Points in lines of a heading, m: three lines of coordinates, a line each, or all in one.

    Raises:
        ValueError: coordinates of another number of points than ``count``; two axes are absent.
    """
    lines: dict[str, np.ndarray] = {}
    block: np.ndarray | None = None
    single: list[tuple[int, list[str], list[float]]] = []
    for place, line in enumerate(heading):
        found = COORDINATE.match(line)
        cells = _cells(found[4] if found else line)
        numbers = [n for cell in cells if (n := number_of(cell)[0]) is not None]
        if found is not None and len(numbers) == count:
            own = found[2] or found[3] or unit
            lines[found[1].lower()] = np.array(numbers) * _length(own, request, path)
        elif found is not None and len(numbers) == len(cells) > 1:
            raise ValueError(f"{path}: its heading has {len(numbers)} values of {found[1]}, but "
                             f"there are {count} columns of values; state points=...")  # fmt: skip
        elif len(numbers) == 3 * count and count > 1:
            block = np.reshape(numbers, (count, 3))
        elif len(numbers) in (3, 4) and UNIT.match(line) is None:
            words = [re.sub(r"\d+", "", c) for c in cells if number_of(c)[0] is None]
            single.append((place, [*words, str(len(numbers))], numbers[-3:]))
    if lines:
        absent = [axis for axis in AXES if axis not in lines]
        if len(absent) > 1:
            raise ValueError(f"{path}: its heading states {', '.join(lines)} of the points, not "
                             f"{', '.join(absent)}")  # fmt: skip
        # The coordinate along the normal may be left out.
        return np.stack([lines.get(axis, np.zeros(count)) for axis in AXES], 1)
    if block is not None:
        return block * _length(unit, request, path)
    # A list has lines of one kind, one below the other; a remark may hold three numbers too.
    alike = groupby(enumerate(single), lambda each: (each[1][0] - each[0], each[1][1]))
    runs = [[each[2] for _, each in group] for _, group in alike]
    whole = [[numbers for *_, numbers in single], *runs]
    fitting = [run for run in whole if len(run) == count]
    if fitting and all(run == fitting[0] for run in fitting):
        return np.array(fitting[0]) * _length(unit, request, path)
    if len(single) > 1:
        raise ValueError(f"{path}: {len(single)} lines of its heading may be points, but there are "
                         f"{count} columns of values; state points=..., or mend the heading"
                         )  # fmt: skip
    if single:
        tell(f"{path}, line {single[0][0] + 1} is a remark: one point does not place {count} "
             "columns of values", depth=2)  # fmt: skip
    return None


def _length(unit: str | None, request: PlaneRequest, path: Path) -> float:
    """Factor to m of what a file states, or else the user."""
    return si_factor("length", unit, f"{path}: points") if unit else length_factor(
        request, f"{path}: points")  # fmt: skip


def read_points(path: Path, request: PlaneRequest) -> np.ndarray:
    """Points of a list, m, (N, 3).

    Args:
        path: text, or an array (N, 3) of .npy, .mat, .h5.
        request: ``length_units`` where the list states none; ``axes``, the order of its columns
            where it names none.
    Raises:
        ValueError: no unit; columns that are not x, y, z.
    """
    words = request.axes if request.axes is not None else tuple(AXES)
    axes = [word.strip() for word in (words.split(",") if isinstance(words, str) else words)]
    unit, own = None, {}
    if path.suffix.lower() in ARRAY_ENDINGS:
        values = read_array(path).astype(float)
    else:
        rows = index_rows(path, whole=True)
        for line in (each.strip("# \t\r") for each in rows.heading):
            named = [(word.lower(), a or b) for word, a, b in LABEL.findall(line)]
            if (found := UNIT.match(line)) is not None:
                unit = found[2]
            elif {word for word, _ in named} >= set("xz"):
                axes = [word for word, _ in named]
                own = {word: each for word, each in named if each}
        values = rows.numbers(0, len(rows), rows.width, range(rows.width), np.float64)
    if values.ndim != 2 or values.shape[1] != len(axes) or sorted(axes) != list(AXES):
        raise ValueError(f"{path} has shape {values.shape} and columns {', '.join(axes)}; one row "
                         "a point of x, y, z is needed, another order is named above them or by "
                         "axes=('x', 'z', 'y') (--axes x,z,y)")  # fmt: skip
    # A unit above one column alone is that of all, as where it stands in a line of its own.
    units = {axis: own.get(axis) or unit or next(iter(own.values()), None) for axis in AXES}
    factors = [_length(units[axis], request, path) for axis in AXES]
    return values[:, [axes.index(axis) for axis in AXES]] * factors


FORMAT = PlaneFormat(
    "time histories", recognises, named(open_histories),
    ("variable", "axes", "velocity_units", "length_units", "sampling_rate", "normal", "points"),
)  # fmt: skip
