"""Bursts of one station from columns of text: what the formats share, CSV, and files without a header.

A CSV has '# key = value unit' lines, a header with units, the bursts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.checks import require_choice
from torchliner.io.stated_lines import read_stated
from torchliner.names import SEPARATORS
from torchliner.records import BurstRecord
from torchliner.records.declared import variables_of
from torchliner.text_columns import (
    Array,
    Column,
    cells_of,
    find_columns,
    header_line,
    read_columns,
    read_lines,
    separator_of,
)

HEAD = 1 << 16  # bytes of a text file that hold all that stands before the bursts
QUANTITIES = {"arrival_time": "time", "transit_time": "time", "wall_normal": "velocity", "streamwise": "velocity"}
OPTIONAL, PASSED_OVER = ("transit_time", "wall_normal", "streamwise"), ("row", "skip")
EXAMPLE = f"NAME [UNIT] with NAME one of {', '.join((*QUANTITIES, *PASSED_OVER))}"
NOT_FINITE = "not a number in the file"
STATED = {row.field: row.unit for row in variables_of(BurstRecord) if not row.dims}
STATED |= dict.fromkeys(("title", "source_side", "liner"), "text")

Place = tuple[float | None, float | None, float | None]
Options = Mapping[str, Any]


@dataclass(frozen=True)
class BurstFormat:
    """How a file of bursts is recognised and read: a row of ``names.BURST_FORMATS``.

    Args:
        recognises: whether a file, read with these options, is of the format.
        places: (x, y, z), m, of its stations, None where unknown; bursts are not read.
        read: one station: path, its number, options, further fields of the record.
        own_fields: whether the file states all of them, so that none may be added.
        takes: options of ``list_stations`` that say how such a file is read.
    """

    recognises: Callable[[Path, Options], bool]
    places: Callable[[Path], list[Place]]
    read: Callable[[Path, int, Options, Options], BurstRecord]
    own_fields: bool = False
    takes: tuple[str, ...] = ()


def burst_columns(labels: Sequence[str], path: str | Path) -> list[Column]:
    """Columns from labels such as ``wall_normal [m/s]``, with a minus before the name of a velocity that is turned.

    Raises:
        ValueError: as ``find_columns``; no velocity, a time with a sign.
    """
    plain = [label.removeprefix("-") for label in labels]
    columns = find_columns(plain, QUANTITIES, path, example=EXAMPLE, optional=OPTIONAL, others=PASSED_OVER)
    turned = {i for i, label in enumerate(labels) if label.startswith("-")}
    if any(column.index in turned and column.quantity == "time" for column in columns):
        raise ValueError(f"{path}: a time has a sign in {', '.join(labels)}; only velocities have one")
    if not {"wall_normal", "streamwise"} & {column.name for column in columns}:
        raise ValueError(f"{path}: no velocity; a column 'wall_normal' or 'streamwise' is needed")
    return [replace(c, factor=-c.factor) if c.index in turned else c for c in columns]


def read_bursts_of(
    lines: Sequence[str], first: int, columns: Sequence[Column], path: str | Path, count: int, separator: str | None
) -> dict[str, Array]:
    """Columns of the lines from number ``first``, from 1, to the last in which one of them holds something.

    Other arguments and errors are those of ``read_columns``; no bursts are a ValueError as well.
    """
    rows = [cells_of(line, separator) for line in lines[first - 1 :]]
    used = [column.index for column in columns]
    while rows and not any([*rows[-1][count:], *(rows[-1][i] for i in used if i < len(rows[-1]))]):
        rows.pop()
    if not rows:
        raise ValueError(f"{path} holds no bursts: the file ends before line {first + 1}")
    return read_columns(rows, range(first, first + len(rows)), columns, path, count)


def record_of(columns: Mapping[str, Array], path: str | Path, **about: Any) -> BurstRecord:
    """A record of the bursts whose values, SI, are all finite; the others are counted. ``about`` are further fields.

    Raises:
        ValueError: no burst is finite.
    """
    path = Path(path)
    good = np.asarray(np.isfinite(np.stack(list(columns.values()))).all(0))
    if not good.any():
        raise ValueError(f"{path}: none of the {len(good)} bursts is finite in all columns")
    about["dropped"] = {**about.get("dropped", {}), **({} if good.all() else {NOT_FINITE: int((~good).sum())})}
    about["provenance"] = {"file": path.name, **about.get("provenance", {})}
    kept: dict[str, Any] = {name: values[good] for name, values in columns.items()}
    return BurstRecord(**{"title": path.stem, **kept, "name": str(path), **about})


def read_burst_csv(path: str | Path, **about: Any) -> BurstRecord:
    """Bursts of one station from a CSV; ``about`` are fields of the record instead of those of the file.

    Raises:
        FileNotFoundError, OSError: no such file, a folder.
        ValueError: empty, header only, a column missing or without a unit, an unknown key, mixed decimal marks, an
            unreadable cell.
    """
    lines = read_lines(path)
    start = header_line(lines, path)
    stated, separator = read_stated(lines[:start], STATED, path), separator_of(lines[start])
    labels = cells_of(lines[start], separator)
    found = read_bursts_of(lines, start + 2, burst_columns(labels, path), path, len(labels), separator)
    return record_of(found, path, **{"provenance": {"format": "csv"}, **stated, **about})


def read_burst_columns(
    path: str | Path, columns: str | Sequence[str], separator: str = "blank", **about: Any
) -> BurstRecord:
    """Bursts of one station from columns of numbers without a header.

    Args:
        path: text, UTF-8 or latin-1, decimal point or comma.
        columns: names with units in the order of the file, separated by commas (in Python also a list):
            "row, arrival_time [ms], transit_time [us], streamwise [m/s], wall_normal [m/s]".
            ``row`` and ``skip`` are passed over; a minus turns a velocity round.
        separator: ``blank`` (any white space), ``tab``, ``comma`` or ``semicolon``.
        about: further fields of the record: x, y, z (m), frequency, fluid, ...
    Raises:
        As ``read_burst_csv``; another number of columns than stated.
    """
    labels = [label.strip() for label in (columns.split(",") if isinstance(columns, str) else columns)]
    wanted = burst_columns(labels, path)
    between = SEPARATORS[require_choice("separator", separator, SEPARATORS)]
    lines = read_lines(path)
    count = len(cells_of(lines[0], between))
    if count != len(labels):
        stated = f"{len(labels)} columns are stated: {', '.join(labels)}"
        raise ValueError(f"{path}: line 1 has {count} cells, {stated}; name every column, 'skip' included")
    found = read_bursts_of(lines, 1, wanted, path, count, between)
    return record_of(found, path, **{"provenance": {"format": "columns", "columns": labels}, **about})


def _places(path: Path) -> list[Place]:
    lines = read_lines(path, HEAD)
    stated = read_stated(lines[: header_line(lines, path)], STATED, path)
    return [(stated.get("x"), stated.get("y"), stated.get("z"))]


def _is_csv(path: Path, _: Options) -> bool:
    """Whether the first line that is no remark names an arrival time."""
    return "arrival_time" in next((line for line in read_lines(path, HEAD) if line.strip() and line[0] != "#"), "")


CSV = BurstFormat(_is_csv, _places, lambda path, _, options, about: read_burst_csv(path, **about))
COLUMNS = BurstFormat(
    recognises=lambda _, options: options["columns"] is not None,
    places=lambda _: [(None, None, None)],
    read=lambda path, _, options, about: read_burst_columns(path, options["columns"], options["separator"], **about),
    takes=("columns", "separator"),
)
