"""The index of a campaign: a row a unit and frequency, as CSV."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torchliner.io.csv_rows import write_rows
from torchliner.report.table import Column, Table, format_bounds, format_complex

Z = tuple(f"{part}{end}" for end in ("", "_low", "_high") for part in ("resistance", "reactance"))
NUMBERS = ("height", "frequency", "notes", "seconds", *Z)  # all else is text
COLUMNS = (
    *("unit", "file", "height", "source_side", "liner", "choices", "averaging", "frequency"),
    *Z,
    *("level_check", "notes", "status", "error", "seconds", "hash", "campaign", "version"),
)
DONE, FAILED = "done", "failed"
Row = Mapping[str, Any]


def impedance(row: Row, end: str = "") -> complex | None:
    """Z of a row, or the lower or upper ends of its interval (``_low``, ``_high``); None of one that failed."""
    found = complex(row[f"resistance{end}"], row[f"reactance{end}"])
    return None if math.isnan(found.real) else found


def interval(row: Row) -> tuple[complex, complex] | None:
    """Of a row; None where it has none."""
    low, high = impedance(row, "_low"), impedance(row, "_high")
    return None if low is None or high is None else (low, high)


def full_row(**known: Any) -> dict[str, Any]:
    """All columns, those not known as nan or an empty text; another one is a KeyError."""
    usual = {name: math.nan if name in NUMBERS else "" for name in COLUMNS}
    if strange := {*known} - {*usual}:
        raise KeyError(f"{strange} are no columns of an index")
    return usual | known


def index_text(rows: Sequence[Row]) -> str:
    """For the terminal."""
    columns = [
        Column("", "unit", "unit"),
        Column("", "frequency", "f Hz", ".1f"),
        Column("", impedance, "Z", format_complex),
        Column("", interval, "interval", format_bounds),
        Column("", "level_check", "level check"),
        Column("", "notes", "notes", ".0f"),
        Column("", lambda row: row["error"] or row["status"], "status"),
    ]
    return Table(rows, columns).as_text()


def write_index(rows: Sequence[Row], folder: Path, title: str, version: str) -> None:
    """``index.csv`` of a folder; what is not known stays empty."""
    about = {"campaign": title, "version": version}
    known = [{name: value if value == value else None for name, value in {**row, **about}.items()} for row in rows]
    write_rows(known or [dict.fromkeys(COLUMNS)], folder / "index.csv")


def read_index(folder: Path) -> list[dict[str, Any]]:
    """Rows of ``index.csv`` in a folder.

    Raises:
        ValueError: the folder has no index; that of another version; a damaged one.
    """
    path = folder / "index.csv"
    if not path.exists():
        raise ValueError(f"{folder} holds no index.csv; it is the folder of no campaign (torchliner run writes one)")
    require_readable_index(folder)
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file, strict=True))
        return [{name: float(row[name] or "nan") if name in NUMBERS else row[name] for name in COLUMNS} for row in rows]
    except (ValueError, TypeError, csv.Error) as error:
        raise ValueError(f"{path} is damaged: {error}; run the campaign again") from error


def require_readable_index(folder: Path) -> None:
    """Refuse a folder whose index is that of another version of this package, or none.

    Raises:
        ValueError: it is.
    """
    path = folder / "index.csv"
    if path.exists():
        with path.open(newline="", encoding="utf-8", errors="replace") as file:
            names = next(csv.reader(file), [])
        if names != [*COLUMNS]:
            raise ValueError(
                f"{path} is no index of this version: its columns are {', '.join(names)[:200]}; name another --output, "
                "or take the torchliner that wrote it"
            )
