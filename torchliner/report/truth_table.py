"""The truth table: every rule beside the true impedance of resolved cases. No favourite."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from torchliner.audits.truth_rows import DEFAULT, PHASES, RuleErrors, TruthRow, errors_by_rule
from torchliner.names import ORDERS
from torchliner.report.table import (
    Column,
    Table,
    format_complex,
    format_pair,
    format_range,
    plain_columns,
)

TOLERABLE = 0.1  # share of |Z_true| beyond which the table says that a rule fails
COLUMNS = plain_columns(
    "case height drive mean phase order educed* true* in_situ* low* high* error"
)


def drive_label(drive: str, mean: str) -> str:
    """'instantaneous' or 'instantaneous, mean removed'."""
    return drive + (", mean removed" if mean == "removed" else "")


def plain_truth(rows: Sequence[TruthRow]) -> Table:
    """For CSV and JSON: complex values as two numbers."""
    return Table(rows, COLUMNS)


def _by_phase(
    cells: Iterable[tuple[TruthRow | RuleErrors, complex]], written: Callable[[Any], str]
) -> str:
    """One line per height (if the cells have one), drive and order; one column per phase rule."""
    lines: dict[tuple[Any, ...], dict[str, Any]] = {}
    for cell, value in cells:
        key = (getattr(cell, "height", None), drive_label(cell.drive, cell.mean), cell.order)
        line = lines.setdefault(key, dict(zip(("height", "drive", "order"), key, strict=True)))
        line[cell.phase] = value
    columns = [Column("", "drive", "drive"), Column("", "order", "order"),
               *(Column("", phase, phase, written) for phase in PHASES)]  # fmt: skip
    if any(height is not None for height, *_ in lines):
        columns.insert(0, Column("", "height", "y mm", ".1f", 1e3))
    return Table(list(lines.values()), columns).as_text()


def format_rules(rows: Sequence[TruthRow]) -> str:
    """Median |dR| and |dX| of every rule over all planes given."""
    found = errors_by_rule(rows)
    head = f"median |dR|, |dX| (rho c) of each rule; planes: {found[0].planes}"
    return f"{head}\n{_by_phase(((each, each.median) for each in found), format_pair)}"


def format_truth(rows: Sequence[TruthRow]) -> str:
    """One text table per case: Z by height, drive, order and phase rule."""
    tables = []
    for case in dict.fromkeys(row.case for row in rows):
        mine = [row for row in rows if row.case == case]
        tables.append(
            f"case {case}: true Z = {format_complex(mine[0].true)} (normalised)\n"
            f"{_by_phase(((row, row.educed) for row in mine), format_complex)}"
        )
    return "\n\n".join(tables)


def _case_summary(rows: Sequence[TruthRow]) -> dict[str, Any]:
    """Of one case: errors of the default rules over the heights, of the best and worst rule."""
    true, within = abs(rows[0].true), []
    summary: dict[str, Any] = {"case": rows[0].case, "|Z_true|": true}
    for order in ORDERS:
        errors = [row.error for row in rows if row.rule == DEFAULT and row.order == order]
        summary[f"default, {order}"] = format_range(min(errors), max(errors))
        within += [error < TOLERABLE * true for error in errors]
    failed = f"FAILS in {within.count(False)} of {len(within)}"
    return summary | {
        "best of all": min(row.error for row in rows),
        "worst of all": max(row.error for row in rows),
        "default": "holds" if all(within) else failed,
    }


def format_summary(rows: Sequence[TruthRow]) -> str:
    """Per case: the error of the default rules over the heights, and of the best and worst rule."""
    cases = [[row for row in rows if row.case == case]
             for case in dict.fromkeys(row.case for row in rows)]  # fmt: skip
    summaries = [_case_summary(mine) for mine in cases]
    columns = [
        Column(name, heading=name, text=".3f" if isinstance(value, float) else "")
        for name, value in summaries[0].items()
    ]
    lines = [
        "|Z - Z_true| over all heights (rho c)",
        Table(summaries, columns).as_text(),
        f"(FAILS: off by more than {100 * TOLERABLE:g} % of |Z_true|. Default: phase averaged, "
        "instantaneous |v|, mean kept; both orders at every height are counted)",
    ]
    for best in (min(mine, key=lambda row: row.error) for mine in cases):
        lines.append(
            f"best for {best.case}: y = {1e3 * best.height:g} mm, "
            f"{drive_label(best.drive, best.mean)}, {best.phase}, {best.order}, "
            f"{format_complex(best.educed)} for {format_complex(best.true)}"
        )
    lines.append(
        "(The best is named with hindsight; 'given' uses the phase of the true wave. n115 and o115 "
        "fix the models' linear part and test little. No one rule is best for all cases.)"
    )
    return "\n".join(lines)
