"""The index of a campaign: a row a unit and frequency, as CSV."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torchliner.checks import require_choice
from torchliner.io.csv_rows import write_rows
from torchliner.report.table import Column, Table, format_bounds, format_complex

COLUMNS: dict[str, tuple[str, str]] = {  # unit of a number, "" for texts; what it is
    "unit": ("", "name of the unit of work, and of its files"),
    "file": ("", "velocity plane"),
    "height": ("m", "of the plane above the liner"),
    "source_side": ("", "that the sound comes from"),
    "liner": ("", "model of the liner"),
    "choices": ("", "stated for this unit, JSON"),
    "averaging": ("", "of the impedance"),
    "frequency": ("Hz", "frequency"),
    "resistance": ("1", "Re Z of the whole liner, over rho c"),
    "reactance": ("1", "Im Z of the whole liner, over rho c"),
    "resistance_low": ("1", "lower bound of the statistical interval"),
    "resistance_high": ("1", "upper bound of the statistical interval"),
    "reactance_low": ("1", "lower bound of the statistical interval"),
    "reactance_high": ("1", "upper bound of the statistical interval"),
    "level_check": ("", "implied over known pressure, and whether that passes"),
    "notes": ("1", "number of warnings, which stand in the map"),
    "status": ("", "done or failed"),
    "error": ("", "why it failed"),
    "seconds": ("s", "of the eduction, the reading of the data apart"),
    "hash": ("", "of data, choices and version"),
    "campaign": ("", "title of the campaign"),
    "version": ("", "of torchliner"),
}
DONE, FAILED = "done", "failed"
TEXT = (
    Column("", "unit", "unit"),
    Column("", "frequency", "f Hz", ".1f"),
    Column("", lambda row: _pair(row, ""), "Z", format_complex),
    Column(
        "",
        lambda row: (_pair(row, "_low"), _pair(row, "_high")),
        "interval",
        lambda ends: format_bounds(None if None in ends else ends),
    ),
    Column("", "level_check", "level check"),
    Column("", "notes", "notes", ".0f"),
    Column("", lambda row: row["error"] or row["status"], "status"),
)

Row = Mapping[str, Any]


def _pair(row: Row, end: str) -> complex | None:
    found = complex(row[f"resistance{end}"], row[f"reactance{end}"])
    return None if math.isnan(found.real) else found


def full_row(**known: Any) -> dict[str, Any]:
    """All columns, those not known as nan or an empty text."""
    usual = {name: math.nan if unit else "" for name, (unit, _) in COLUMNS.items()}
    return usual | {require_choice("column", name, COLUMNS): v for name, v in known.items()}


def index_text(rows: Sequence[Row]) -> str:
    """For the terminal."""
    return Table(rows, TEXT).as_text()


def write_index(rows: Sequence[Row], folder: Path, title: str, version: str) -> None:
    """``index.csv`` of a folder."""
    about = {"campaign": title, "version": version}
    known = [{name: None if _is_nan(value) else value for name, value in (dict(row) | about).items()} for row in rows]
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
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file, strict=True))
    try:
        return [{name: _number(row[name]) if COLUMNS[name][0] else row[name] for name in COLUMNS} for row in rows]
    except (ValueError, TypeError, csv.Error) as error:
        raise ValueError(f"{path} is damaged: {error}; run the campaign again") from error


def _number(text: str) -> float:
    return float(text) if text else math.nan


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)


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
