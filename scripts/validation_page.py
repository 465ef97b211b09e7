"""Everything in docs/validation.md: all rules on all resolved cases, and why they miss.

    python scripts/validation_page.py [-o FOLDER] [--rows FILE]

Rows and pictures go to docs/figures, the tables into docs/validation.md; with another folder, there alone. ``--rows``
takes the rows from a CSV instead of computing them again, which takes minutes.
"""

import csv
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scipy.optimize import brentq

import torchliner as tl
from common import DATA, FIGURES, ROOT, options_of, page_table, parser_of, planes_of, publish
from studies.limits import hole_velocity, reach, speed_that_gives
from studies.validation import DEFAULT, median_error, validate, validation_row
from studies.validation_figures import FASTEST, draw_reach, draw_validation_errors
from torchliner.io.result_writers import write_rows
from torchliner.names import AVERAGINGS
from torchliner.report.table import format_complex, table_of
from torchliner.studies.variants import Row

PAGE = ROOT / "docs" / "validation.md"
GROUPS = {
    "to 130 dB": ("n115", "n130", "o115", "o130", "t00_130"),  # without flow
    "145 dB": ("n145", "o145"),
    "flow": ("g01_145", "g03_145", "t03_130", "t015_145"),
}
CASES = ("n115", "n130", "n145", "g01_145", "g03_145", "o115", "o130", "o145", "t00_130", "t03_130", "t015_145")
REASONED = tuple(case for case in CASES if case != "t00_130")  # whose record is too short for them
COLUMNS = "case height drive mean phase averaging educed true in_situ low high error level_check speed".split()
COLUMNS += "velocity_rms mach incident_level periods".split()
CHECKED = "phase-locked"  # the averaging whose level check the page shows
PAIRS = ("for_resistance", "for_reactance", "factor", "contraction")


def liner_of(case: str) -> Any:
    """The preset that stands for a case."""
    return tl.load_liner(planes_of(case)[0].liner)


def rows_of(case: str, planes: Sequence[tl.VelocityPlane] | None = None) -> list[Row]:
    """All rules of a case beside its reference and the in situ value (Dean, pressure first)."""
    several = planes_of(case) if planes is None else planes
    rows = [row for plane in several for row in validate(plane, liner_of(case))]
    found = tl.in_situ(tl.read_pressure(DATA / f"pressure_{case}.h5"), allow_short=True)
    dean = complex(found.liner["pressure-first"].impedance[0])
    return [Row(row, in_situ=dean) for row in rows]


def read_rows(path: Path) -> list[Row]:
    """Rows of an earlier run, from their CSV."""
    found = []
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            known: dict[str, Any] = {name: row[name] for name in ("case", "averaging")}
            for name in ("educed", "true", "in_situ"):
                known[name] = complex(float(row[f"{name}_resistance"]), float(row[f"{name}_reactance"]))
            for name in ("low", "high"):
                known[name] = complex(float(row[f"resistance_{name}"]), float(row[f"reactance_{name}"]))
            for name in ("height", "level_check", "speed", "velocity_rms", "mach", "incident_level", "periods"):
                known[name] = float(row[name])
            found.append(validation_row((row["drive"], row["mean"], row["phase"]), **known))
    return found


def write_rule_rows(rows: Sequence[Row], path: Path) -> None:
    """As CSV, to six digits."""
    write_rows(table_of([{name: row[name] for name in COLUMNS} for row in rows]).as_rows(), path, ".6g")


def reason_of(case: str) -> Row:
    """Why the rules miss: the velocity of the case's own holes put through the model, and what that can return at all.

    Returns:
        case, true: name; reference Z, normalised.
        speed: rms velocity in the holes times the porosity, m/s: the model's |v|.
        replayed, self_consistent, of_rms: Z educed from that velocity: default rules, with the phase that the tone in
            it sets, and from its rms.
        for_resistance, for_reactance: rms of a constant |v| and of a sine that give the reference R (X), m/s; None
            where none does.
        nearest: to the reference, of all that |v(t)| up to ``FASTEST`` gives with the phase averaged.
        factor: on the velocity of the holes that gives the reference R, replayed and as an rms; None where none from
            0.2 to 10 does.
        contraction: contraction coefficient that does, likewise, from 0.05 to 1.
    """
    record, liner = tl.read_pressure(DATA / f"pressure_{case}.h5"), liner_of(case)
    true, f, holes = complex(record.reference["true"]), record.frequency, hole_velocity(record)
    assert f is not None

    def educed(model: Any = liner, **choices: Any) -> complex:
        return complex(tl.educe(holes, model, interval=None, averaging="admittance", **choices).answer[0])

    def speeds(value: float, part: str) -> list[float | None]:
        return [speed_that_gives(liner, f, value, part, shape, FASTEST) for shape in ("constant", "sine")]

    def that_gives(name: str, low: float, high: float) -> list[float | None]:
        found: list[float | None] = []
        for drive in ("instantaneous", "rms"):

            def excess(value: float, drive: str = drive) -> float:
                return educed(liner.replace(**{name: value}), drive=drive).real - true.real

            crossed = excess(low) * excess(high) <= 0
            found.append(float(brentq(excess, low, high, xtol=1e-4)) if crossed else None)
        return found

    return Row(
        case=case,
        true=true,
        speed=float(holes.velocity.square().mean().sqrt()),
        replayed=educed(),
        self_consistent=educed(phase="self-consistent"),
        of_rms=educed(drive="rms"),
        for_resistance=speeds(true.real, "real"),
        for_reactance=speeds(true.imag, "imag"),
        nearest=reach(liner, f, FASTEST).nearest(true),
        factor=that_gives("velocity_gain", 0.2, 10.0),
        contraction=that_gives("vena_contracta", 0.05, 1.0),
    )


def rule_table(rows: Sequence[Row]) -> str:
    """Median |dR|, |dX| of the rules that differ, by groups of cases."""
    groups = [[row for row in rows if row.case in cases] for cases in GROUPS.values()]
    shown = {
        f"instantaneous, {DEFAULT[2]}": DEFAULT,
        "instantaneous, self-consistent": ("instantaneous", "kept", "self-consistent"),
        **{drive: (drive, "kept", DEFAULT[2]) for drive in ("rms", "running-rms")},
    }
    lines = []
    for words, rule in shown.items():
        for averaging in AVERAGINGS:
            cells = [median_error(group, rule, averaging) for group in groups]
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


def reason_tables(reasons: Sequence[Row]) -> dict[str, str]:
    """The holes' own velocity put through the model, and what would give the reference; how near the model comes."""

    def pair(values: Sequence[float | None]) -> str:
        return ", ".join("none" if v is None else f"{v:.3f}" for v in values)

    replays, needs = [], []
    for row in (row for row in reasons if not row.case.endswith("115")):
        z = {name: format_complex(value) for name, value in row.items() if isinstance(value, complex)}
        p = {name: pair(row[name]) for name in PAIRS}
        educed = [z[name] for name in ("replayed", "self_consistent", "of_rms", "true")]
        replays.append([row.case, f"{row.speed:.3f}", *educed, p["factor"], p["contraction"]])
        needs.append([row.case, p["for_resistance"], p["for_reactance"], z["true"], z["nearest"]])
    head = "case | rms (m/s) | replayed | self-consistent | of the rms | reference Z | speed × | C_vc"
    limits = "case | for R: constant, sine | for X: constant, sine | reference Z | nearest Z"
    return {"reasons": page_table(head, replays), "limits": page_table(limits, needs)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute, print, write."""
    parser = parser_of(__doc__, FIGURES)
    parser.add_argument("--rows", type=Path, help="the rows as CSV")
    options = options_of(parser, arguments)
    rows = read_rows(options.rows) if options.rows else [row for case in CASES for row in rows_of(case)]
    reasons, folder = [reason_of(case) for case in REASONED], options.output
    draw_validation_errors(rows, folder / "validation_errors.png")
    write_rule_rows(rows, folder / "validation_errors.csv")
    models = (("slit", "n115", "ng"), ("orifice", "o115", "o"), ("coarser lattice", "t03_130", "t"))
    panels = {title: (liner_of(name), [r for r in reasons if r.case[0] in letters]) for title, name, letters in models}
    draw_reach(panels, folder / "validation_reach.png")
    rows = read_rows(folder / "validation_errors.csv")  # so that the tables follow from the file
    tables = {"default": default_table(rows), "rules": rule_table(rows), **reason_tables(reasons)}
    publish(tables, folder, PAGE.name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
