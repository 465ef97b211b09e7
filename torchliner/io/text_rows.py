"""Long files of numbers as text: an index of their rows, and blocks of rows read by it."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import Unwritten, require_memory, require_regular

BLOCK = 1 << 24  # bytes looked through at a time
TOKEN = 64  # bytes of the longest first number
SPACES = bytes.maketrans(b"(){}\t\r,;", b" " * 8)
COMMAS = bytes.maketrans(b"(){}\t\r,;", b" " * 6 + b". ")  # decimal commas
SAMPLE = 1 << 16  # bytes of rows that the decimal mark is looked for in
EXPONENT = rb"([eE][+-]?\d+)?"
COMMA_CELL = re.compile(rb"[+-]?(\d+(,\d+)?%b|nan|inf)" % EXPONENT, re.IGNORECASE)


@dataclass(frozen=True)
class TextRows:
    """Where rows of numbers stand in one or several files.

    Args:
        paths: files.
        file, begin, end, line: of each row: which file, its bytes, its number there; (T,).
        first: its first number, float64, (T,).
        rounding: one in the last digit of the first numbers, at worst.
        heading: lines before the rows.
        marks: what becomes a blank, or a point, before numbers are read.
    """

    paths: tuple[Path, ...]
    file: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    line: np.ndarray
    first: np.ndarray
    rounding: float
    heading: tuple[str, ...] = field(repr=False)
    marks: bytes = field(default=SPACES, repr=False)

    def __len__(self) -> int:
        return len(self.first)

    @property
    def width(self) -> int:
        """Numbers in the first row."""
        size = int(self.end[0] - self.begin[0])
        return len(bytes_at(self.paths[self.file[0]], int(self.begin[0]), size).translate(self.marks).split())

    def part(self, rows: Any) -> TextRows:
        """Some of the rows, by a slice or an array."""
        names = ("file", "begin", "end", "line", "first")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def numbers(self, begin: int, end: int, width: int, columns: Sequence[int], kind: Any = np.float32) -> np.ndarray:
        """Some columns of rows begin .. end - 1, and all rows tested for their length.

        Raises:
            ValueError: a row has not ``width`` numbers, or what is needed of it is none.
            OSError: a file is shorter than it was.
        """
        parts = []
        apart = self.begin[begin + 1 : end] != self.end[begin : end - 1]
        # Text is many times larger than its numbers: little of it at a time.
        block = np.cumsum(self.end[begin:end] - self.begin[begin:end]) // BLOCK
        cuts = np.flatnonzero(apart | (np.diff(self.file[begin:end]) != 0) | (np.diff(block) != 0))
        edges = [begin, *(cuts + begin + 1), end]
        for low, high in pairwise(edges):
            path, place = self.paths[self.file[low]], int(self.begin[low])
            with path.open("rb", buffering=0) as file:
                file.seek(place)
                size = int(self.end[high - 1]) - place
                text = file.read(size)
            if len(text) < size:
                raise OSError(f"{path} has become shorter: line {self.line[low]} is not there")
            label = f"{path}, from line {self.line[low]}"
            parts.append(parse_rows(text.translate(self.marks), high - low, width, columns, label, kind))
        return parts[0] if len(parts) == 1 else np.concatenate(parts)


def parse_rows(
    text: bytes, rows: int, width: int, columns: Sequence[int], label: str, kind: Any = np.float32
) -> np.ndarray:
    """Columns of blank-separated numbers, (rows, columns).

    Raises:
        ValueError: rows have not ``width`` numbers each, or what is needed of them is none.
    """
    solid = np.frombuffer(text, np.uint8) > 32
    count = int(np.count_nonzero(solid[1:] > solid[:-1])) + int(solid[:1].sum())
    if count != rows * width:
        raise ValueError(f"{label}: {count} numbers in {rows} rows; {width} in each are needed")
    wanted = list(columns)
    last = [] if width - 1 in wanted else [width - 1]  # so that no row is shorter
    try:
        found = np.loadtxt(
            io.BytesIO(text), kind, usecols=wanted + last, ndmin=2,
            comments=None, encoding="latin-1",
        )  # fmt: skip
    except ValueError as error:
        raise ValueError(f"{label}: {error}; {width} numbers in each row are needed") from error
    if len(found) != rows:
        raise ValueError(f"{label}: {len(found)} rows; {rows} are needed")
    return found[:, : len(wanted)]


def parse_vectors(text: bytes, count: int, width: int, axis: int | None, label: str) -> np.ndarray:
    """Component ``axis`` of ``count`` vectors, float32, (N,), or all of them, float64, (N, width),
    however their numbers stand in lines."""
    flat = text.translate(SPACES).replace(b"\n", b" ")
    columns = range(count * width) if axis is None else range(axis, count * width, width)
    kind = np.float64 if axis is None else np.float32
    found = parse_rows(flat, 1, count * width, columns, label, kind)[0]
    return found.reshape(count, width) if axis is None else found


def index_rows(path: Path, whole: bool = False) -> TextRows:
    """Rows that begin with a number; remarks behind '#' are passed over.

    Args:
        path: text.
        whole: nobody writes to it any more: its last line needs no end.
    Raises:
        FileNotFoundError, OSError: no such file, a folder.
        ValueError: no rows; a line below the first row that begins with something else.
    Warns:
        DataWarning: the last line has no end, as where a run was broken off: it is left out.
    """
    require_regular(path)
    rows: list[tuple[int, int, int]] = []
    heading: list[str] = []
    first: list[float] = []
    digits, number, start = 0, 0, 0
    with path.open("rb", buffering=0) as file:
        size = path.stat().st_size
        for offset in range(0, size, BLOCK):
            file.seek(offset)
            block = file.read(BLOCK + TOKEN)
            ends = np.flatnonzero(np.frombuffer(block[:BLOCK], np.uint8) == 10) + 1
            if whole and offset + BLOCK >= size and not block.endswith(b"\n"):
                ends = np.append(ends, len(block))
            for end in ends.tolist():
                number += 1
                line, begin, start = start, start, offset + end
                head = block[line - offset : end][:TOKEN] if line >= offset else bytes_at(path, line)
                word = head.translate(SPACES).split(None, 1)[:1]
                value, exact = number_of(word[0]) if word else (None, 0)
                if value is not None:
                    rows.append((begin, start, number))
                    first.append(value)
                    digits = max(digits, exact)
                elif not rows:
                    require_memory(start - begin, f"{path}, line {number},")
                    heading.append(_decoded(bytes_at(path, begin, start - begin)))
                elif word and not word[0].startswith(b"#"):
                    raise ValueError(
                        f"{path}, line {number} begins with {word[0][:20].decode('latin-1')!r}; a "
                        "row begins with a number"
                    )
    if not rows:
        bare = [line for line in heading if line and not line.startswith("#")]
        raise (Unwritten if len(bare) < 2 else ValueError)(f"{path} holds no row of numbers that is whole")
    if start < size and bytes_at(path, start, size - start).strip():
        tell(
            f"{path}: the last line, {number + 1}, has no end, as where a run was broken off or "
            f"goes on; it is left out, {len(rows)} rows remain",
            depth=2,
        )
    end = next((e for _, e, _ in reversed(rows) if e - rows[0][0] <= SAMPLE), rows[0][1])
    marks = COMMAS if _has_decimal_commas(bytes_at(path, rows[0][0], end - rows[0][0])) else SPACES
    time = np.array(first)
    if marks == COMMAS:
        time = np.array([number_of(bytes_at(path, b, TOKEN).translate(COMMAS).split(None, 1)[0])[0]
                         for b, *_ in rows], float)  # fmt: skip
    begins, ends, lines = np.array(rows, np.int64).T
    return TextRows(
        (path,), np.zeros(len(rows), np.int64), begins, ends, lines, time,
        last_digit(time, digits), tuple(heading), marks,
    )  # fmt: skip


def _has_decimal_commas(text: bytes) -> bool:
    """Whether commas of some rows are decimal marks: there are semicolons beside them, or blanks or
    tabs part cells of which none has a point or more than one comma."""
    if b"," not in text or b";" in text:
        return b"," in text
    cells = text.split()
    return len(cells) > len(text.splitlines()) and all(map(COMMA_CELL.fullmatch, cells))


def last_digit(values: np.ndarray, digits: int) -> float:
    """One in the last digit of the largest of numbers that are printed with so many digits; solvers
    print six at least, and leave zeros at the end away."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    power = math.floor(math.log10(largest)) if 0 < largest < math.inf else 0
    return 10.0 ** (power + 1 - max(6, digits))


def bytes_at(path: Path, offset: int, size: int = TOKEN) -> bytes:
    """Some bytes of a file."""
    with path.open("rb") as file:
        file.seek(offset)
        return file.read(size)


def _decoded(line: bytes) -> str:
    """A line of a heading, UTF-8 or else latin-1."""
    try:
        return line.decode("utf-8-sig").rstrip()
    except UnicodeDecodeError:
        return line.decode("latin-1").rstrip()


def number_of(word: bytes | str) -> tuple[float | None, int]:
    """A number as text and its significant digits; None if it is none."""
    with suppress(ValueError, UnicodeDecodeError):
        text = word.decode("ascii") if isinstance(word, bytes) else word
        mantissa = text.lower().partition("e")[0].replace(".", "").strip("+-").lstrip("0")
        if "_" not in text and text.isascii():
            return float(text), len(mantissa)
    return None, 0
