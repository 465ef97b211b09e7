"""The index of a campaign: a row a unit and frequency, as CSV."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torchliner.io.csv_rows import write_rows
from torchliner.report.table import Column, Table, format_bounds

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
    """Z of a row, or the lower or upper ends of its interval (``_low``, ``_high``); None where there is none."""
    found = complex(row[f"resistance{end}"], row[f"reactance{end}"])
    return None if math.isnan(found.real) else found


def interval(row: Row) -> tuple[complex, complex] | None:
    """Of a row; None where it has none."""
    low, high = impedance(row, "_low"), impedance(row, "_high")
    return None if low is None or high is None else (low, high)


def full_row(**known: Any) -> dict[str, Any]:
    """All columns, those not known as nan or an empty text."""
    return {name: known.get(name, math.nan if name in NUMBERS else "") for name in COLUMNS}


def index_table(rows: Sequence[Row]) -> Table:
    """The chief columns; all of them in CSV."""
    columns = [
        Column("case", "unit"),
        Column("y (mm)", "height", ".2f", 1e3),
        Column("f (Hz)", "frequency", ".1f"),
        Column("Z", impedance),
        Column("interval", interval, format_bounds),
        Column("level check", "level_check"),
        Column("warnings", "notes", ".0f"),
        Column("status", lambda row: row["error"] or row["status"]),
    ]
    return Table(rows, columns, COLUMNS)


def write_index(rows: Sequence[Row], folder: Path, title: str, version: str) -> None:
    """``index.csv`` of a folder; what is not known stays empty."""
    about = {"campaign": title, "version": version}
    known = [{name: value if value == value else None for name, value in {**row, **about}.items()} for row in rows]
    write_rows(known or [dict.fromkeys(COLUMNS)], folder / "index.csv")


def read_index(folder: Path) -> list[dict[str, Any]]:
    """Rows of ``index.csv`` in a folder; none where there is none.

    Raises:
        ValueError: that of another version of this package, or a damaged one.
    """
    path = folder / "index.csv"
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8", errors="replace") as file:
        reader = csv.DictReader(file)
        if reader.fieldnames != [*COLUMNS]:
            raise ValueError(
                f"{path} is no index of this version: its columns are {', '.join(reader.fieldnames or ())[:200]}; name "
                "another --output, or take the torchliner that wrote it"
            )
        try:
            return [{k: float(row[k] or "nan") if k in NUMBERS else row[k] for k in COLUMNS} for row in reader]
        except (ValueError, TypeError, csv.Error) as error:
            raise ValueError(f"{path} is damaged: {error}; run the campaign again") from error
