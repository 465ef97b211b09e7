"""Text of numbers in rows, read once: time histories, rows `time p1 p2 ...` of one variable, and where the points are.

Points stand in lines of the heading, one for each coordinate, or in a list of their own, which may begin with a line
`length_unit = m` and one with the names of its columns. Cells are parted by blanks, tabs, commas or semicolons; then
the decimal mark may be a comma.
"""

import io
import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import Unwritten, require_memory, require_regular
from torchliner.io.clocks import clock_of
from torchliner.io.foreign import read_array
from torchliner.io.plane_format import Imported, PlaneFormat, PlaneRequest, room
from torchliner.io.points import AXES, component_of, place, require_velocity, stated_factor
from torchliner.names import ARRAY_ENDINGS
from torchliner.records import VelocityPlane
from torchliner.text_columns import number_of
from torchliner.units import si_factor

BLOCK = 1 << 24  # bytes parsed at a time
SPACES = bytes.maketrans(b"(){}\t\r,;", b" " * 8)
COMMAS = bytes.maketrans(b"(){}\t\r,;", b" " * 6 + b". ")  # decimal commas
SAMPLE = 1 << 16  # bytes of rows that the decimal mark is looked for in
BOM = b"\xef\xbb\xbf"
NUMERIC = re.compile(rb"[+-]?(\.?\d|(nan|inf)\b)", re.IGNORECASE)  # how a number begins
COMMA_CELL = re.compile(rb"[+-]?(\d+(,\d+)?([eE][+-]?\d+)?|nan|inf)", re.IGNORECASE)
Rows = tuple[np.ndarray, float, np.ndarray]
UNIT = re.compile(r"(length|velocity)_unit\w*\s*[=:]?\s*(\S+)", re.IGNORECASE)
COORDINATE = re.compile(r"([xyz])\s*(?:\[(.*?)\]|\((.*?)\))?\s*[,;:=\s]\s*(.*)", re.IGNORECASE)  # `x [mm], 0.1, 0.2`
LABEL = re.compile(r"([A-Za-z]\w*)\s*(?:\[([^\]]*)\]|\(([^)]*)\))?")
NO_PROBE = re.compile(r"(iter(ation)?s?|(time ?)?steps?|cycles?|frames?)\b.*|.*:(\d|magnitude)", re.IGNORECASE)
INDEX = re.compile(r"(index|unnamed.*)?", re.IGNORECASE)  # of a table of pandas
NUMBER = r"[-+]?(\d+(\.\d*)?|\.\d+)(e[-+]?\d+)?"  # of digits that can be read in one way alone
TRIPLE = re.compile(rf"\(({NUMBER}[\s,;]+){{2}}{NUMBER}\)", re.IGNORECASE)
Labels = list[tuple[str, str]]  # names and units


@dataclass(frozen=True)
class TextFile:
    """What stands before the rows of a file: its lines, the byte of the first row, what becomes a blank or a point
    before numbers are read, and how many numbers the first row has."""

    path: Path
    heading: tuple[str, ...]
    begin: int
    marks: bytes
    width: int

    def rows(self, time: int, columns: Sequence[int], kind: Any = np.float32, whole: bool = False) -> Rows:
        """Columns of all rows: times, float64, (T,); one in their last digit, at worst; values of a ``kind``, (T, C).

        Lines behind '#' are passed over. A last line without an end, as where a run was broken off, is left out with a
        DataWarning, unless the file is ``whole``. An OSError where another file has taken its place meanwhile, a
        ValueError where a row has another width, or a cell is no number.
        """
        times, digits, line, rest, count = [np.empty(0)], 0, len(self.heading) + 1, b"", 0
        before = self.path.stat()
        size = before.st_size
        values = room((size // (2 * self.width) + 1, len(columns)), kind)  # a number takes two bytes at least
        with self.path.open("rb") as file:
            file.seek(self.begin)
            while block := file.read(min(BLOCK, size - file.tell())):  # what a run adds meanwhile is not of it
                block = rest + block
                end = len(block) if whole and file.tell() == size else block.rfind(b"\n") + 1
                text, rest = block[:end].translate(self.marks), block[end:]
                found = parse_rows(text, self.width, f"{self.path}, from line {line}")
                words = (row.split(None, time + 1) for row in text.split(b"\n"))
                digits = max([digits, *(digits_of(row[time]) for row in words if row and row[0][:1] != b"#")])
                times.append(found[:, time].copy())
                values[count : count + len(found)] = found[:, list(columns)]
                count += len(found)
                line += block.count(b"\n")
        now = self.path.stat()  # a run may add rows, no more
        if now.st_ino != before.st_ino or now.st_size < size:
            raise OSError(f"{self.path} was replaced while it was read; read it when it is complete")
        if rest.strip():
            tell(
                f"{self.path}: the last line, {line}, has no end, as where a run was broken off or goes on; it is left "
                f"out, {count} rows remain",
                depth=2,
            )
        if not count:
            raise Unwritten(f"{self.path} holds no row of numbers that is whole")
        stamps = np.concatenate(times)
        return stamps, last_digit(stamps, digits), values[:count]


def open_text(path: Path) -> TextFile:
    """A file of rows, which begin with the first line that begins like a number; a ValueError if there are none."""
    require_regular(path)
    heading: list[str] = []
    begin = 0
    with path.open("rb") as file:
        for line in file:
            require_memory(16 * len(line), f"{path}, line {len(heading) + 1},")
            mark = len(BOM) if not begin and line.startswith(BOM) else 0
            words = line[mark:].translate(SPACES).split(None, 1)
            if words and NUMERIC.match(words[0]):
                sample = line[mark:] + file.read(SAMPLE)
                marks = COMMAS if _has_decimal_commas(sample[: sample.rfind(b"\n") + 1]) else SPACES
                return TextFile(path, tuple(heading), begin + mark, marks, len(line[mark:].translate(marks).split()))
            begin += len(line)
            try:
                heading.append(line.decode("utf-8-sig").rstrip())
            except UnicodeDecodeError:
                heading.append(line.decode("latin-1").rstrip())
    bare = [line for line in heading if line and not line.startswith("#")]
    raise (Unwritten if len(bare) < 2 else ValueError)(f"{path} holds no row of numbers that is whole")


def parse_rows(text: bytes, width: int, label: str) -> np.ndarray:
    """Rows of ``width`` numbers parted by blanks, (T, width); a ValueError where a row has others, or a cell is no
    number."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of no rows, which may be remarks
            found = np.loadtxt(io.BytesIO(text), ndmin=2, comments="#", encoding="latin-1")
    except ValueError as error:
        said = str(error).partition("; use")[0].rstrip(".")
        raise ValueError(f"{label}: {said}; {width} numbers a row are needed, and '#' before a remark") from error
    if len(found) and found.shape[1] != width:
        raise ValueError(f"{label}: rows have {found.shape[1]} numbers; {width} are needed")
    return found.reshape(-1, width)


def _has_decimal_commas(text: bytes) -> bool:
    """Whether commas are decimal marks: beside semicolons, or where blanks or tabs part cells of which none has a
    point or more than one comma."""
    if b"," not in text or b";" in text:
        return b"," in text
    cells = text.split()
    return len(cells) > len(text.splitlines()) and all(map(COMMA_CELL.fullmatch, cells))


def digits_of(word: bytes) -> int:
    """Significant digits of a printed number."""
    return len(word.lower().partition(b"e")[0].replace(b".", b"").strip(b"+-").lstrip(b"0"))


def last_digit(values: np.ndarray, digits: int) -> float:
    """One in the last digit of the largest of numbers that are printed with so many digits; solvers print six at
    least, and leave zeros at the end away."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    power = math.floor(math.log10(largest)) if 0 < largest < math.inf else 0
    return 10.0 ** (power + 1 - max(6, digits))


# Histories


def recognises(path: Path, head: bytes) -> bool:
    """Text with a row of two numbers or more, or that begins with a remark or `time`."""
    if not head or b"\0" in head:
        return False
    lines = [line.strip("\ufeff\r ") for line in head.decode("utf-8", "replace").split("\n")]
    if lines[0].startswith("#") or lines[0].lower().startswith("time"):
        return True
    return any(len(row := _cells(line)) > 1 and not np.isnan(row).any() for line in lines)


def _cells(line: str) -> list[float]:
    """Cells of a line as numbers, nan where there is none."""
    return [number_of(cell) for cell in re.split(r"[\s,;()]+", line.strip(" \t\r,;()"))]


def open_histories(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a file of histories; ``points`` is a list of them, text or array. A ValueError as of
    ``TextFile.rows``, ``clock_of`` and ``place``; where a unit is missing, or there are more points than columns."""
    text, label = open_text(path), str(path)
    heading = [line.strip("# \t\r") for line in text.heading]
    units = {found[1].lower(): found[2] for line in heading if (found := UNIT.match(line))}
    at, labels = _columns(heading, text.width, path, request)
    stated = {unit for _, unit in labels[1:]} - {""} or {units.get("velocity", "")} - {""}
    if len(stated) > 1:
        raise ValueError(f"{path}: columns are in {', '.join(sorted(stated))}; one unit is needed")
    factor = stated_factor(request, "velocity", label) if not stated else si_factor("velocity", stated.pop(), label)
    unit, rate = labels[0][1] if labels else "", request.sampling_rate
    if not unit and rate is None:
        raise ValueError(
            f"{path}: its times have no unit; write 'time [s]' above them, or state sampling_rate=... "
            "(--sampling-rate HZ)"
        )
    count, name = text.width - at - 1, request.variable or path.stem
    points = _points_of(heading, count, units.get("length"), request, path)
    if request.points is not None:
        points = read_points(Path(request.points), request)
    order, sign, placed = np.arange(count), -1.0 if (request.normal or "").startswith("-") else 1.0, None
    if points is not None:
        if len(points) != count:
            raise ValueError(f"{path} has {count} columns of values, its points are {len(points)} ({request.points})")
        placed = place(points, request, f"{path}:/{name}", component_of(name))
        order, sign = placed.order, placed.sign
    time, rounding, values = text.rows(at, (at + 1 + order).tolist())
    second = si_factor("time", unit, f"{path}: time") if unit else 1.0
    own, start = clock_of(time * second, f"{path}, time", rate, rounding * second, unit)
    values *= factor * sign
    if placed is not None:
        return placed.plane(values, rate or own, start, path, format="time histories")
    velocity = Imported(values, (count, len(values)), label)
    return VelocityPlane(velocity, sampling_rate=rate or own, start=start, name=label, title=path.stem)


def _columns(heading: Sequence[str], width: int, path: Path, request: PlaneRequest) -> tuple[int, Labels]:
    """Which column is time, and name and unit of it and those after it, where a line of the heading names them."""
    line, labels = "", Labels()
    for each in heading:
        found = [(name, a or b) for name, a, b in LABEL.findall(each.lstrip('",; \t'))]
        if found and found[0][0].lower() in ("time", "t", "index"):
            line, labels = each, found[found[0][0].lower() == "index" :]
    mark = next((each for each in "\t;," if each in line), None)
    names = [each.strip('" ') for each in line.split(mark)] if mark else [name for name, _ in labels]
    names = names if not mark or names[-1] else names[:-1]
    at = 1 if mark and INDEX.fullmatch(names[0]) else 0
    if len(names) != width and (mark or len(names) > 2):
        raise ValueError(
            f"{path}: its heading names {len(names)} columns, {', '.join(names[:4])} ..., and its first row holds "
            f"{width} numbers; leave empty columns and an index out, and put decimal commas between semicolons or tabs"
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
    """Points in lines of a heading, one for each coordinate, m; None without. A ValueError where one cannot be read or
    is missing, or another line has as many numbers in a row as there are columns, or a triple of them in brackets."""
    lines: dict[str, np.ndarray] = {}
    for at, line in enumerate(heading, 1):
        found = COORDINATE.match(line)
        cells = np.array(_cells(found[4]) if found else [])
        numbers = int(np.isfinite(cells).sum())
        if found is None or not numbers:
            if _lists_points(line, count):
                raise ValueError(
                    f"{path}, line {at} looks like coordinates: {line[:60]!r}; write a line for each of x, y, z, as "
                    "'# x, 0.1, 0.2, ...', or state the points (--points FILE)"
                )
            continue
        if not numbers == len(cells) == count:
            raise ValueError(
                f"{path}, line {at} looks like coordinates, but {numbers} of its {len(cells)} cells are numbers, and "
                f"there are {count} columns of values; mend it, or begin a remark with another word"
            )
        lines[found[1].lower()] = cells * _length(found[2] or found[3] or unit, request, path)
    absent = [axis for axis in AXES if axis not in lines]
    normal = (request.normal or "").lstrip("+-")
    if lines and absent and absent != [normal or absent[0]]:
        raise ValueError(f"{path}: its heading states {', '.join(lines)} of the points, not {', '.join(absent)}")
    # The coordinate along the normal may be left out.
    return np.stack([lines.get(axis, np.zeros(count)) for axis in AXES], 1) if lines else None


def _lists_points(line: str, count: int) -> bool:
    """Whether as many numbers stand in a row as there are columns, or three in brackets; but 0, 1, 2, ... and 1, 2, 3,
    ... are names of columns."""
    cells = _cells(line)
    longest = max((len([*run]) for known, run in groupby(cells, lambda cell: cell == cell) if known), default=0)
    if longest < max(count, 2) and TRIPLE.search(line) is None:
        return False
    values = [value for value in cells if value == value]
    return values[0] not in (0, 1) or values != [values[0] + i for i in range(len(values))]


def _length(unit: str | None, request: PlaneRequest, path: Path) -> float:
    """Factor to m of what a file states, or else the user."""
    label = f"{path}: points"
    return si_factor("length", unit, label) if unit else stated_factor(request, "length", label)


def read_points(path: Path, request: PlaneRequest) -> np.ndarray:
    """Points of a list, text or an array of .npy, .mat, .h5, m, (N, 3); ``length_units`` and ``axes``, the order of its
    columns, count where it says none."""
    axes, units = request.axis_names or list(AXES), set[str]()
    if path.suffix.lower() in ARRAY_ENDINGS:
        values = read_array(path).astype(float)
    else:
        text = open_text(path)
        for line in (each.strip("# \t\r") for each in text.heading):
            named = {word.lower(): a or b for word, a, b in LABEL.findall(line)}
            if (found := UNIT.match(line)) is not None:
                units.add(found[2])
            elif named.keys() >= set("xz"):
                axes, units = list(named), units | {*named.values()} - {""}
        _, _, values = text.rows(0, range(text.width), np.float64, whole=True)
    if values.ndim != 2 or values.shape[1] != len(axes) or sorted(axes) != list(AXES) or len(units) > 1:
        raise ValueError(
            f"{path} has shape {values.shape} and columns {', '.join(axes)} in {', '.join(units)}; one row a point of "
            "x, y, z in one unit is needed, another order is named above them or by axes=('x', 'z', 'y') (--axes x,z,y)"
        )
    return values[:, [axes.index(axis) for axis in AXES]] * _length(next(iter(units), None), request, path)


FORMAT = PlaneFormat(
    "time histories",
    recognises,
    open_histories,
    ("variable", "axes", "velocity_units", "length_units", "sampling_rate", "normal", "points"),
)
