"""Text files of numbers: lines '# key = value unit', a header of names with units, rows of cells, remarks after '#'."""

import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchliner.file_checks import read_bytes
from torchliner.names import did_you_mean
from torchliner.units import SI_QUANTITY, require_plausible, si_factor

Array = NDArray[np.float64]
SEPARATORS = (";", "\t", ",")
LABEL = re.compile(r"-?(\w+)\s*(?:\[(.*)\]|\((.*)\))?")


def read_lines(path: str | Path, head: int | None = None) -> list[str]:
    """Lines of a text file in UTF-8, or else latin-1, without their ends; of its first ``head`` bytes if stated.
    ValueError where it is empty or no text, and the errors of ``read_bytes``."""
    raw = read_bytes(path, head)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    if not text.strip():
        raise ValueError(f"{path} is empty")
    return text.splitlines()


def header_line(lines: Sequence[str], path: str | Path) -> int:
    """Index of the first line that is neither blank nor a remark; ValueError if there is none."""
    start = next((i for i, line in enumerate(lines) if line.strip() and line[0] != "#"), None)
    if start is None:
        raise ValueError(f"{path} has no header line with the names of the columns")
    return start


def cells_of(line: str, separator: str | None) -> list[str]:
    """Without the blanks around them; separator None for blanks."""
    return [cell.strip() for cell in line.split(separator)]


def number_of(text: str) -> float:
    """The number that a cell holds; nan where there is none, or one that Python reads alone: 1_000, other scripts."""
    with suppress(ValueError):
        if text.isascii() and "_" not in text:
            return float(text)
    return np.nan


def read_table(
    lines: Sequence[str],
    known: Mapping[str, str | None],
    path: str | Path,
    *,
    example: str,
    optional: Collection[str] = (),
    others: Collection[str] = (),
    labels: Sequence[str] | None = None,
    start: int = 0,
    separator: str | None = None,
) -> dict[str, Array]:
    """Columns of numbers in SI units, by name, of labels such as ``x [mm]``, in any order, a minus before those whose
    sign is turned. Blank lines and remarks are passed over; what begins with '#' and has as many cells as there are
    columns is no remark. ValueError for columns and cells that cannot be read, and for values that no measurement has.

    Args:
        lines: with a header line, unless ``labels``, the index of the first row ``start`` and ``separator`` are stated.
        known: quantity of each column by its name, in lower case; None takes values in any unit as they stand.
        example: a header that is right, for messages.
        optional, others: names that may be absent, and that are passed over.
    """
    if labels is None:
        start = header_line(lines, path)
        separator = next((mark for mark in SEPARATORS if mark in lines[start]), ",")
        labels, start = cells_of(lines[start].rstrip(f"{separator} "), separator), start + 1
    columns, rows = dict[str, tuple[int, float]](), dict[int, list[str]]()
    for index, label in enumerate(labels):
        match = LABEL.fullmatch(label)
        name, unit = (match[1].lower(), match[2] or match[3] or "") if match else (label, "")
        if name in others:
            continue
        if name not in known:
            raise ValueError(f"{path}: unknown column {label!r}{did_you_mean(name, list(known))}; write {example}")
        where, quantity = f"{path}: column {name!r}", known[name]
        if name in columns:
            raise ValueError(f"{where} is named twice")
        if quantity not in (None, "number") and not unit:
            raise ValueError(f"{where} has no unit in {label!r}; write it as in 'x [mm]'")
        factor = 1.0 if quantity is None else si_factor(quantity, unit, where)
        columns[name] = index, -factor if label[:1] == "-" else factor
    for name in known:
        if name not in columns and name not in optional:
            raise ValueError(f"{path}: column {name!r} is missing; there are: {', '.join(columns)}; write {example}")
    for number, line in enumerate(lines[start:], start + 1):
        row = cells_of(line, separator) or [""]
        if row[0][:1] == "#" and len(row) != len(labels):
            continue
        if any(row[len(labels) :]):
            raise ValueError(f"{path}: line {number} has {len(row)} cells, the header {len(labels)}")
        row += [""] * (len(labels) - len(row))
        if any(cells := [row[index] for index, _ in columns.values()]):
            rows[number] = cells
    if not rows:
        raise ValueError(f"{path} holds no values: the file ends at line {len(lines)}")
    found, numbers = dict[str, Array](), [*rows]
    for (name, (_, factor)), texts in zip(columns.items(), zip(*rows.values(), strict=True), strict=True):
        values, where = np.array([number_of(text.replace(",", ".")) for text in texts]), f"column {name!r}"
        bad = ~np.isfinite(values)
        if bad.any():
            at = int(bad.argmax())
            raise ValueError(f"{path}: line {numbers[at]}, {where} is {texts[at]!r}; a number is needed")
        found[name] = values * factor
        if (quantity := known[name]) is not None:
            require_plausible(found[name], quantity, f"{path}: {where}", numbers)
    return found


def read_stated(lines: Sequence[str], known: Mapping[str, str], path: str | Path) -> dict[str, Any]:
    """What the lines '# key = value unit' before a header say; lines without '=' are remarks. ``known``: by key the SI
    unit of a number, or "text". A ValueError where a key is another, or stated twice, or a line cannot be read."""
    found: dict[str, Any] = {}
    for number, line in enumerate(lines, 1):
        label, match = f"{path}: line {number}", re.fullmatch(r"#\s*(\w+)\s*=\s*(.*?)\s*", line)
        if match is None:
            if "=" in line:
                raise ValueError(f"{label} is {line[:60]!r}; write '# key = value', and remarks without '='")
            continue
        key, text = match.groups()
        if key not in known or key in found:
            again = " a second time" if key in found else did_you_mean(key, list(known))
            raise ValueError(f"{label} states {key!r}{again}; once each are known: {', '.join(known)}")
        if known[key] == "text":
            found[key] = text
            continue
        label, quantity = f"{label}, {key}", SI_QUANTITY[known[key]]
        amount, unit = re.fullmatch(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*)|.*", text).groups()  # type: ignore[union-attr]
        found[key] = number_of(amount or "") * si_factor(quantity, known[key] if unit is None else unit, label)
        if not np.isfinite(found[key]):
            raise ValueError(f"{label} is {text!r}; a finite number with its unit is needed")
        require_plausible(found[key], quantity, label)
    return found
