"""Text of numbers in rows, read once: time histories, rows `time p1 p2 ...` of one variable, and where the points are.

Points stand in lines of the heading, one for each coordinate, `# x, 0.1, 0.2, ...`, or in a list of their own, which
may begin with a line `length_unit = m` and one with the names of its columns.
"""

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import Unwritten, require_memory, require_regular
from torchliner.io.plane_format import PlaneFormat, PlaneRequest, clock_of
from torchliner.io.points import AXES, place, require_direction, require_velocity, stated_factor
from torchliner.records import VelocityPlane
from torchliner.text_columns import number_of
from torchliner.units import si_factor

TEXT: Any = {"encoding": "utf-8-sig", "errors": "replace"}
BLANK = str.maketrans("(){}", "    ")
NUMERIC = re.compile(r"\s*[+-]?(\.?\d|(nan|inf)\b)", re.IGNORECASE)  # how a row begins
UNIT = re.compile(r"(length|velocity)_unit\w*\s*[=:]?\s*(\S+)", re.IGNORECASE)
COORDINATE = re.compile(r"([xyz])\s*(?:\[(.*?)\]|\((.*?)\))?\s*[,;:=\s]\s*(.*)", re.IGNORECASE)  # `x [mm], 0.1, 0.2`
LABEL = re.compile(r"(\w[^\s,;\[(]*)\s*(?:\[([^\]]*)\]|\(([^)]*)\))?")  # `p1 [m/s]`
TAKES = ("variable", "velocity_units", "length_units", "sampling_rate", "normal", "points")


@dataclass(frozen=True)
class TextFile:
    """What stands before the rows of a file, what parts their cells, None for blanks, and how many a row has."""

    path: Path
    heading: tuple[str, ...]
    separator: str | None
    width: int

    def rows(self, whole: bool = False) -> np.ndarray:
        """All rows, (T, width); remarks behind '#' are passed over.

        A last line without an end, as where a run was broken off, is left out with a DataWarning, unless the file is
        ``whole``. A ValueError where a row has another width, or a cell is no number.
        """
        require_memory(4 * self.path.stat().st_size, f"{self.path}")  # a number takes two bytes at least
        cut = ""

        def lines() -> Iterator[str]:
            nonlocal cut
            for line in file:
                if not (whole or line.endswith("\n")):
                    cut = line.strip()
                    return
                yield line.translate(BLANK)

        try:
            with self.path.open(**TEXT) as file, warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of no rows
                found = np.loadtxt(lines(), delimiter=self.separator, skiprows=len(self.heading), ndmin=2)
        except ValueError as error:
            said = f"{self.path}, behind {len(self.heading)} lines: {str(error).partition('; use')[0].rstrip('.')}"
            raise ValueError(f"{said}; {self.width} numbers a row are needed, and '#' before a remark") from error
        if cut:
            tell(f"{self.path}: the last line has no end, as of a run that goes on; it is left out")
        if not found.size:
            raise Unwritten(f"{self.path} holds no row of numbers that is whole")
        return found

    def stated(self) -> tuple[dict[str, set[str]], dict[str, np.ndarray], list[tuple[str, str]]]:
        """What the heading states: units of lengths and velocities, coordinates by axis, and names and units of the
        columns; a ValueError where a line may be coordinates or data that cannot be read."""
        units: dict[str, set[str]] = {"length": set(), "velocity": set()}
        listed: dict[str, np.ndarray] = {}
        labels: list[tuple[str, str]] = []
        for number, raw in enumerate(self.heading, 1):
            line = raw.strip("# \t\r")
            coordinate, names = COORDINATE.match(line), labels_of(line)
            values = _numbers(coordinate[4] if coordinate else line)
            if unit := UNIT.match(line):
                units[unit[1].lower()].add(unit[2])
            elif coordinate and np.isfinite(values).any():
                listed[coordinate[1].lower()] = values
                units["length"] |= {coordinate[2] or coordinate[3]} - {None}
            elif any(each.lower() in ("time", "t") for each, _ in names[:2]) or {each for each, _ in names} == {*AXES}:
                labels = names
            elif line and (not raw.startswith("#") or np.isfinite(values).sum() >= max(2, self.width - 1)):
                raise ValueError(
                    f"{self.path}, line {number} looks like coordinates or data: {line[:60]!r}; write '# x, 0.1, 0.2, "
                    "...' for each of x, y, z, and begin a remark with '#'"
                )
        return units, listed, labels


def _separator(line: str) -> str | None:
    return next((mark for mark in ";\t," if mark in line), None)


def open_text(path: Path) -> TextFile:
    """A file of rows, which begin with the first line that begins like a number; a ValueError if there are none."""
    require_regular(path)
    heading: list[str] = []
    with path.open(**TEXT) as file:
        for line in file:
            if NUMERIC.match(row := line.translate(BLANK)):
                return TextFile(path, tuple(heading), _separator(row), len(row.split(_separator(row))))
            heading.append(line.rstrip())
    bare = [line for line in heading if line and not line.startswith("#")]
    raise (Unwritten if len(bare) < 2 else ValueError)(f"{path} holds no row of numbers that is whole")


def recognises(path: Path, head: bytes) -> bool:
    """Text with a row of two numbers or more, or that begins with a remark or `time`."""
    lines = [] if b"\0" in head else head.decode("utf-8-sig", "replace").lower().split("\n")
    rows = (len(cells := _numbers(line)) > 1 and np.isfinite(cells).all() for line in lines)
    return bool(head) and (any(each.startswith(("#", "time")) for each in lines[:1]) or any(rows))


def open_histories(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a file of histories; ``points`` is a list of them. A ValueError as of ``rows``, ``clock_of`` and
    ``place``; where a unit is missing, or a line of the heading cannot be read."""
    text, rate = open_text(path), request.sampling_rate
    units, listed, labels = text.stated()
    at = next((i for i, (name, _) in enumerate(labels) if name.lower() in ("time", "t")), 0)
    count, unit = text.width - at - 1, labels[at][1] if labels else ""
    if labels:
        _require_one_velocity([name for name, _ in labels[at + 1 :]], count, request, path)
    if not unit and rate is None:
        raise ValueError(f"{path}: its times have no unit; write 'time [s]' above them, or state sampling_rate=...")
    points, order, placed, name = None, np.arange(count), None, request.variable or path.stem
    require_direction(f"{path}", name, request.normal)
    if request.points is not None:
        points = read_points(Path(request.points), request)
    elif listed:  # of which the coordinate along the normal may be left out
        found = {(request.normal or "")[-1:]: np.zeros(count)} | listed
        for axis in AXES:
            cells = np.isfinite(found.get(axis, ()))
            if len(cells) != count or not cells.all():
                said = f"{cells.sum()} numbers in {len(cells)} cells as {axis} of the points"
                raise ValueError(f"{path}: its heading has {said}, for {count} columns of values")
        points = np.stack([found[axis] for axis in AXES], 1) * _factor("length", units, request, f"{path}: points")
    if points is not None:
        if len(points) != count:
            raise ValueError(f"{path} has {count} columns of values, its points are {len(points)} ({request.points})")
        placed = place(points, request, f"{path}:/{name}")
        order = placed.order
    units["velocity"] |= {unit for _, unit in labels[at + 1 :]} - {""}
    factor = _factor("velocity", units, request, f"{path}")
    rows = text.rows()
    second = si_factor("time", unit, f"{path}: time") if unit else 1.0
    rate, start = clock_of(rows[:, at] * second, f"{path}, time", rate, unit)
    values = rows[:, at + 1 + order].astype(np.float32)
    values *= -factor if (request.normal or "").startswith("-") else factor
    if placed is not None:
        return placed.plane(values, rate, start, path, format="time histories")
    return VelocityPlane(values.T, sampling_rate=rate, start=start, name=f"{path}", title=path.stem)


def _numbers(line: str) -> np.ndarray:
    """Cells of a line as numbers, nan where there is none."""
    return np.array([number_of(cell) for cell in re.split(r"[\s,;()]+", line.strip(" \t\r,;()"))])


def labels_of(line: str) -> list[tuple[str, str]]:
    """Name and unit of each column of a line that names them."""
    mark = _separator(line)
    cells = [each.strip(' "') for each in line.split(mark)] if mark else [each[0] for each in LABEL.finditer(line)]
    return [(found[1], found[2] or found[3] or "") if (found := LABEL.match(cell)) else ("", "") for cell in cells]


def _require_one_velocity(names: list[str], count: int, request: PlaneRequest, path: Path) -> None:
    """Refuse columns of values, by their names, that are not probes of one velocity."""
    stems = {re.sub(r"[\W\d_]+$", "", name): None for name in names}
    if len(names) != count or len(stems) > 1:
        raise ValueError(
            f"{path}: its heading names {len(names)} columns behind the time, of {', '.join(stems)}, and its first row "
            f"has {count}; leave those of the velocity along the wall normal, one a probe"
        )
    if len(stem := "".join(stems)) > 1:  # p1 and p2 may be probes
        require_velocity(f"{path}:/{stem}", request)


def _factor(quantity: str, units: dict[str, set[str]], request: PlaneRequest, label: str) -> float:
    """To SI, from what a file states, or else the user."""
    if len(found := sorted(units[quantity])) > 1:
        raise ValueError(f"{label} are in {', '.join(found)}; one unit is needed")
    return si_factor(quantity, found[0], label) if found else stated_factor(request, quantity, label)


def read_points(path: Path, request: PlaneRequest) -> np.ndarray:
    """Points of a list, m, (N, 3); ``length_units`` counts where it says none."""
    text = open_text(path)
    units, _, labels = text.stated()
    units["length"] |= {unit for _, unit in labels} - {""}
    axes, values = [name.lower() for name, _ in labels] or list(AXES), text.rows(whole=True)
    if values.shape[1] != 3 or sorted(axes) != list(AXES):
        raise ValueError(f"{path} has {values.shape[1]} columns, {', '.join(axes)}; rows of x, y, z are needed")
    return values[:, [axes.index(axis) for axis in AXES]] * _factor("length", units, request, f"{path}: points")


FORMAT = PlaneFormat("time histories", recognises, open_histories, TAKES)
