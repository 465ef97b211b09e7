"""The validation table: every rule beside the reference impedance of resolved cases. No favourite."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from torchliner.names import AVERAGINGS, PHASES
from torchliner.report.table import (
    Column,
    Table,
    format_complex,
    format_pair,
    format_range,
    plain_columns,
)
from torchliner.studies.rows import Row
from torchliner.studies.validate import DEFAULT, errors_by_rule

TOLERABLE = 0.1  # share of |Z_true| beyond which the table says that a rule fails
COLUMNS = plain_columns(
    "case height drive mean phase averaging educed* true* in_situ* low* high* error level_check speed "
    "velocity_rms mach incident_level periods"
)


def drive_label(drive: str, mean: str) -> str:
    """'instantaneous' or 'instantaneous, mean removed'."""
    return drive + (", mean removed" if mean == "removed" else "")


def plain_truth(rows: Sequence[Row]) -> Table:
    """For CSV and JSON: complex values as two numbers."""
    return Table(rows, COLUMNS)


def _by_phase(cells: Iterable[tuple[Row, complex]], written: Callable[[Any], str]) -> str:
    """One line per height (if the cells have one), drive and averaging; one column per phase rule."""
    lines: dict[tuple[Any, ...], dict[str, Any]] = {}
    for cell, value in cells:
        key = (cell.get("height"), drive_label(cell.drive, cell.mean), cell.averaging)
        line = lines.setdefault(key, dict(zip(("height", "drive", "averaging"), key, strict=True)))
        line[cell.phase] = value
    columns = [Column("", "drive", "drive"), Column("", "averaging", "averaging"),
               *(Column("", phase, phase, written) for phase in PHASES)]  # fmt: skip
    if any(height is not None for height, *_ in lines):
        columns.insert(0, Column("", "height", "y mm", ".1f", 1e3))
    return Table(list(lines.values()), columns).as_text()


def format_rules(rows: Sequence[Row]) -> str:
    """Median |dR| and |dX| of every rule over all planes given."""
    found = errors_by_rule(rows)
    head = f"median |dR|, |dX| (rho c) of each rule; planes: {found[0].planes}"
    return f"{head}\n{_by_phase(((each, each.median) for each in found), format_pair)}"


def format_truth(rows: Sequence[Row]) -> str:
    """One text table per case: Z by height, drive, averaging and phase rule."""
    return "\n\n".join(
        f"case {mine[0].case}: reference Z = {format_complex(mine[0].true)} (normalised)\n"
        f"{_by_phase(((row, row.educed) for row in mine), format_complex)}"
        for mine in _by_case(rows)
    )


def _by_case(rows: Sequence[Row]) -> list[list[Row]]:
    return [[row for row in rows if row.case == case]
            for case in dict.fromkeys(row.case for row in rows)]  # fmt: skip


def _case_summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Of one case: errors of the default rules over the heights, of the best and worst rule."""
    true, within = abs(rows[0].true), []
    summary: dict[str, Any] = {"case": rows[0].case, "|Z_true|": true}
    for averaging in AVERAGINGS:
        errors = [row.error for row in rows if row.rule == DEFAULT and row.averaging == averaging]
        summary[f"default, {averaging}"] = format_range(min(errors), max(errors))
        within += [error < TOLERABLE * true for error in errors]
    failed = f"FAILS in {within.count(False)} of {len(within)}"
    return summary | {
        "best of all": min(row.error for row in rows),
        "worst of all": max(row.error for row in rows),
        "periods": rows[0].periods,
        "default": "holds" if all(within) else failed,
    }


def format_summary(rows: Sequence[Row]) -> str:
    """Per case: the error of the default rules over the heights, and of the best and worst rule."""
    summaries = [_case_summary(mine) for mine in _by_case(rows)]
    columns = [
        Column(name, heading=name, text=".3f" if isinstance(value, float) else "")
        for name, value in summaries[0].items()
    ]
    return "\n".join([
        "|Z - Z_true| over all heights (rho c)",
        Table(summaries, columns).as_text(),
        f"(FAILS: off by more than {100 * TOLERABLE:g} % of |Z_true|. Default: phase averaged, instantaneous |v|, mean "
        "kept; every averaging at every height is counted. 'given' is the phase of the reference wave, which only a "
        "simulation knows)",
    ])  # fmt: skip
