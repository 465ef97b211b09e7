"""Differences of two maps as a table."""

from __future__ import annotations

from typing import Any

from torchliner.report.table import Column, Table, format_bounds, format_complex, plain_columns
from torchliner.studies.rows import Row, Study


def _bounds(row: Row) -> Any:
    return None if row.low is None else (row.low, row.high)


TEXT = (
    Column("", "place", "place"), Column("", "x", "x mm", ".2f", 1e3),
    Column("", "z", "z mm", ".2f", 1e3), Column("", "frequency", "f Hz", ".1f"),
    Column("", "first", "Z, first", format_complex),
    Column("", "second", "Z, second", format_complex),
    Column("", "difference", "difference", format_complex),
    Column("", _bounds, "interval", format_bounds), Column("", "differs_in", "differs in"),
)  # fmt: skip
PLAIN = plain_columns("place x z frequency first* second* difference* low* high* differs_in")


def comparison_table(found: Study) -> Table:
    """Columns of text, CSV and JSON."""
    return Table(found.rows, (*TEXT, *PLAIN))


def format_comparison(found: Study) -> str:
    """One row a place and frequency; what the interval is."""
    note = f"second less first, averaging {found.averaging}; {found.words}"
    return f"{comparison_table(found).as_text()}\n{note}"
