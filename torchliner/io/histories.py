"""Time histories as text: rows `time p1 p2 ...` of one variable, and where the points are.

Points stand in lines of the heading, or in a list of their own, which may begin with a line
`length_unit = m` and one with the names of its columns. Cells are parted by blanks, tabs, commas or
semicolons (then the decimal mark may be a comma).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from torchliner.checks import tell
from torchliner.io.arrays import read_array
from torchliner.io.clocks import clock_of, require_same_rate
from torchliner.io.plane_format import Imported, PlaneFormat, PlaneRequest
from torchliner.io.points import AXES, component_of, named, place, require_velocity, stated_factor
from torchliner.io.text_rows import NUMERIC, number_of, open_text
from torchliner.names import ARRAY_ENDINGS
from torchliner.records import VelocityPlane
from torchliner.units import si_factor

UNIT = re.compile(r"(length|velocity)_unit\w*\s*[=:]?\s*(\S+)", re.IGNORECASE)
# `x [mm], 0.1, 0.2, ...`
COORDINATE = re.compile(r"([xyz])\s*(?:\[(.*?)\]|\((.*?)\))?\s*[,;:=\s]\s*(.*)", re.IGNORECASE)
LABEL = re.compile(r"([A-Za-z]\w*)\s*(?:\[([^\]]*)\]|\(([^)]*)\))?")
TIMES = ("time", "t")
NO_PROBE = re.compile(r"(iter(ation)?s?|(time ?)?steps?|cycles?|frames?)\b.*|.*:(\d|magnitude)", re.IGNORECASE)
INDEX = re.compile(r"(index|unnamed.*)?", re.IGNORECASE)  # of a table of pandas
Labels = list[tuple[str, str]]  # names and units


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
        ValueError: a unit is missing; another number of points than columns; as ``TextFile.rows``,
            ``clock_of`` and ``place``.
    """
    text, label = open_text(path), str(path)
    heading = [line.strip("# \t\r") for line in text.heading]
    units = {found[1].lower(): found[2] for line in heading if (found := UNIT.match(line))}
    at, labels = _columns(heading, text.width, path, request)
    stated = {unit for _, unit in labels[1:]} - {""} or {units.get("velocity", "")} - {""}
    if len(stated) > 1:
        raise ValueError(f"{path}: columns are in {', '.join(sorted(stated))}; one unit is needed")
    factor = stated_factor(request, "velocity", label) if not stated else si_factor("velocity", stated.pop(), label)
    count, name = text.width - at - 1, request.variable or path.stem
    if request.points is None:
        points = _points_of(heading, count, units.get("length"), request, path)
    else:
        points = read_points(Path(request.points), request)
    order, sign, placed = np.arange(count), -1.0 if (request.normal or "").startswith("-") else 1.0, None
    if points is not None:
        if len(points) != count:
            listed = "" if request.points is None else f" ({request.points})"
            raise ValueError(f"{path} has {count} columns of values, its points are {len(points)}{listed}")
        placed = place(points, request, f"{path}:/{name}", component_of(name))
        order, sign = placed.order, placed.sign
    rows = text.rows(at, (at + 1 + order).tolist())
    unit, rate = labels[0][1] if labels else "", request.sampling_rate
    unnamed = len(labels) == count and (unit or count > 2)
    if unnamed and np.array_equal(rows.time, np.arange(len(rows.time))):
        raise ValueError(
            f"{path}: its first column counts the rows and has no name, as an index of pandas; leave it out"
        )
    if not unit and rate is None:
        raise ValueError(
            f"{path}: its times have no unit; write 'time [s]' above them, or state sampling_rate=... "
            "(--sampling-rate HZ)"
        )
    second = si_factor("time", unit, f"{path}: time") if unit else 1.0
    own, start = clock_of(rows.time * second, f"{path}, time", None if unit else rate, rows.rounding * second)
    require_same_rate(own, rate, label, unit)
    if factor * sign != 1:
        np.multiply(rows.values, factor * sign, out=rows.values, casting="same_kind")
    if placed is not None:
        return placed.plane(rows.values, rate or own, start, path, format="time histories")
    velocity = Imported(rows.values, (count, len(rows.time)), label)
    return VelocityPlane(velocity, sampling_rate=rate or own, start=start, name=label, title=path.stem)


def _columns(heading: Sequence[str], width: int, path: Path, request: PlaneRequest) -> tuple[int, Labels]:
    """Which column is time, and name and unit of it and those after it, where a line of the heading names them.

    Raises:
        ValueError: it names more or fewer than there are; a counter; components of a vector; another quantity.
    """
    line, labels = "", Labels()
    for each in heading:
        found = [(name, a or b) for name, a, b in LABEL.findall(each.lstrip('",; \t'))]
        if found and found[0][0].lower() in (*TIMES, "index"):
            line, labels = each, found[found[0][0].lower() == "index" :]
    mark = next((each for each in "\t;," if each in line), None)
    if mark is None:
        return 0, labels
    names = [each.strip('" ') for each in line.split(mark)]
    names = names if names[-1] else names[:-1]
    at = 1 if INDEX.fullmatch(names[0]) else 0
    if len(names) != width:
        raise ValueError(
            f"{path}: its heading names {len(names)} columns, {', '.join(names[:4])} ..., and its "
            f"first row holds {width} numbers; leave empty columns out, and write decimals with "
            "points, or commas between semicolons or tabs"
        )
    for name in filter(NO_PROBE.fullmatch, names[at + 1 :]):
        raise ValueError(
            f"{path}: its column {name!r} is a counter or a component of a vector; leave one column a probe, of the "
            "velocity along the wall normal"
        )
    for stem in dict.fromkeys(re.sub(r"[\W\d_]*([\[(].*)?$", "", name) for name in names[at + 1 :]):
        if len(stem) > 1:  # p1 and p2 may be probes
            require_velocity(f"{path}:/{stem}", request)
    return at, labels


def _points_of(
    heading: Sequence[str], count: int, unit: str | None, request: PlaneRequest, path: Path
) -> np.ndarray | None:
    """Points in lines of a heading, m: a line of each coordinate, a line of each point, or all in one.

    Raises:
        ValueError: coordinates of another number of points than ``count``, or that are no numbers; two axes are absent.
    """
    lines: dict[str, np.ndarray] = {}
    single: list[tuple[int, list[str], list[float]]] = []
    for at, line in enumerate(heading):
        found = COORDINATE.match(line)
        cells = _cells(found[4] if found else line)
        numbers = [n for cell in cells if (n := number_of(cell)[0]) is not None]
        _require_numbers(cells, len(numbers), found is not None, f"{path}, line {at + 1}")
        if found is not None and len(numbers) == count:
            lines[found[1].lower()] = np.array(numbers) * _length(found[2] or found[3] or unit, request, path)
        elif found is not None and len(numbers) == len(cells) > 1:
            raise ValueError(
                f"{path}: its heading has {len(numbers)} values of {found[1]}, but there are {count} columns; "
                "mend it, or state points=..."
            )
        elif len(numbers) == 3 * count > 3:
            return np.reshape(numbers, (count, 3)) * _length(unit, request, path)
        elif len(numbers) in (3, 4) and UNIT.match(line) is None:
            words = [re.sub(r"\d+", "", c) for c in cells if number_of(c)[0] is None]
            single.append((at, [*words, str(len(numbers))], numbers[-3:]))
    if lines:
        absent = [axis for axis in AXES if axis not in lines]
        if len(absent) > 1:
            raise ValueError(f"{path}: its heading states {', '.join(lines)} of the points, not {', '.join(absent)}")
        # The coordinate along the normal may be left out.
        return np.stack([lines.get(axis, np.zeros(count)) for axis in AXES], 1)
    # A list has lines of one kind, one below the other; a remark may hold three numbers too.
    alike = groupby(enumerate(single), lambda each: (each[1][0] - each[0], each[1][1]))
    runs = [[numbers for _, (*_, numbers) in group] for _, group in alike]
    fitting = [run for run in runs if len(run) == count]
    if fitting and all(run == fitting[0] for run in fitting):
        return np.array(fitting[0]) * _length(unit, request, path)
    if len(single) > 1:
        raise ValueError(
            f"{path}: {len(single)} lines of its heading may be points, but there are {count} columns of values; state "
            "points=..., or mend the heading"
        )
    if single:
        tell(f"{path}, line {single[0][0] + 1} is a remark: one point does not place {count} columns of values")
    return None


def _require_numbers(cells: Sequence[str], numbers: int, named: bool, label: str) -> None:
    """Refuse a line that looks like coordinates, by its name and most of its cells or as a point, and has a bad one."""
    own = list(cells)
    while own and (not NUMERIC.match(own[0].encode()) or own[0].endswith(":")):
        own.pop(0)  # words before a point
    bad = [cell for cell in own if number_of(cell)[0] is None]
    point = len(own) in (3, 4) and all(NUMERIC.match(cell.encode()) for cell in own)
    if bad and (point or (named and numbers > len(cells) / 2)):
        raise ValueError(f"{label} looks like coordinates, but {bad[0]!r} is no number; mend it, or the line")


def _length(unit: str | None, request: PlaneRequest, path: Path) -> float:
    """Factor to m of what a file states, or else the user."""
    label = f"{path}: points"
    return si_factor("length", unit, label) if unit else stated_factor(request, "length", label)


def read_points(path: Path, request: PlaneRequest) -> np.ndarray:
    """Points of a list, m, (N, 3).

    Args:
        path: text, or an array (N, 3) of .npy, .mat, .h5.
        request: ``length_units`` where the list states none; ``axes``, the order of its columns
            where it names none.
    Raises:
        ValueError: no unit; columns that are not x, y, z.
    """
    axes = request.axis_names or list(AXES)
    unit, own = None, {}
    if path.suffix.lower() in ARRAY_ENDINGS:
        values = read_array(path).astype(float)
    else:
        text = open_text(path)
        for line in (each.strip("# \t\r") for each in text.heading):
            named = {word.lower(): a or b for word, a, b in LABEL.findall(line)}
            if (found := UNIT.match(line)) is not None:
                unit = found[2]
            elif named.keys() >= set("xz"):
                axes, own = list(named), {word: each for word, each in named.items() if each}
        values = text.rows(0, range(text.width), np.float64, whole=True).values
    if values.ndim != 2 or values.shape[1] != len(axes) or sorted(axes) != list(AXES):
        raise ValueError(
            f"{path} has shape {values.shape} and columns {', '.join(axes)}; one row a point of x, y, z is needed, "
            "another order is named above them or by axes=('x', 'z', 'y') (--axes x,z,y)"
        )
    # A unit above one column alone is that of all, as where it stands in a line of its own.
    units = {axis: own.get(axis) or unit or next(iter(own.values()), None) for axis in AXES}
    factors = [_length(units[axis], request, path) for axis in AXES]
    return values[:, [axes.index(axis) for axis in AXES]] * factors


FORMAT = PlaneFormat(
    "time histories",
    recognises,
    named(open_histories),
    ("variable", "axes", "velocity_units", "length_units", "sampling_rate", "normal", "points"),
)
