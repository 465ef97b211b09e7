"""Everything in docs/validation.md: all rules on all resolved cases, and why they miss.

    python scripts/validation_page.py [--write] [--rows FILE]

Rows, tables and pictures go to results/validation. ``--write`` puts rows and pictures into docs/figures,
the tables into docs/validation.md, and the default rules into the package, where ``educe``
and ``audit`` find them. ``--rows`` takes the rows from a CSV instead of computing them again, which
takes minutes.
"""

from __future__ import annotations

import csv
import math
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torchliner as tl
from common import DATA, FIGURES, RESULTS, ROOT, case_files, options_of, parser_of
from studies.validation_figures import ReachPanel, draw_reach, draw_validation_errors
from studies.validation_reasons import Reason, reason_of
from torchliner.io.csv_rows import write_rows
from torchliner.io.whole_file import written_whole
from torchliner.names import AVERAGINGS
from torchliner.report.of_fits import table_of_rules
from torchliner.report.table import format_complex
from torchliner.studies.validation import (
    DEFAULT,
    TABLE,
    errors_by_rule,
    hole_kind,
    validate,
    validation_row,
)
from torchliner.studies.variants import Row

PAGE, FOLDER = ROOT / "docs" / "validation.md", RESULTS / "validation"
KNOWN = ROOT / "torchliner" / "studies" / TABLE
QUIET = ("n115", "n130", "o115", "o130", "t00_130")  # up to 130 dB without flow
LOUD, FLOW = ("n145", "o145"), ("g01_145", "g03_145", "t03_130", "t015_145")
GROUPS = {"to 130 dB": QUIET, "145 dB": LOUD, "flow": FLOW}
CASES = ("n115", "n130", "n145", "g01_145", "g03_145", "o115", "o130", "o145", "t00_130", "t03_130", "t015_145")
REASONED = tuple(case for case in CASES if case != "t00_130")  # whose record is too short for them
MOVING = tuple(case for case in REASONED if not case.endswith("115"))
CHECKED = "phase-locked"  # the averaging whose level check the page shows
PRINTED = 6  # digits of the committed rows


def kind_of(case: str) -> str:
    """'slit' or 'orifice'."""
    return "orifice" if case[0] in "ot" else "slit"


def liner_of(case: str) -> tl.SDoFLiner:
    """The preset that stands for a case."""
    liner = tl.load_liner(planes_of(case)[0].liner)
    assert isinstance(liner, tl.SDoFLiner)
    return liner


def planes_of(case: str) -> list[tl.VelocityPlane]:
    """Shipped planes of a case, lowest first."""
    return [tl.read_plane(path) for path in case_files(case)]


def pressures_of(case: str) -> tl.PressureRecord:
    """Shipped pressures of a case."""
    return tl.read_pressure(DATA / f"pressure_{case}.h5")


def rows_of(case: str, planes: Sequence[tl.VelocityPlane] | None = None) -> list[Row]:
    """All rules of a case beside its reference and the in situ value (Dean, pressure first)."""
    several = planes_of(case) if planes is None else planes
    rows = [row for plane in several for row in validate(plane, liner_of(case))]
    found = tl.in_situ(pressures_of(case), allow_short=True)
    dean = complex(found.liner_impedance_pressure_first[0])
    return [Row(row, in_situ=dean) for row in rows]


def stored_row(row: dict[str, str]) -> Row:
    """The row of such a CSV again."""

    def pair(key: str) -> complex:
        names = [f"{part}_{key}" if key in ("low", "high") else f"{key}_{part}" for part in ("resistance", "reactance")]
        return complex(*(float(row[name]) for name in names))

    rest = ("level_check", "speed", "velocity_rms", "mach", "incident_level", "periods")
    known: dict[str, Any] = {name: pair(name) for name in ("in_situ", "low", "high")} | {
        name: float(row[name]) for name in rest
    }
    rule = (row["drive"], row["mean"], row["phase"])
    known |= {"case": row["case"], "height": float(row["height"]), "averaging": row["averaging"]}
    return validation_row(rule, pair("educed"), pair("true"), **known)


def read_rows(path: Path) -> list[Row]:
    """Rows of an earlier run."""
    with path.open(newline="") as file:
        return [stored_row(row) for row in csv.DictReader(file)]


def write_rule_rows(rows: Sequence[Row], path: Path) -> None:
    """As CSV, to ``PRINTED`` digits."""
    write_rows(
        [
            {k: f"{v:.{PRINTED}g}" if isinstance(v, float) else v for k, v in row.items()}
            for row in table_of_rules(rows).as_rows()
        ],
        path,
    )


def reasons_of(case: str) -> Reason:
    """What the velocity of the case's own holes gives."""
    return reason_of(pressures_of(case), liner_of(case), case)


def table(header: str, lines: Sequence[Sequence[str]]) -> str:
    """Markdown."""
    columns = [part.strip() for part in header.split("|")]
    rule = "|" + "---|" * len(columns)
    return "\n".join(["| " + " | ".join(columns) + " |", rule, *("| " + " | ".join(r) + " |" for r in lines)])


def page_table(header: str, lines: Sequence[Sequence[str]]) -> str:
    """The same with minus signs, at which a browser breaks no value."""
    return re.sub(r"-(?=\d)", "−", table(header, lines))


def rule_table(rows: Sequence[Row]) -> str:
    """Median |dR|, |dX| of the rules that differ, by groups of cases."""
    groups = [[row for row in rows if row.case in cases] for cases in GROUPS.values()]
    found = [{(e.drive, e.mean, e.phase, e.averaging): e for e in errors_by_rule(g)} for g in groups]
    shown = [("instantaneous", "kept", phase) for phase in (DEFAULT[2], "self-consistent")]
    shown += [(drive, "kept", DEFAULT[2]) for drive in ("rms", "running-rms")]
    lines = []
    for rule in shown:
        for averaging in AVERAGINGS:
            cells = [errors[*rule, averaging].median for errors in found]
            words = ", ".join((rule[0], rule[2])) if rule[0] == DEFAULT[0] else rule[0]
            lines.append([words, averaging, *(f"{c.real:.3f}, {c.imag:.3f}" for c in cells)])
    return page_table(" | ".join(["drive, phase", "averaging", *GROUPS]), lines)


def default_table(rows: Sequence[Row]) -> str:
    """Z and level check of the default rules by case and averaging, of the lowest and the highest plane."""
    lines = []
    for case in dict.fromkeys(row.case for row in rows):
        mine = [row for row in rows if row.case == case and row.rule == DEFAULT]
        heights = sorted({row.height for row in mine})
        for height in (heights[0], heights[-1]):
            here = {row.averaging: row for row in mine if row.height == height}
            cells = [format_complex(here[averaging].educed) for averaging in AVERAGINGS]
            gap = here[CHECKED].level_check
            cells.append("-" if math.isnan(gap) else f"{gap:+.2f}")
            lines.append([case, format_complex(mine[0].true), f"{1e3 * height:.1f}", *cells])
    return page_table(f"case | reference Z | y (mm) | {' | '.join(AVERAGINGS)} | dB", lines)


def known_rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The table of the package: what the default rules gave, and where."""
    found = []
    for row in rows:
        if row.rule != DEFAULT:
            continue
        liner = liner_of(row.case)
        found.append(
            {
                "case": row.case,
                "hole": hole_kind(liner.name),
                "height": f"{row.height:.4g}",
                "hole_diameter": f"{liner.hole_diameter:.4g}",
                "porosity": f"{liner.surface_porosity:.4g}",
                "mach": f"{row.mach:g}",
                "incident_level": f"{row.incident_level:g}",
                "speed": f"{row.speed:.3g}",
                "velocity_rms": f"{row.velocity_rms:.3g}",
                "averaging": row.averaging,
                "resistance": f"{row.educed.real:.3f}",
                "reactance": f"{row.educed.imag:.3f}",
                "true_resistance": f"{row.true.real:.3f}",
                "true_reactance": f"{row.true.imag:.3f}",
            }
        )
    return found


def pair_words(pair: tuple[float | None, float | None]) -> str:
    """'0.241, 0.252'."""
    return ", ".join("none" if v is None else f"{v:.3f}" for v in pair)


def reason_table(rows: Sequence[Reason]) -> str:
    """The holes' own velocity put through the model, and what would give the reference R."""
    return page_table(
        "case | rms (m/s) | replayed | self-consistent | of the rms | reference Z | speed × | C_vc",
        [
            [
                r.case,
                f"{r.speed:.3f}",
                *(format_complex(z) for z in (r.replayed, r.self_consistent, r.of_rms, r.true)),
                pair_words(r.factor),
                pair_words(r.contraction),
            ]
            for r in rows
        ],
    )


def limit_table(rows: Sequence[Reason]) -> str:
    """What the model would need, and how near it comes."""
    return page_table(
        "case | for R: constant, sine | for X: constant, sine | reference Z | nearest Z",
        [
            [
                r.case,
                pair_words(r.for_resistance),
                pair_words(r.for_reactance),
                format_complex(r.true),
                format_complex(r.nearest),
            ]
            for r in rows
        ],
    )


def blocks_of(page: str) -> dict[str, str]:
    """The tables of the page by name."""
    return dict(re.findall(r"<!-- table (\w+) -->\n(.*?)\n<!-- end -->", page, re.DOTALL))


def with_tables(page: str, tables: dict[str, str]) -> str:
    """The page with its tables replaced."""

    def replaced(found: re.Match[str]) -> str:
        return f"<!-- table {found[1]} -->\n{tables.get(found[1], found[2])}\n<!-- end -->"

    return re.sub(r"<!-- table (\w+) -->\n(.*?)\n?<!-- end -->", replaced, page, flags=re.DOTALL)


def write_tables(page: Path, tables: dict[str, str]) -> None:
    """The tables into their page, which is whole at any time."""
    with written_whole(page) as temporary:
        text = with_tables(page.read_text(encoding="utf-8"), tables)
        temporary.write_text(text, encoding="utf-8")


def draw(rows: Sequence[Row], reasons: Sequence[Reason], folder: Path) -> None:
    """Both pictures and the numbers behind them."""
    draw_validation_errors(rows, folder / "validation_errors.png")
    write_rule_rows(rows, folder / "validation_errors.csv")
    panels = [
        ReachPanel(title, liner_of(name), 1400.0, [r for r in reasons if r.case[0] in letters])
        for title, name, letters in (
            ("slit", "n115", "ng"),
            ("orifice", "o115", "o"),
            ("coarser lattice", "t03_130", "t"),
        )
    ]
    draw_reach(panels, folder / "validation_reach.png")
    write_rows([row.plain() for row in reasons], folder / "validation_reach.csv")


def everything(rows: Sequence[Row] | None, say: Callable[[str], None]) -> dict[str, str]:
    """Tables by name; numbers and pictures in results/validation."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    if rows is None:
        rows = []
        for case in CASES:
            say(f"{case}: all rules")
            rows += rows_of(case)
    reasons = [reasons_of(case) for case in REASONED]
    draw(rows, reasons, FOLDER)
    rows = read_rows(FOLDER / "validation_errors.csv")  # so that the tables follow from the file
    return {
        "default": default_table(rows),
        "rules": rule_table(rows),
        "reasons": reason_table([row for row in reasons if row.case in MOVING]),
        "limits": limit_table([row for row in reasons if row.case in MOVING]),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute, print, write."""
    parser = parser_of(__doc__)
    parser.add_argument("--write", action="store_true", help="into docs/ as well")
    parser.add_argument("--rows", type=Path, help="the rows as CSV")
    options = options_of(parser, arguments)
    rows = None if options.rows is None else read_rows(options.rows)
    tables = everything(rows, lambda text: print(text, file=sys.stderr))
    for name, text in tables.items():
        print(f"\n{name}\n{text}")
    if options.write:
        for path in FOLDER.glob("validation_*"):
            with written_whole(FIGURES / path.name) as temporary:
                temporary.write_bytes(path.read_bytes())
        write_tables(PAGE, tables)
        write_rows(known_rows(read_rows(FOLDER / "validation_errors.csv")), KNOWN, end="\n")
    print(f"\nNumbers and pictures are in {FOLDER}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
