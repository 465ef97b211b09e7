"""The index of a campaign: a row a unit and frequency, as CSV and as netCDF-4."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from torchliner.checks import require_choice
from torchliner.io.csv_rows import write_rows
from torchliner.io.hdf5 import (
    open_file,
    read_si,
    read_texts,
    text_attribute,
    write_index,
    write_texts,
    write_variable,
)
from torchliner.io.tables import FileKind
from torchliner.report.table import Column, Table, format_bounds, format_complex

STEM = "torchliner campaign "
KIND = FileKind(f"{STEM}1", "index of a campaign", {"title": "", "version": ""})
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
}
DONE, FAILED = "done", "failed"
TEXT = (
    Column("", "unit", "unit"),
    Column("", "frequency", "f Hz", ".1f"),
    Column("", lambda row: _pair(row, ""), "Z", format_complex),
    Column("", lambda row: (_pair(row, "_low"), _pair(row, "_high")), "interval",
           lambda ends: format_bounds(None if None in ends else ends)),
    Column("", "level_check", "level check"),
    Column("", "notes", "notes", ".0f"),
    Column("", lambda row: row["error"] or row["status"], "status"),
)  # fmt: skip

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


def write_index_files(rows: Sequence[Row], folder: Path, title: str, version: str) -> None:
    """``index.csv`` and ``index.nc`` of a folder."""
    write_rows(
        [{name: row[name] if not _is_nan(row[name]) else None for name in COLUMNS} for row in rows],
        folder / "index.csv",
    )
    with KIND.created(folder / "index.nc", SimpleNamespace(title=title, version=version)) as file:
        write_index(file, "row", len(rows))
        for name, (unit, words) in COLUMNS.items():
            values = [row[name] for row in rows]
            if unit:
                write_variable(file, name, np.array(values, dtype=np.float64), unit, ("row",))
            else:
                write_texts(file, name, values, "row")
            file[name].attrs["long_name"] = words


def read_index(folder: Path) -> tuple[list[dict[str, Any]], str, str]:
    """Rows, title and version of ``index.nc`` in a folder.

    Raises:
        ValueError: the folder has no index; that of another version; a damaged one.
    """
    path = folder / "index.nc"
    if not path.exists():
        raise ValueError(f"{folder} holds no index.nc; it is the folder of no campaign (torchliner "
                         "run writes one)")  # fmt: skip
    require_readable_index(folder)
    with open_file(path) as file:
        KIND.require(file, path)
        head = KIND.read_head(file, path)
        columns = {
            name: read_si(file, name, unit, path).tolist() if unit else read_texts(file, name, path)
            for name, (unit, _) in COLUMNS.items()
        }
    if len({len(values) for values in columns.values()}) != 1:
        raise ValueError(f"{path} is damaged: its columns have different lengths")
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return rows, head["title"], head["version"]


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)


def require_readable_index(folder: Path) -> None:
    """Refuse a folder that another version of this package keeps, or whose index is none.

    Raises:
        ValueError: it is.
    """
    path = folder / "index.nc"
    if not path.exists():
        return
    with open_file(path) as file:
        found = text_attribute(file, "schema") or ""
    if found.startswith(STEM) and found != KIND.schema:
        raise ValueError(
            f"{path} has the format {found!r}, and this torchliner writes {KIND.schema!r}; name "
            "another --output, or take the torchliner that wrote it"
        )
    if found != KIND.schema:
        raise ValueError(f"{path} is no index of a campaign but {found!r}; name another --output")
