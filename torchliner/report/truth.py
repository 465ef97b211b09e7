"""The truth table: every rule beside the true impedance of resolved cases. No favourite."""

from __future__ import annotations

from collections.abc import Sequence

from torchliner.audits.truth_rows import DEFAULT, DRIVES, PHASES, TruthRow, errors_by_rule
from torchliner.names import ORDERS
from torchliner.report.table import format_complex

TOLERABLE = 0.1  # share of |Z_true| beyond which the table says that a rule fails


def drive_label(drive: str, mean: str) -> str:
    """'instantaneous' or 'instantaneous, mean removed'."""
    return drive + (", mean removed" if mean == "removed" else "")


def format_rules(rows: Sequence[TruthRow]) -> str:
    """Median |dR| and |dX| of every rule over all planes given: drive and order x phase."""
    found = {(e.drive, e.mean, e.order, e.phase): e for e in errors_by_rule(rows)}
    planes = next(iter(found.values())).planes
    lines = [f"median |dR|, |dX| (rho c) of each rule; planes: {planes}"]
    lines.append(f"{'':46s}" + "".join(f"{phase:>18s}" for phase in PHASES))
    for drive, mean in DRIVES:
        for order in ORDERS:
            cells = [found[drive, mean, order, phase].median for phase in PHASES]
            texts = "".join(f"{f'{c.real:.3f}, {c.imag:.3f}':>18s}" for c in cells)
            lines.append(f"{drive_label(drive, mean):30s}{order:16s}" + texts)
    return "\n".join(lines)


def format_truth(rows: Sequence[TruthRow]) -> str:
    """A text table: a line per case, height and drive; columns phase rule x order."""
    lines = []
    heading = "".join(f"{phase:^30s}" for phase in PHASES)
    orders = "".join(f"{order:>15s}" for order in ORDERS) * len(PHASES)
    previous = ""
    for first in range(0, len(rows), len(PHASES) * len(ORDERS)):
        group = rows[first : first + len(PHASES) * len(ORDERS)]
        row = group[0]
        if row.case != previous:
            lines += ["", f"case {row.case}: true Z = {format_complex(row.true)} (normalised)"]
            lines += [f"{'':30s}{heading}", f"{'y mm':>5s}  {'drive':23s}{orders}"]
            previous = row.case
        label = drive_label(row.drive, row.mean)
        values = "".join(f"{format_complex(cell.educed):>15s}" for cell in group)
        lines.append(f"{1e3 * row.height:5.1f}  {label:28s}"[:35].ljust(30) + values)
    return "\n".join(lines).lstrip("\n")


def format_summary(rows: Sequence[TruthRow]) -> str:
    """Per case: the error of the default rules over the heights, and of the best and worst rule."""
    lines = ["|Z - Z_true| over all heights (rho c)"]
    heading = (
        "default, probes first",
        "default, velocity first",
        "best of all",
        "worst of all",
        "default",
    )
    lines.append(f"{'case':10s}{'|Z_true|':>9s}" + "".join(f"{h:>25s}" for h in heading))
    for case in dict.fromkeys(row.case for row in rows):
        mine = [row for row in rows if row.case == case]
        cells, within = [], []
        for order in ORDERS:
            errors = [row.error for row in mine if row.rule == DEFAULT and row.order == order]
            cells.append(f"{min(errors):.3f} to {max(errors):.3f}")
            within += [error < TOLERABLE * abs(mine[0].true) for error in errors]
        cells += [f"{f(row.error for row in mine):.3f}" for f in (min, max)]
        cells.append("holds" if all(within) else f"FAILS in {within.count(False)} of {len(within)}")
        lines.append(f"{case:10s}{abs(mine[0].true):9.3f}" + "".join(f"{c:>25s}" for c in cells))
    lines.append(
        f"(FAILS: off by more than {100 * TOLERABLE:g} % of |Z_true|. Default: phase averaged, "
        "instantaneous |v|, mean kept; both orders at every height are counted)"
    )
    best = [
        (row.case, row)
        for case in dict.fromkeys(row.case for row in rows)
        for row in [min((r for r in rows if r.case == case), key=lambda r: r.error)]
    ]
    for case, row in best:
        lines.append(
            f"best for {case}: y = {1e3 * row.height:g} mm, {drive_label(row.drive, row.mean)}, "
            f"{row.phase}, {row.order}, {format_complex(row.educed)} for {format_complex(row.true)}"
        )
    lines.append(
        "(The best is named with hindsight; 'given' uses the phase of the true wave. n115 and o115 "
        "fix the models' linear part and test little. No one rule is best for all cases.)"
    )
    return "\n".join(lines)
