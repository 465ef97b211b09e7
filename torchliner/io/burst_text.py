"""What text files of bursts share: encoding, decimal mark, columns with units, one station."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchliner.checks import require_choice
from torchliner.names import did_you_mean
from torchliner.records import BurstRecord
from torchliner.text_columns import read_lines
from torchliner.units import si_factor

Array = NDArray[np.float64]
QUANTITIES = {"arrival_time": "time", "transit_time": "time", "wall_normal": "velocity",
              "streamwise": "velocity"}  # fmt: skip
NOT_FINITE = "not a number in the file"


@dataclass(frozen=True)
class Column:
    """Where a quantity stands, and in which unit.

    Args:
        quantity: a key of ``QUANTITIES``.
        index: of the column, from 0.
        unit: as found.
        sign: -1 turns a velocity round.
    """

    quantity: str
    index: int
    unit: str
    sign: float = 1.0


def named_columns(labels: Sequence[str], path: str | Path) -> list[Column]:
    """Columns from labels such as ``wall_normal [m/s]``; ``row`` and ``skip`` are passed over.

    Args:
        labels: one per column, in the order of the file; a minus before the name turns a velocity.
        path: for messages.
    Raises:
        ValueError: an unknown name, a unit that is absent or wrong, a quantity named twice, or no
            arrival time or velocity.
    """
    columns: list[Column] = []
    for index, label in enumerate(label.strip() for label in labels):
        found = re.fullmatch(r"(-?)(\w+)\s*(?:\[(.*)\])?", label)
        name = found.group(2) if found else label
        if name in ("row", "skip"):
            continue
        known = [*QUANTITIES, "row", "skip"]
        if found is None or name not in QUANTITIES:
            raise ValueError(
                f"{path}: unknown column {label!r}{did_you_mean(name, known)}; write NAME [UNIT] "
                f"with NAME one of {', '.join(known)}"
            )
        if found.group(1) and QUANTITIES[name] == "time":
            raise ValueError(f"{path}: column {label!r} has a sign; only velocities have one")
        if found.group(3) is None:
            raise ValueError(
                f"{path}: column {label!r} has no unit; write e.g. "
                f"'{name} [{'ms' if QUANTITIES[name] == 'time' else 'm/s'}]'"
            )
        si_factor(QUANTITIES[name], found.group(3), f"{path}: column {name!r}")
        columns.append(Column(name, index, found.group(3), -1.0 if found.group(1) else 1.0))
    names = [column.quantity for column in columns]
    for name in set(names):
        if names.count(name) > 1:
            raise ValueError(f"{path}: column {name!r} is named {names.count(name)} times")
    if "arrival_time" not in names:
        raise ValueError(f"{path}: column 'arrival_time' is missing; there are: {', '.join(names)}")
    if not {"wall_normal", "streamwise"} & set(names):
        raise ValueError(f"{path}: no velocity; a column 'wall_normal' or 'streamwise' is needed")
    return columns


def read_columns(
    lines: Sequence[str], first: int, columns: Sequence[Column], path: str | Path,
    separator: str | None = None, padded: bool = False,
) -> dict[str, Array]:  # fmt: skip
    """Columns of numbers in SI units, by quantity.

    Args:
        lines: of data; blank ones at the end are passed over.
        first: number of the first, from 1, for messages.
        columns: what to read.
        path: for messages.
        separator: of the cells; None for blanks.
        padded: columns may end early, filled up with blank cells, as those of two channels do.
    Raises:
        ValueError: no data, a blank or unreadable cell, mixed decimal marks, unequal lengths.
    """
    rows = [line.split(separator) for line in lines]
    while rows and not any(cell.strip() for cell in rows[-1]):
        rows.pop()
    if not rows:
        raise ValueError(f"{path} holds no bursts: the file ends before line {first + 1}")
    cells = {c: [row[c.index].strip() if c.index < len(row) else "" for row in rows]
             for c in columns}  # fmt: skip
    comma = _has_comma(list(cells.values()), first, path)
    found = {}
    for column, texts in cells.items():
        label = f"{path}: column {column.quantity!r}"
        filled = _filled(texts, first, label, padded)
        values = _numbers([t.replace(",", ".") for t in filled] if comma else filled, first, label)
        factor = si_factor(QUANTITIES[column.quantity], column.unit, label)
        found[column.quantity] = values * (factor * column.sign)
    return found


def _has_comma(columns: Sequence[Sequence[str]], first: int, path: str | Path) -> bool:
    """Whether the decimal mark is a comma; both in one file are refused."""
    seen: dict[str, str] = {}
    for texts in columns:
        for mark in {",", "."} - set(seen):
            place = next((i for i, text in enumerate(texts) if mark in text), None)
            if place is not None:
                seen[mark] = f"line {first + place} has {texts[place]!r}"
    if len(seen) == 2:
        raise ValueError(
            f"{path} mixes decimal marks: {seen[',']}, {seen['.']}; write all numbers with one "
            "mark and none between thousands"
        )
    return "," in seen


def _filled(texts: list[str], first: int, label: str, padded: bool) -> list[str]:
    """The cells before the blank ones at the end."""
    count = len(texts)
    while count and not texts[count - 1]:
        count -= 1
    if count < len(texts) and not padded:
        raise ValueError(
            f"{label} ends at line {first + count - 1}, the file at line {first + len(texts) - 1}; "
            "the columns of a burst have equal lengths"
        )
    if count == 0:
        raise ValueError(f"{label} is blank")
    if "" in texts[:count]:
        raise ValueError(f"{label} is blank at line {first + texts.index('')}")
    return texts[:count]


def _numbers(texts: list[str], first: int, label: str) -> Array:
    try:
        return np.array(texts, dtype=np.str_).astype(np.float64)
    except ValueError:
        for i, text in enumerate(texts):
            try:
                float(text)
            except ValueError:
                raise ValueError(f"{label} holds {text!r} at line {first + i}; no number") from None
        raise


def record_of(columns: Mapping[str, Array], path: str | Path, **about: Any) -> BurstRecord:
    """A record of the bursts whose values are all finite; the others are counted.

    Args:
        columns: SI values by quantity, of equal lengths.
        path: gives the name and, in the provenance, the file.
        about: further fields of the record.
    Raises:
        ValueError: no burst is finite.
    """
    path = Path(path)
    good = np.asarray(np.isfinite(np.stack(list(columns.values()))).all(0))
    if not good.any():
        raise ValueError(f"{path}: none of the {len(good)} bursts is finite in all columns")
    dropped = dict(about.pop("dropped", {}))
    if not good.all():
        dropped[NOT_FINITE] = int((~good).sum())
    provenance = {"file": path.name, **about.pop("provenance", {})}
    kept: dict[str, Any] = {name: values[good] for name, values in columns.items()}
    about.setdefault("title", path.stem)
    return BurstRecord(**kept, dropped=dropped, provenance=provenance, name=str(path), **about)


SEPARATORS = {"blank": None, "tab": "\t", "comma": ",", "semicolon": ";"}


def read_burst_columns(
    path: str | Path, columns: str | Sequence[str], separator: str = "blank", **about: Any
) -> BurstRecord:
    """Bursts of one station from columns of numbers.

    Args:
        path: text, UTF-8 or latin-1, decimal point or comma; no header.
        columns: names with units in the order of the file, as a list or separated by commas:
            "row, arrival_time [ms], transit_time [us], streamwise [m/s], wall_normal [m/s]".
            ``row`` and ``skip`` are passed over; a minus turns a velocity round.
        separator: ``blank`` (any white space), ``tab``, ``comma`` or ``semicolon``.
        about: further fields of the record: x, y, z (m), frequency, fluid, ...
    Raises:
        FileNotFoundError, OSError: no such file, a folder.
        ValueError: empty, a header or another number of columns than stated, a wrong unit, an
            unreadable or missing cell, mixed decimal marks.
    """
    labels = columns.split(",") if isinstance(columns, str) else list(columns)
    wanted = named_columns(labels, path)
    between = SEPARATORS[require_choice("separator", separator, SEPARATORS)]
    lines = read_lines(path)
    count = len(lines[0].split(between))
    if count != len(labels):
        raise ValueError(
            f"{path}: line 1 has {count} cells, {len(labels)} columns are stated: "
            f"{', '.join(label.strip() for label in labels)}; name every column, 'skip' included"
        )
    found = read_columns(lines, 1, wanted, path, between)
    provenance = {"format": "columns", "columns": [label.strip() for label in labels]}
    return record_of(found, path, provenance=provenance, **about)
