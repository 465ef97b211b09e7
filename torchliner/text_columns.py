"""Text files of numbers: '# key = value' lines, a header of names with units, rows of cells."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchliner.names import did_you_mean
from torchliner.units import si_factor

Array = NDArray[np.float64]
SEPARATORS = (";", "\t", ",")
LABEL = re.compile(r"(\w+)\s*(?:\[(.*)\]|\((.*)\))?")


def read_lines(path: str | Path, head: int | None = None) -> list[str]:
    """Lines of a text file in UTF-8, or else latin-1, without their ends.

    Args:
        path: file.
        head: bytes that are read from its beginning, the line cut there included; None for all.
    Raises:
        FileNotFoundError: no such file.
        OSError: a folder.
        ValueError: the file is empty, or is no text.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    if path.is_dir():
        raise OSError(f"{path} is a folder, not a file")
    with path.open("rb") as file:
        raw = file.read() if head is None else file.read(head)
    if b"\0" in raw:
        raise ValueError(f"{path} holds zero bytes: it is no text file (UTF-8 or latin-1)")
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
    start = next((i for i, line in enumerate(lines) if line.strip() and line[0] != "#"), None)
    if start is None:
        raise ValueError(f"{path} has no header line with the names of the columns")
    return start


def separator_of(header: str) -> str:
    """What the cells of a header line are parted by."""
    return next((mark for mark in SEPARATORS if mark in header), ",")


def stated_values(
    lines: Sequence[str], known: Sequence[str], path: str | Path
) -> Iterator[tuple[str, str, str]]:
    """Key, value and a label for messages of each line '# key = value'; other lines are remarks.

    Raises:
        ValueError: a key that is not ``known``, or is stated twice.
    """
    seen = set()
    for number, line in enumerate(lines, 1):
        found = re.fullmatch(r"#\s*(\w+)\s*=\s*(.*?)\s*", line)
        if found is None:
            continue
        key, value = found.groups()
        if key not in known:
            raise ValueError(
                f"{path}: line {number} states {key!r}{did_you_mean(key, known)}; known are "
                f"{', '.join(known)}"
            )
        if key in seen:
            raise ValueError(f"{path}: line {number} states {key!r} a second time; keep one")
        seen.add(key)
        yield key, value, f"{path}: line {number}, {key}"


def stated_text(key: str, value: str, path: str | Path) -> str:
    """The line '# key = value' that ``stated_values`` reads.

    Raises:
        ValueError: a value of several lines, or with blanks around it, which would not come back.
    """
    if value != value.strip() or len(value.splitlines()) > 1:
        raise ValueError(f"{path}: {key} is {value!r}; a .csv holds one line of it, without blanks "
                         "around it")  # fmt: skip
    return f"# {key} = {value}\n"


def si_value(text: str, quantity: str, label: str) -> float:
    """A number and its unit, as ``50 mm``, in SI.

    Raises:
        ValueError: no number, or no unit of the quantity.
    """
    parts = re.fullmatch(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*)", text)
    try:
        amount = float(parts.group(1) if parts else text)
    except ValueError as error:
        raise ValueError(f"{label} is {text!r}; it cannot be read") from error
    return amount * si_factor(quantity, parts.group(2) if parts else "", label)


def named_columns(
    lines: Sequence[str],
    first: int,
    columns: Mapping[str, str | None],
    path: str | Path,
    *,
    example: str,
    optional: Sequence[str] = (),
    short: Mapping[str, str] | None = None,
) -> dict[str, Array]:
    """Columns of numbers by name, in any order, in the units of ``units.FACTORS``.

    Args:
        lines: the header line and the rows; blank rows and remarks are passed over.
        first: number of the header line, from 1, for messages.
        columns: quantity of each by its name, in lower case; None takes values in any unit as they
            stand.
        path: for messages.
        example: a header line that is right.
        optional: names that may be absent.
        short: other names, in their own case, for some of ``columns``.
    Raises:
        ValueError: a column unknown, missing, named twice or without a unit, a cell that is no
            number, a row of another length, no rows.
    """
    separator = separator_of(lines[0])
    found: dict[str, tuple[int, float]] = {}
    labels = [cell.strip() for cell in lines[0].split(separator)]
    while labels and not labels[-1]:
        labels.pop()
    for index, label in enumerate(labels):
        match = LABEL.fullmatch(label)
        word, unit = (match[1], match[2] or match[3] or "") if match else (label, "")
        name = _name(word, unit, columns, short or {})
        if match is None or name not in columns:
            raise ValueError(
                f"{path}: unknown column {label!r}{did_you_mean(name, list(columns))}; write "
                f"{example}"
            )
        if name in found:
            raise ValueError(f"{path}: column {name!r} is named twice")
        found[name] = (index, _factor(columns[name], unit, label, f"{path}: column {name!r}"))
    for name in columns:
        if name not in found and name not in optional:
            raise ValueError(
                f"{path}: column {name!r} is missing; there are: {', '.join(found)}; write "
                f"{example}"
            )
    rows = [(first + i, text) for i, text in enumerate(lines) if i and text.strip()]
    rows = [(number, text) for number, text in rows if text[0] != "#"]
    if not rows:
        raise ValueError(f"{path} holds no values: the file ends at line {first}")
    for number, text in rows:
        cells = text.split(separator)
        if any(cell.strip() for cell in cells[len(labels) :]):
            raise ValueError(
                f"{path}: line {number} has {len(cells)} cells, the header {len(labels)}"
            )
    return {name: np.array([_cell(text, separator, at, f"{path}: line {number}, column {name!r}")
                            for number, text in rows]) * factor
            for name, (at, factor) in found.items()}  # fmt: skip


def _name(word: str, unit: str, columns: Mapping[str, str | None], short: Mapping[str, str]) -> str:
    """That of ``columns``; X without a unit is short for something, X [mm] the column x."""
    lower = word.lower()
    if word in short and not (unit and lower in columns):
        return short[word]
    return lower if lower in columns else short.get(lower, lower)


def _factor(quantity: str | None, unit: str, label: str, name: str) -> float:
    if quantity is None:
        return 1.0
    if not unit and quantity != "number":
        raise ValueError(f"{name} has no unit in {label!r}; write it as in 'x [mm]'")
    return si_factor(quantity, unit, name)


def _cell(text: str, separator: str, index: int, name: str) -> float:
    cells = text.split(separator)
    try:
        cell = cells[index].strip()
        return float(cell.replace(",", ".") if separator != "," else cell)
    except (ValueError, IndexError):
        shown = cells[index].strip() if index < len(cells) else ""
        raise ValueError(f"{name} is {shown!r}; a number is needed") from None
