"""Verification of the duct solvers as text and CSV."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torchliner.report.table import Column, Table

COLUMNS = (
    Column("flow", heading="flow"),
    Column("degree", heading="p", text="d"),
    Column("columns"),
    Column("rows"),
    Column("", lambda row: f"{row['columns']} x {row['rows']}", "mesh"),
    Column("unknowns", heading="unknowns", text="d"),
    Column("error", heading="error of p", text=".2e"),
    Column("order", heading="order", text=".2f"),
)


def order_table(rows: Sequence[dict[str, Any]]) -> Table:
    """One row per flow, degree and mesh."""
    return Table(rows, COLUMNS)


def format_verification(table: Table, checks: Sequence[dict[str, Any]]) -> str:
    """``order_table``, then one line per check."""
    lines = [table.as_text(), ""]
    for check in checks:
        word = "holds" if check["passed"] else "FAILS"
        lines.append(f"{word}: {check['check']} {check['value']:.2e} (limit {check['limit']:.0e})")
    return "\n".join(lines)
