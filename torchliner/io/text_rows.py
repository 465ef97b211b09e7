"""Rows of numbers in text, read once: into memory, or into a temporary file where they do not fit."""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import Unwritten, require_memory, require_regular
from torchliner.io.plane_format import room

BLOCK = 1 << 24  # bytes parsed at a time
SPACES = bytes.maketrans(b"(){}\t\r,;", b" " * 8)
COMMAS = bytes.maketrans(b"(){}\t\r,;", b" " * 6 + b". ")  # decimal commas
SAMPLE = 1 << 16  # bytes of rows that the decimal mark is looked for in
BOM = b"\xef\xbb\xbf"
NUMERIC = re.compile(rb"[+-]?(\.?\d|(nan|inf)\b)", re.IGNORECASE)  # how a number begins
COMMA_CELL = re.compile(rb"[+-]?(\d+(,\d+)?([eE][+-]?\d+)?|nan|inf)", re.IGNORECASE)
Rows = tuple[np.ndarray, float, np.ndarray]


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
