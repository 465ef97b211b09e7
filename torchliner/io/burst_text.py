"""Bursts of one station from columns of text: what the formats share, and files without a header.

Each format names its columns its own way and hands them over as ``Column``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.checks import require_choice
from torchliner.io.burst_format import BurstFormat
from torchliner.names import SEPARATORS
from torchliner.records import BurstRecord
from torchliner.text_columns import Array, Column, cells_of, find_columns, read_columns, read_lines

QUANTITIES = {"arrival_time": "time", "transit_time": "time", "wall_normal": "velocity",
              "streamwise": "velocity"}  # fmt: skip
PASSED_OVER = ("row", "skip")
EXAMPLE = f"NAME [UNIT] with NAME one of {', '.join((*QUANTITIES, *PASSED_OVER))}"
NOT_FINITE = "not a number in the file"


def burst_columns(labels: Sequence[str], path: str | Path) -> list[Column]:
    """Columns from labels such as ``wall_normal [m/s]``; ``row`` and ``skip`` are passed over.

    Args:
        labels: one per column, in the order of the file; a minus before the name turns a velocity.
        path: for messages.
    Raises:
        ValueError: as ``find_columns``; no arrival time, no velocity, a time with a sign.
    """
    columns = find_columns(
        [label.removeprefix("-") for label in labels], QUANTITIES, path, example=EXAMPLE,
        optional=[name for name in QUANTITIES if name != "arrival_time"], others=PASSED_OVER,
    )  # fmt: skip
    turned = {i for i, label in enumerate(labels) if label.startswith("-")}
    for column in columns:
        if column.index in turned and QUANTITIES[column.name] == "time":
            raise ValueError(f"{path}: column {labels[column.index]!r} has a sign; only velocities have one")
    if not {"wall_normal", "streamwise"} & {column.name for column in columns}:
        raise ValueError(f"{path}: no velocity; a column 'wall_normal' or 'streamwise' is needed")
    return [replace(c, factor=-c.factor) if c.index in turned else c for c in columns]


def read_bursts_of(
    lines: Sequence[str], first: int, columns: Sequence[Column], path: str | Path, count: int,
    separator: str | None, padded: bool = False,
) -> dict[str, Array]:  # fmt: skip
    """Columns of all lines from number ``first``, from 1; blank ones at the end are passed over.

    Other arguments and errors are those of ``read_columns``; no bursts are a ValueError as well.
    """
    rows = [cells_of(line, separator) for line in lines[first - 1 :]]
    while rows and not any(rows[-1]):
        rows.pop()
    if not rows:
        raise ValueError(f"{path} holds no bursts: the file ends before line {first + 1}")
    numbers = range(first, first + len(rows))
    return read_columns(rows, numbers, columns, path, count, padded=padded)


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


def read_burst_columns(
    path: str | Path, columns: str | Sequence[str], separator: str = "blank", **about: Any
) -> BurstRecord:
    """Bursts of one station from columns of numbers.

    Args:
        path: text, UTF-8 or latin-1, decimal point or comma; no header.
        columns: names with units in the order of the file, separated by commas (in Python also a list):
            "row, arrival_time [ms], transit_time [us], streamwise [m/s], wall_normal [m/s]".
            ``row`` and ``skip`` are passed over; a minus turns a velocity round.
        separator: ``blank`` (any white space), ``tab``, ``comma`` or ``semicolon``.
        about: further fields of the record: x, y, z (m), frequency, fluid, ...
    Raises:
        FileNotFoundError, OSError: no such file, a folder.
        ValueError: empty, a header or another number of columns than stated, a wrong unit, an
            unreadable or missing cell, mixed decimal marks.
    """
    labels = columns.split(",") if isinstance(columns, str) else columns
    labels = [label.strip() for label in labels]
    wanted = burst_columns(labels, path)
    between = SEPARATORS[require_choice("separator", separator, SEPARATORS)]
    lines = read_lines(path)
    count = len(cells_of(lines[0], between))
    if count != len(labels):
        raise ValueError(
            f"{path}: line 1 has {count} cells, {len(labels)} columns are stated: "
            f"{', '.join(labels)}; name every column, 'skip' included"
        )
    found = read_bursts_of(lines, 1, wanted, path, count, between)
    return record_of(found, path, provenance={"format": "columns", "columns": labels}, **about)


FORMAT = BurstFormat(
    recognises=lambda _, options: options["columns"] is not None,
    places=lambda _: [(None, None, None)],
    read=lambda path, _, options, about: read_burst_columns(path, options["columns"], options["separator"], **about),
    takes=("columns", "separator"),
)
