"""One law of lost mass for all resolved cases: the tables and the picture of the page of that name.

    python scripts/mass_loss.py [--write]

The contraction coefficient of each model is fitted to its resistance without flow, as in
``calibrate_without_flow.py``; here the reactance alone is fitted, at y = 0.5 mm, with coefficients
shared by slit and orifice. Every law is judged on cases that it was not fitted to. ``--write`` puts
the tables into docs/mass_loss.md and the picture, with its numbers, into docs/figures.
"""

from __future__ import annotations

import csv
import functools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import calibrate_without_flow as without_flow
import torchliner as tl
from calibrate_without_flow import FITS, calibrated
from common import FIGURES, RESULTS, ROOT, options_of, parser_of
from studies.mass_loss_figure import LossRow, draw_mass_loss
from torchliner.io.csv_rows import write_rows
from torchliner.liners.sdof import EndLossSDoFLiner
from torchliner.names import AVERAGINGS
from torchliner.report.table import format_complex
from truth_page import page_table, write_tables

PAGE, FOLDER, STEM = ROOT / "docs" / "mass_loss.md", RESULTS / "mass_loss", "mass_loss"
CASES = tuple(case for fit in FITS for case in (*fit.fitted, *fit.predicted))
FLOW = tuple(case for case in CASES if case[0] == "g" or case.startswith(("t03", "t015")))
SLITS = tuple(case for case in CASES if case[0] in "ng")
RULE = "phase-locked"
REACTANCE_ALONE = 1e3 + 0.05j  # standard uncertainty of R and X: R has no say
B, K, A = {"loss_displacement": (0.01, 10.0)}, {"mach_loss": (0.0, 3.0)}, {"end_loss": (0.0, 1.0)}


@dataclass(frozen=True)
class Law:
    """A law of lost mass: what is fitted, what is fixed.

    Args:
        name: in tables.  free: bounds by name.  fixed: other parameters.
        width: whether a slit's length is its width, not its hydraulic diameter.
        goodrich: whether flow leaves 1/(1 + 305 M^3) of the ends (Rice & Heidelberg), in place of k M.
    """

    name: str
    free: Mapping[str, tuple[float, float]]
    fixed: Mapping[str, Any]
    width: bool = False
    goodrich: bool = False


LAWS = (
    Law("eq. (2.4b) of the paper", {}, {}),
    Law("in \\|v\\|: A, B", A | B, {"mach_loss": 0.0}),
    Law("in M: k", K, {"end_loss": 0.0}),
    Law("both, p = 2: B, k; A = 1/2", B | K, {}),
    Law("the same, p = 1", B | K, {"combination": 1.0}),
    Law("the same, p = 4", B | K, {"combination": 4.0}),
    Law("the same, p = 2, A free", A | B | K, {}),
    Law("the same, A = 1/2, width of the slit for D_h", B | K, {}, width=True),
    Law("the same, Goodrich's ends for k M", B, {}, goodrich=True),
)
CHOSEN = LAWS[3]


@functools.cache
def planes_of(case: str) -> list[tl.VelocityPlane]:
    """Shipped planes of a case, the lowest first."""
    return without_flow.planes_of(case)


@functools.cache
def base_liners() -> dict[str, tl.SDoFLiner]:
    """By case: the preset with the contraction coefficient of a case without flow."""
    return {case: liner for fit in FITS for liner in (calibrated(fit).liner,) for case in (*fit.fitted, *fit.predicted)}


@functools.cache
def moments_of(case: str, averaging: str) -> tuple[Any, ...]:
    """Of all heights, the lowest first."""
    return tuple(
        tl.moments(plane, averaging=averaging, cell_pitch=base_liners()[case].cell_pitch, allow_short=True)
        for plane in planes_of(case)
    )


def liner_of(case: str, law: Law) -> tl.SDoFLiner:
    """The law's liner of a case, before a fit."""
    base = base_liners()[case]
    if law is LAWS[0]:
        return base
    twice = 2 if case in SLITS and not law.width else 1
    mach = planes_of(case)[0].mach or 0.0
    flow = {"mach_loss": 305 * mach**2 / (1 + 305 * mach**3)} if law.goodrich else {}
    return EndLossSDoFLiner.of(
        base,
        hydraulic_diameter=twice * base.orifice_diameter,
        **law.fixed,
        **flow,
    )


def fitted(law: Law, cases: Sequence[str], averaging: str = RULE) -> Any:
    """The calibration of a law by the reactance of some cases, 0.5 mm above the plate."""
    return tl.calibrate(
        [moments_of(case, averaging)[0] for case in cases],
        [liner_of(case, law) for case in cases],
        "true",
        dict(law.free),
        averaging=averaging,
        noise=REACTANCE_ALONE,
        allow_short=True,
    )


def predicted(law: Law, found: Any, case: str, averaging: str = RULE, height: int = 0) -> complex:
    """Z of a case by what was fitted."""
    liner = liner_of(case, law)
    if found is not None:
        liner = liner.with_numbers(found.numbers)
    educed = tl.educe(moments_of(case, averaging)[height], liner, interval=None, averaging=averaging, allow_short=True)
    return complex(educed.liner[averaging].impedance[0])


def truth(case: str) -> complex:
    """Z of the run itself."""
    return complex(planes_of(case)[0].reference["true"])


def left_out(law: Law, groups: Sequence[Sequence[str]], averaging: str = RULE) -> dict[str, complex]:
    """Z of every case of some groups, each by a fit to all cases but its group."""
    found: dict[str, complex] = {}
    for group in groups:
        rest = [case for case in CASES if case not in group]
        fit = fitted(law, rest, averaging) if law.free else None
        found |= {case: predicted(law, fit, case, averaging) for case in group}
    return found


def rows_of_laws() -> list[LossRow]:
    """Each law, fitted to all cases but the one that is predicted."""
    singles = [(case,) for case in CASES]
    return [
        LossRow(law.name, case, educed, truth(case)) for law in LAWS for case, educed in left_out(law, singles).items()
    ]


def read_rows(path: Path) -> list[LossRow]:
    """Rows of an earlier run."""
    with path.open(newline="") as file:
        return [LossRow.of_plain(row) for row in csv.DictReader(file)]


def largest_and_rms(away: Sequence[float]) -> list[str]:
    """Of what X is off by."""
    return [f"{max(map(abs, away)):.2f}", f"{np.sqrt(np.mean(np.square(away))):.3f}"]


def law_table(rows: Sequence[LossRow]) -> str:
    """X off by, predicted, case by case, of the laws up to the one that is chosen."""
    laws = [law.name for law in LAWS[: LAWS.index(CHOSEN) + 1]]
    away = {law: [row.predicted.imag - row.true.imag for row in rows if row.law == law] for law in laws}
    lines = [[case, *(f"{away[law][i]:+.2f}" for law in laws)] for i, case in enumerate(CASES)]
    ends = zip(*(largest_and_rms(away[law]) for law in laws), strict=True)
    lines += [[name, *end] for name, end in zip(("largest", "rms"), ends, strict=True)]
    heads = " | ".join(laws).replace("\\|v\\|", "speed")  # a bar would end the column
    return page_table(f"case | {heads}", lines)


def variant_table(rows: Sequence[LossRow]) -> str:
    """Of the chosen law's variants, and of it in the other averagings."""
    lines = []
    for law in LAWS[LAWS.index(CHOSEN) + 1 :]:
        away = [row.predicted.imag - row.true.imag for row in rows if row.law == law.name]
        lines.append([law.name.removeprefix("the same, "), *largest_and_rms(away)])
    for averaging in list(AVERAGINGS)[:2]:
        found = left_out(CHOSEN, [(case,) for case in CASES], averaging)
        away = [found[case].imag - truth(case).imag for case in CASES]
        lines.append([averaging, *largest_and_rms(away)])
    return page_table("but | largest | rms", lines)


def fit_table() -> str:
    """The chosen law, fitted to all cases and to parts of them."""
    without = [case for case in CASES if case not in FLOW]
    parts = {
        "all nine": CASES,
        "the slits": SLITS,
        "the orifices": [case for case in CASES if case not in SLITS],
        "no flow, and t03_130": [*without, "t03_130"],
        "no flow, and g01_145": [*without, "g01_145"],
    }
    lines = []
    for name, cases in parts.items():
        fit = fitted(CHOSEN, cases)
        away = [abs(predicted(CHOSEN, fit, case).imag - truth(case).imag) for case in CASES if case not in cases]
        values = [f"{v:.2f} ± {s:.2f}" for v, s in zip(fit.values, fit.standard, strict=True)]
        lines.append([name, *values, f"{max(away):.2f}" if away else "-"])
    return page_table("fitted to | B | k | X of the others off by", lines)


def height_table() -> str:
    """Cases with flow at every stored height, and where R would be right."""
    fit, lines = fitted(CHOSEN, CASES), []
    for case in FLOW:
        planes, true = planes_of(case), truth(case)
        diameter = float(liner_of(case, CHOSEN).numbers()["hydraulic_diameter"].value)
        heights = np.array([plane.height for plane in planes])
        found = [predicted(CHOSEN, fit, case, height=i) for i in range(len(planes))]
        shares = np.array([z.real / true.real - 1 for z in found])
        (turns,) = np.nonzero(np.diff(np.sign(shares)))
        right = [heights[i] - shares[i] * (heights[i + 1] - heights[i]) / (shares[i + 1] - shares[i]) for i in turns]
        words = ", ".join(f"{1e3 * y:.2f} mm, {y / diameter:.2f} D_h" for y in right)
        below = "none: too high everywhere" if bool((shares > 0).all()) else "-"
        lines.append(
            [
                case,
                ", ".join(f"{1e3 * y:g}" for y in heights),
                ", ".join(f"{100 * share:+.0f}" for share in shares),
                ", ".join(f"{z.imag - true.imag:+.2f}" for z in found),
                words or below,
            ]
        )
    return page_table("case | y (mm) | R off by (%) | X off by | R right at", lines)


def wave_table() -> str:
    """Cases without flow from the level of the wave alone, at the rms of the velocity it drives."""
    fit, lines = fitted(CHOSEN, CASES), []
    values = fit.numbers
    for case in (case for case in CASES if case not in FLOW):
        plane, true = planes_of(case)[0], truth(case)
        liners = liner_of(case, LAWS[0]), liner_of(case, CHOSEN).with_numbers(values)
        paper, law = (
            complex(curve.fixed_points[0][0].impedance[0])
            for liner in liners
            for curve in (tl.ir_tdibc(liner, [plane.incident_level], 1400.0, kernel="periodic"),)
        )
        lines.append([case, *map(format_complex, (true, paper, law))])
    return page_table("case | reference Z | eq. (2.4b) | this law", lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit, leave out, print, draw."""
    parser = parser_of(__doc__)
    parser.add_argument("--write", action="store_true", help="into docs/ as well")
    options = options_of(parser, arguments)
    FOLDER.mkdir(parents=True, exist_ok=True)
    write_rows([row.plain() for row in rows_of_laws()], FOLDER / f"{STEM}.csv", ".5g")
    rows = read_rows(FOLDER / f"{STEM}.csv")  # so that the table follows from the file
    tables = {
        "laws": law_table(rows),
        "fits": fit_table(),
        "variants": variant_table(rows),
        "heights": height_table(),
        "waves": wave_table(),
    }
    for name, text in tables.items():
        print(f"\n{name}\n{text}")
    for folder in (FOLDER, *([FIGURES] if options.write else [])):
        write_rows([row.plain() for row in rows], folder / f"{STEM}.csv", ".5g")
        draw_mass_loss(rows, [LAWS[0].name, LAWS[1].name, CHOSEN.name], folder / f"{STEM}.png")
    if options.write:
        write_tables(PAGE, tables)
    print(f"\nNumbers and picture are in {FOLDER}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
