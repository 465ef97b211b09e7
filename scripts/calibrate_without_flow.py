"""Calibrate without flow, predict with flow: the tables and the picture of the page of that name.

    python scripts/calibrate_without_flow.py [--write]

The contraction coefficient alone is fitted, to the resistance of cases without flow (their reactance counts
with the error of the model, see docs/truth.md); the linear part is that of each preset, a run at
115 dB on the same lattice. Then every case is predicted in every averaging at every
height. ``--write`` puts the tables into docs/calibrate_without_flow.md and the picture, with its
numbers, into docs/figures.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torchliner as tl
from common import FIGURES, RESULTS, ROOT, case_files, options_of, parser_of
from studies.without_flow import draw_without_flow
from torchliner.names import AVERAGINGS
from torchliner.report.table import format_complex, table_of
from torchliner.studies.rows import Row
from truth_page import page_table, write_tables

PAGE, FOLDER = ROOT / "docs" / "calibrate_without_flow.md", RESULTS / "calibrate_without_flow"
STEM = "calibrate_without_flow"
NOISE = 0.002 + 0.1j  # two ways of measuring one case differ by 0.002; X is the model's error
FREE = {"vena_contracta": (0.2, 1.0)}
RULE = "phase-locked"


@dataclass(frozen=True)
class Fit:
    """Cases without flow that one contraction coefficient is fitted to, and those it predicts."""

    name: str
    fitted: tuple[str, ...]
    predicted: tuple[str, ...]


FITS = (
    Fit("orifice", ("o130",), ("o145",)),
    Fit("orifice, coarser lattice", ("t00_130",), ("t03_130", "t015_145")),
    Fit("slit", ("n130",), ("n145", "g01_145", "g03_145")),
)


def planes_of(case: str) -> list[tl.VelocityPlane]:
    """Shipped planes of a case, the lowest first."""
    return [tl.read_plane(path) for path in case_files(case)]


def calibrated(fit: Fit) -> Any:
    """The calibration at the lowest height, in the averaging whose predictions are asked for."""
    planes = [planes_of(case)[0] for case in fit.fitted]
    liner = tl.load_liner(planes[0].liner)
    return tl.calibrate(planes, liner, "true", FREE, averaging=RULE, noise=NOISE, allow_short=True)


def rows_of(fit: Fit, found: Any) -> list[Row]:
    """Every case of a fit, averaging and height, before and after."""
    rows = []
    for case in (*fit.fitted, *fit.predicted):
        for plane in planes_of(case):
            before, after = (
                tl.educe(plane, liner, interval=None, allow_short=True)
                for liner in (tl.load_liner(plane.liner), found.liner)
            )
            about = {"model": fit.name, "case": case, "fitted": case in fit.fitted, "height": plane.height or 0.0}
            for averaging in after.averagings:
                both = (complex(each.liner[averaging].impedance[0]) for each in (before, after))
                values = dict(zip(("before", "after"), both, strict=True), true=complex(plane.reference["true"]))
                rows.append(Row(about, averaging=averaging, level_check=level_check_of(after, averaging), **values))
    return rows


def level_check_of(found: tl.ImpedanceMap, averaging: str) -> float:
    """dB, of the whole plane; nan where it was not checked."""
    check = found.level_check
    return float("nan") if check is None else float(check.liner.level[check.averagings.index(averaging), 0])


def fit_table(fits: Sequence[tuple[Fit, Any]]) -> str:
    """What was fitted to what."""
    lines = [
        [fit.name, ", ".join(fit.fitted), f"{float(found.values[0]):.3f}", f"{float(found.standard[0]):.3f}"]
        for fit, found in fits
    ]
    return page_table("model | fitted to | contraction coefficient | ±", lines)


def rows_by_case(rows: Sequence[Row]) -> list[list[Row]]:
    """Rows of each case."""
    return [[row for row in rows if row.case == case] for case in dict.fromkeys(r.case for r in rows)]


def prediction_table(rows: Sequence[Row]) -> str:
    """Per case at its lowest height: before, then every averaging after."""
    lines = []
    for mine in rows_by_case(rows):
        here = {row.averaging: row for row in mine if row.height == mine[0].height}
        rule = here[RULE]
        lines.append(
            [
                f"{rule.case}{', fitted' if rule.fitted else ''}",
                format_complex(rule.true),
                format_complex(rule.before),
                *(format_complex(here[each].after) for each in AVERAGINGS),
            ]
        )
    return page_table(f"case | reference Z | {RULE}, 0.8 | {' | '.join(AVERAGINGS)}", lines)


def height_table(rows: Sequence[Row]) -> str:
    """Per case that was not fitted, over its heights: by how much R is off, and the level check."""
    lines = []
    for mine in rows_by_case([row for row in rows if row.averaging == RULE and not row.fitted]):
        shares = [100 * (row.after.real / row.true.real - 1) for row in mine]
        lines.append(
            [
                mine[0].case,
                ", ".join(f"{1e3 * row.height:g}" for row in mine),
                ", ".join(f"{round(share) + 0:+d}" for share in shares),
                ", ".join(f"{row.level_check:+.2f}" for row in mine),
            ]
        )
    return page_table("case | y (mm) | R off by (%) | level check (dB)", lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit, predict, print, draw."""
    parser = parser_of(__doc__)
    parser.add_argument("--write", action="store_true", help="into docs/ as well")
    options = options_of(parser, arguments)
    FOLDER.mkdir(parents=True, exist_ok=True)
    fits = [(fit, calibrated(fit)) for fit in FITS]
    rows = [row for fit, found in fits for row in rows_of(fit, found)]
    tables = {"fits": fit_table(fits), "predictions": prediction_table(rows), "heights": height_table(rows)}
    for name, text in tables.items():
        print(f"\n{name}\n{text}")
    folders: list[Path] = [FOLDER, *([FIGURES] if options.write else [])]
    for folder in folders:
        table_of(rows, "").write_csv(folder / f"{STEM}.csv")
        draw_without_flow(rows, folder / f"{STEM}.png")
    if options.write:
        write_tables(PAGE, tables)
    print(f"\nNumbers and picture are in {FOLDER}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
