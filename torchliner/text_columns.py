"""Text files of numbers: a header of names with units, rows of cells, remarks behind '#'."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchliner.file_checks import read_bytes
from torchliner.names import did_you_mean
from torchliner.units import require_plausible, si_factor

Array = NDArray[np.float64]
# What spreadsheets write into a cell that they cannot compute; a remark looks otherwise.
NO_VALUE = re.compile(r"#[A-Z\u00c0-\u00de][/A-Z0-9\u00c0-\u00de]*[!?]?|#{2,}")
SEPARATORS = (";", "\t", ",")
LABEL = re.compile(r"(\w+)\s*(?:\[(.*)\]|\((.*)\))?")


def read_lines(path: str | Path, head: int | None = None) -> list[str]:
    """Lines of a text file in UTF-8, or else latin-1, without their ends.

    Args:
        path: file.
        head: bytes that are read from its beginning, the line cut there included; None for all.
    Raises:
        FileNotFoundError, OSError: as ``read_bytes``.
        ValueError: the file is empty, or is no text; as ``read_bytes``.
    """
    path = Path(path)
    raw = read_bytes(path, head)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    if not text.strip():
        raise ValueError(f"{path} is empty")
    return text.splitlines()


def header_line(lines: Sequence[str], path: str | Path) -> int:
    """Index of the first line that is neither blank nor a remark.

    Raises:
        ValueError: there is none.
    """
    start = next((i for i, line in enumerate(lines) if not is_remark(line)), None)
    if start is None:
        raise ValueError(f"{path} has no header line with the names of the columns")
    return start


def is_remark(line: str, separator: str | None = None) -> bool:
    """Whether a line is blank or begins with '#'.

    Args:
        line: of a file.
        separator: of cells, for a line below the header: ``#N/A`` in the first of several cells is
            a value that is missing, no remark.
    """
    if not line.strip():
        return True
    cells = cells_of(line, separator) if separator else []
    return line[0] == "#" and not (len(cells) > 1 and NO_VALUE.fullmatch(cells[0]))


def separator_of(header: str) -> str:
    """What the cells of a header line are parted by."""
    return next((mark for mark in SEPARATORS if mark in header), ",")


def cells_of(line: str, separator: str | None) -> list[str]:
    """Cells of a line without the blanks around them; separator None for blanks."""
    return [cell.strip() for cell in line.split(separator)]


@dataclass(frozen=True)
class Column:
    """Where the values of a name stand.

    Args:
        name: as the reader calls it.
        index: of the column, from 0.
        factor: to SI.
        quantity: a key of ``units.FACTORS``; None for values that stand as they are.
    """

    name: str
    index: int
    factor: float
    quantity: str | None = None


def find_columns(
    labels: Sequence[str],
    known: Mapping[str, str | None],
    path: str | Path,
    *,
    example: str,
    optional: Collection[str] = (),
    short: Mapping[str, str] | None = None,
    others: Collection[str] = (),
) -> list[Column]:
    """Columns by labels such as ``x [mm]``, in any order.

    Args:
        labels: of the columns.
        known: quantity of each by its name, in lower case; None takes values in any unit as they
            stand.
        path: for messages.
        example: a header that is right.
        optional: names that may be absent.
        short: other names, in their own case, for some of ``known``.
        others: names that are passed over.
    Raises:
        ValueError: a column unknown, missing, named twice, or without a unit.
    """
    found: dict[str, Column] = {}
    for index, label in enumerate(labels):
        match = LABEL.fullmatch(label)
        word, unit = (match[1], match[2] or match[3] or "") if match else (label, "")
        name = _name(word, unit, known, short or {})
        if name in others:
            continue
        where = f"{path}: column {name!r}"
        if name not in known:
            raise ValueError(f"{path}: unknown column {label!r}{did_you_mean(name, list(known))}; write {example}")
        if name in found:
            raise ValueError(f"{where} is named twice")
        quantity, factor = known[name], 1.0
        if quantity is not None and not unit and quantity != "number":
            raise ValueError(f"{where} has no unit in {label!r}; write it as in 'x [mm]'")
        if quantity is not None:
            factor = si_factor(quantity, unit, where)
        found[name] = Column(name, index, factor, quantity)
    for name in known:
        if name not in found and name not in optional:
            raise ValueError(f"{path}: column {name!r} is missing; there are: {', '.join(found)}; write {example}")
    return list(found.values())


def read_columns(
    rows: Sequence[Sequence[str]],
    numbers: Sequence[int],
    columns: Sequence[Column],
    path: str | Path,
    count: int,
    *,
    padded: bool = False,
    special: Collection[str] | None = None,
) -> dict[str, Array]:
    """Columns of numbers in SI units, by name.

    Args:
        rows: cells of each line.
        numbers: of the lines, for messages.
        columns: what to read.
        path: for messages.
        count: of the columns of the file.
        padded: columns may end early, filled up with blank cells, as those of two channels do.
        special: columns that may hold inf, though not nan; default: all, and nan as well.
    Raises:
        ValueError: a blank or unreadable cell, more cells than columns, mixed decimal marks, a
            value that no measurement has (``units.PLAUSIBLE``).
    """
    for number, row in zip(numbers, rows, strict=True):
        if len(row) > count and any(row[count:]):
            raise ValueError(f"{path}: line {number} has {len(row)} cells, the header {count}")
    cells = {c.name: [row[c.index] if c.index < len(row) else "" for row in rows] for c in columns}
    if padded:
        filled = {name: max((i for i, text in enumerate(texts, 1) if text), default=0) for name, texts in cells.items()}
        cells = {name: texts[: filled[name]] for name, texts in cells.items()}
    comma = _has_comma(cells, numbers, path)
    found = {}
    for column in columns:
        texts = cells[column.name]
        values = _numbers([t.replace(",", ".") for t in texts] if comma else texts)
        bad = np.isnan(values)
        if special is None and bad.any():
            bad &= np.array([text.lower().lstrip("+-") != "nan" for text in texts])
        elif special is not None and column.name not in special:
            bad |= ~np.isfinite(values)
        if bad.any() or not texts:
            at = int(bad.argmax()) if texts else 0
            raise ValueError(
                f"{path}: line {numbers[at]}, column {column.name!r} is "
                f"{texts[at] if texts else ''!r}; a number is needed"
            )
        found[column.name] = values * column.factor
        if column.quantity is not None:
            label = f"{path}: column {column.name!r}"
            require_plausible(found[column.name], column.quantity, label, numbers)
    return found


def read_table(
    lines: Sequence[str],
    known: Mapping[str, str | None],
    path: str | Path,
    *,
    special: Collection[str] = (),
    **about: Any,
) -> dict[str, Array]:
    """Columns of numbers of a file with a header line, in SI units, by name.

    Args:
        lines: of the file; blank ones and remarks are passed over.
        known, path: as for ``find_columns``.
        special: as for ``read_columns``; values are finite in all other columns.
        about: further arguments of ``find_columns``.
    Raises:
        ValueError: as ``find_columns`` and ``read_columns``; no header, no rows.
    """
    start = header_line(lines, path)
    separator = separator_of(lines[start])
    labels = cells_of(lines[start], separator)
    while labels and not labels[-1]:
        labels.pop()
    columns = find_columns(labels, known, path, **about)
    numbers = [i for i, line in enumerate(lines, 1) if i > start + 1 and not is_remark(line, separator)]
    if not numbers:
        raise ValueError(f"{path} holds no values: the file ends at line {start + 1}")
    rows = [cells_of(lines[i - 1], separator) for i in numbers]
    return read_columns(rows, numbers, columns, path, len(labels), special=special)


def _name(word: str, unit: str, known: Mapping[str, str | None], short: Mapping[str, str]) -> str:
    """That of ``known``; X without a unit is short for something, X [mm] the column x."""
    lower = word.lower()
    if word in short and not (unit and lower in known):
        return short[word]
    return lower if lower in known else short.get(lower, lower)


def _has_comma(columns: Mapping[str, Sequence[str]], numbers: Sequence[int], path: str | Path) -> bool:
    """Whether the decimal mark is a comma; both in one file are refused."""
    seen: dict[str, str] = {}
    for texts in columns.values():
        for mark in {",", "."} - set(seen):
            place = next((i for i, text in enumerate(texts) if mark in text), None)
            if place is not None:
                seen[mark] = f"line {numbers[place]} has {texts[place]!r}"
    if len(seen) == 2:
        raise ValueError(
            f"{path} mixes decimal marks: {seen[',']}, {seen['.']}; write all numbers with one "
            "mark and none between thousands"
        )
    return "," in seen


def _numbers(texts: Sequence[str]) -> Array:
    """Numbers; nan where there is none."""
    whole = "".join(texts)
    if whole.isascii() and "_" not in whole:
        with suppress(ValueError):
            return np.array(texts, dtype=np.str_).astype(np.float64)
    return np.array([number_of(text) for text in texts])


def number_of(text: str) -> float:
    """The number that a cell holds; nan where there is none, or one that Python reads alone: 1_000, other scripts."""
    with suppress(ValueError):
        if text.isascii() and "_" not in text:
            return float(text)
    return np.nan
