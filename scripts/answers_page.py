"""Validation of every shipped case with what a user may know, and the study of the turbulence without the sound.

    python scripts/answers_page.py [-o FOLDER | --check]

Each liner is calibrated on runs without flow; then every case is answered by the preset, by the calibrated liner, with
the run without sound, and by the level. Tables go into docs/validation.md and docs/background.md, pictures and their
numbers into docs/figures; with another folder, there alone. ``--check`` only fits the curve of the share of the
incoherent velocity against the velocity ratio again, and fails where this file states another.
"""

import functools
import math
import sys
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from scipy.optimize import brentq, brute

import torchliner as tl
from common import DATA, FIGURES, options_of, page_table, parser_of, planes_of, publish
from studies.answers_figures import draw_background, draw_parity
from torchliner.conversions import impedance_from_reflection
from torchliner.engine.drives import incoherent_square, phase_locked
from torchliner.io.result_writers import write_rows
from torchliner.report.table import format_complex, table_of
from torchliner.studies.calibrate import calibrate_without_flow
from torchliner.studies.variants import Row
from torchliner.velocity.averages import average
from torchliner.velocity.background import SCATTER, STRONG, WEAK, likely_share
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import reading_of, take_moments

Rows = Sequence[dict[str, Any]]
FITTED = {"n": ("n115", "n130"), "o": ("o115", "o130"), "t": ("t00_130",)}  # by the letter of a lattice
LATTICE = {"g": "n", "q": "t"}
FLOWS = ("t03_130", "t015_145", "q01_140", "q02_140", "q02_145")
RAISED = ("q02_140h", "q02_145h")  # on a finer lattice
SLITS = ("g01_145", "g03_145")  # with flow, in two dimensions
CASES = ("n115", "n130", "n145", *SLITS, "o115", "o130", "o145", "t00_130", *FLOWS)
HEIGHTS = (0.5e-3, 1.0e-3)
COLUMNS = ("preset", "calibrated", "background", "matched")
NEAR_R, NEAR_X, PASSES = 0.15, 0.1, 0.3  # dB
NEAR = 0.02  # relative, of the curve's constants, which have two digits


def near(plane: Any, height: float) -> bool:
    """Whether a plane, or a row of one, is at a height, m."""
    return abs((plane.height or 0) / height - 1) < 0.01


def quiet_of(case: str) -> list[tl.VelocityPlane]:
    """The planes without sound of its flow, none where there are none."""
    flow = {"t03": "q03", "t015": "q015"}.get(case.split("_")[0], case.split("_")[0]) + "h" * case.endswith("h")
    return [tl.read_plane(path) for path in sorted(DATA.glob(f"quiet_{flow}_y*.h5"))]


@functools.cache
def liner_of(case: str) -> Any:
    """Calibrated on the runs without flow of its lattice, at 0.5 mm."""
    runs = [planes_of(each)[0] for each in FITTED[LATTICE.get(case[0], case[0])]]
    return calibrate_without_flow(runs, tl.load_liner(runs[0].liner), allow_short=True)[0].liner


def row_of(case: str, plane: tl.VelocityPlane) -> Row:
    """Every answer to one plane; nan where there is none."""
    about: Any = {"allow_short": True, "interval": None}
    quiet, liner = quiet_of(case), liner_of(case)
    preset = tl.educe(plane, tl.load_liner(plane.liner), **about)
    own = tl.educe(plane, liner, level_matched=True, **about)
    best = tl.educe(plane, liner, background=quiet, **about) if quiet else own
    check, matched, unknown = best.level_check, own.level_matched, complex(math.nan, math.nan)
    return Row(
        case=case,
        fitted=int(any(case in each for each in FITTED.values())),
        height=plane.height,
        mach=plane.mach,
        velocity_ratio=own.choices["velocity_ratio"] or math.nan,
        share=math.nan if matched is None else float(matched.share[0]),
        level_check=math.nan if check is None else float(check.liner.level[check.averagings.index(best.averaging), 0]),
        preset=complex(preset.answer[0]),
        calibrated=complex(own.answer[0]),
        background=complex(best.answer[0]) if quiet else unknown,
        matched=unknown if matched is None else complex(matched.impedance[0]),
        true=complex(plane.reference["true"]),
    )


def right(row: Row, name: str) -> bool:
    """Whether R of a column is within 15 %."""
    return abs(row[name].real / row.true.real - 1) <= NEAR_R


def answer_tables(rows: Sequence[Row]) -> dict[str, str]:
    """Every answer, those fitted marked, and the level check of the last prediction; how many of the planes that were
    not fitted come out within 15 % in R and 0.1 in X; what the level check says of the last prediction."""
    lines, scores = [], []
    for row in rows:
        cells = [format_complex(z) if z == z else "-" for z in (row[name] for name in COLUMNS)]
        cells[1] += " *" * row["fitted"]
        verdict = f"{row['level_check']:+.2f} {'passes' if abs(row['level_check']) <= PASSES else 'fails'}"
        true = format_complex(row.true)
        lines.append([row["case"], f"{1e3 * row['height']:.1f}", true, *cells, verdict])
    for height in HEIGHTS:
        mine, cells = [row for row in rows if near(row, height) and not row["fitted"]], []
        for name in COLUMNS:
            there = [row for row in mine if row[name] == row[name]]
            close = sum(abs(row[name].imag - row.true.imag) <= NEAR_X for row in there)
            cells.append(f"{sum(right(row, name) for row in there)}, {close} of {len(there)}")
        scores.append([f"{1e3 * height:.1f}", *cells])
    last = ["background" if row.background == row.background else "calibrated" for row in rows]
    found = [(right(row, name), abs(row["level_check"]) <= PASSES) for row, name in zip(rows, last, strict=True)]
    passed, both, missed = sum(passes for _, passes in found), found.count((True, True)), found.count((True, False))
    words = (
        f"Of {len(rows)} planes {passed} pass the check with the calibrated liner, and the quiet run where there "
        f"is one: {both} of them have R within 15 %, {passed - both} have not. Of the {len(rows) - passed} that fail, "
        f"{missed} have R within 15 % all the same."
    )
    head = "preset | calibrated | with the quiet run | level-matched"
    return {
        "answers": page_table(f"case | y (mm) | reference Z | {head} | level check (dB)", lines),
        "scores": page_table(f"y (mm) | {head}", scores),
        "checked": textwrap.fill(words, 120),
    }


# The study: which rms without sound acts.


def needed_rms(plane: tl.VelocityPlane, liner: Any) -> tuple[float, float]:
    """rms of the incoherent velocity that gives the reference R, and that of the record, m/s."""
    asked, chosen = torch.tensor([plane.frequency], dtype=torch.float64), Choices(interval=None)
    reading = reading_of(plane, [liner], asked, chosen, projected=True)
    known = take_moments(reading, reviewed=False)
    own = float(incoherent_square(known.survey, known.membership).mean().sqrt())
    every = torch.ones(plane.probes, dtype=torch.float64)

    def miss(share: float) -> float:
        moments = reading.with_drive(known, phase_locked(known.survey, known.membership, share * every))
        found = average(moments, liner, asked, chosen, "phase-locked")
        return float(impedance_from_reflection(found.replicates[0, 0, 0]).real) - plane.reference["true"].real

    return own * float(brentq(miss, 0.1, 3.0, xtol=1e-3)), own


def needed_rows() -> list[dict[str, Any]]:
    """Of every case with flow in three dimensions and every height."""
    rows = []
    for case in (*FLOWS, *RAISED):
        for plane in planes_of(case):
            needed, own = needed_rms(plane, liner_of(case))
            about = {"case": case, "height": plane.height, "mach": plane.mach, "diameters": diameters_of(case, plane)}
            silent = [each.velocity.double() for each in quiet_of(case) if near(each, plane.height or 0.0)]
            rms = float(silent[0].var(-1, correction=0).mean().sqrt()) if silent else math.nan
            rows.append(about | {"needed": needed, "own": own, "quiet": rms})
    return rows


def diameters_of(case: str, plane: tl.VelocityPlane) -> float:
    """Height over the diameter of a hole."""
    return float((plane.height or 0) / liner_of(case).hole_diameter)


def share_rows() -> list[dict[str, Any]]:
    """Share of the incoherent velocity that gives the reference R at 0.5 mm, of every case with flow, by the ratio."""
    rows = []
    for case in (*FLOWS, *SLITS):
        (plane,) = (plane for plane in planes_of(case) if near(plane, HEIGHTS[0]))
        ratio = tl.educe(plane, liner_of(case), averaging="phase-locked", interval=None).choices["velocity_ratio"]
        needed, own = needed_rms(plane, liner_of(case))
        dimensions = 2 if case in SLITS else 3
        rows.append({"case": case, "dimensions": dimensions, "velocity_ratio": ratio, "share": needed / own})
    return sorted(rows, key=lambda row: row["velocity_ratio"])


def share_table(rows: Rows) -> str:
    """The cases beside the curve."""
    lines = []
    for row in rows:
        numbers = f"{row['velocity_ratio']:.3f}", f"{row['share']:.2f}", f"{likely_share(row['velocity_ratio']):.2f}"
        lines.append([row["case"], str(row["dimensions"]), *numbers])
    return page_table("case | dimensions | VR | share that gives the reference R | curve", lines)


def curve_of(rows: Rows, *fitted: int) -> tuple[float, float, float]:
    """Velocity ratios at which the share leaves 1 and reaches a half, by least squares over the cases of ``fitted``
    dimensions, and the standard deviation of all cases about that curve."""

    def misses(some: Rows, low: float, high: float) -> np.ndarray:
        return np.array([row["share"] - likely_share(row["velocity_ratio"], low, high) for row in some])

    def squares(ends: np.ndarray) -> float:
        low, width = math.exp(ends[0]), math.exp(abs(ends[1]))
        return float((misses([row for row in rows if row["dimensions"] in fitted], low, low * width) ** 2).sum())

    low, width = brute(squares, ((math.log(0.02), math.log(0.5)), (1e-3, math.log(20))), Ns=60)
    weak, strong = math.exp(low), math.exp(low + abs(width))
    return weak, strong, math.sqrt(float((misses(rows, weak, strong) ** 2).sum()) / (len(rows) - 2))


def differs(rows: Rows) -> list[str]:
    """The constants of the curve that are not those of the fit to the cases in three dimensions."""
    stated = {"WEAK": WEAK, "STRONG": STRONG, "SCATTER": SCATTER}
    return [
        f"{name} is {value:g}, the fit gives {found:.4g}; state that"
        for (name, value), found in zip(stated.items(), curve_of(rows, 3), strict=True)
        if abs(value / found - 1) > NEAR
    ]


def rule_table() -> str:
    """R off by, with each quiet plane at the height of the run and with the rms at half a diameter."""
    lines = []
    for case in (*FLOWS, *RAISED):
        for plane in (plane for plane in planes_of(case) if (plane.height or 0) <= 1.1e-3):
            same = next(each for each in quiet_of(case) if near(each, plane.height or 1))
            cells = []
            for background in (None, same, quiet_of(case.removesuffix("h"))):
                found = tl.educe(plane, liner_of(case), background=background, interval=None)
                cells.append(f"{100 * (complex(found.answer[0]).real / plane.reference['true'].real - 1):+.0f}")
            lines.append([case, f"{1e3 * (plane.height or 0):g}, {diameters_of(case, plane):.2f}", *cells])
    head = "case | y (mm, d) | as recorded (%) | quiet rms of that height (%) | of half a diameter (%)"
    return page_table(head, lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute, print, write."""
    parser = parser_of(__doc__, FIGURES)
    parser.add_argument("--check", action="store_true", help="the curve of the velocity ratio alone")
    options = options_of(parser, arguments)
    shares = share_rows()
    print(share_table(shares))
    for words, fitted in (("three dimensions", (3,)), ("all cases", (2, 3))):
        weak, strong, scatter = curve_of(shares, *fitted)
        print(f"{words}: 1 up to {weak:.4f}, 1/2 from {strong:.4f}; all cases scatter by {scatter:.3f} about it")
    for fault in differs(shares):
        print(fault, file=sys.stderr)
    if options.check:
        return int(bool(differs(shares)))
    rows = [row_of(case, p) for case in CASES for p in planes_of(case) if any(near(p, height) for height in HEIGHTS)]
    needed = needed_rows()
    tables = answer_tables(rows) | {"rule": rule_table(), "shares": share_table(shares)}
    files: dict[str, Rows] = {"parity": rows, "background": needed, "velocity_ratio": shares}
    for name, some in files.items():
        write_rows(table_of(some).as_rows(), options.output / f"{name}.csv", ".5g")
    draw_parity(rows, options.output / "parity.png")
    draw_background(needed, options.output / "background.png")
    publish(tables, options.output, "validation.md", "background.md")
    return 0


if __name__ == "__main__":
    sys.exit(main())
