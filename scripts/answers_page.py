"""Validation of every shipped case with what a user may know, and the study of the turbulence without the sound.

    python scripts/answers_page.py [--write | --check]

Each liner is calibrated on runs without flow; then every case is answered by the preset, by the calibrated liner, with
the run without sound, and by the level. ``--write`` puts tables into docs/validation.md and docs/background.md,
pictures and their numbers into docs/figures. ``--check`` only fits the curve of the share of the incoherent velocity
against the velocity ratio again, and fails where the package states another.
"""

from __future__ import annotations

import functools
import math
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.optimize import brentq

import torchliner as tl
from common import DATA, FIGURES, RESULTS, ROOT, case_files, options_of, parser_of
from studies.answers_figures import draw_background, draw_parity
from studies.share_curve import curve_of, differs, fit_curve, scatter_of
from torchliner.conversions import impedance_from_reflection
from torchliner.engine.drives import incoherent_square, phase_locked
from torchliner.io.csv_rows import write_rows
from torchliner.report.table import format_complex
from torchliner.studies.calibrate import calibrate_without_flow
from torchliner.velocity.averages import Asked, average
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import measure, reading_of
from torchliner.velocity.sound import likely_share
from validation_page import page_table, write_tables

FOLDER = RESULTS / "answers"
FITTED = {"n": ("n115", "n130"), "o": ("o115", "o130"), "t": ("t00_130",)}  # by the letter of a lattice
LATTICE = {"g": "n", "q": "t"}
CASES = (
    "n115",
    "n130",
    "n145",
    "g01_145",
    "g03_145",
    "o115",
    "o130",
    "o145",
    "t00_130",
    "t03_130",
    "t015_145",
    "q01_140",
    "q02_140",
    "q02_145",
)
FLOWS = ("t03_130", "t015_145", "q01_140", "q02_140", "q02_145")
SLITS = ("g01_145", "g03_145")  # with flow, in two dimensions
FRICTION = {0.1: 1.56, 0.15: 2.25, 0.2: 2.91, 0.3: 4.21}  # m/s, by Mach number; data/README.md
HEIGHTS = (0.5e-3, 1.0e-3)
COLUMNS = ("preset", "calibrated", "background", "matched")
NEAR_R, NEAR_X = 0.15, 0.1


def planes_of(case: str, heights: Sequence[float] = HEIGHTS) -> list[tl.VelocityPlane]:
    """Shipped planes of a case at some heights, m."""
    planes = [tl.read_plane(path) for path in case_files(case)]
    return [plane for plane in planes if any(abs((plane.height or 0) / h - 1) < 0.01 for h in heights)]


def quiet_of(case: str) -> list[tl.VelocityPlane]:
    """The planes without sound of its flow, none where there are none."""
    flow = {"t03": "q03", "t015": "q015"}.get(case.split("_")[0], case.split("_")[0]) + "h" * case.endswith("h")
    return [tl.read_plane(path) for path in sorted(DATA.glob(f"quiet_{flow}_y*.h5"))]


@functools.cache
def liner_of(case: str) -> Any:
    """Calibrated on the runs without flow of its lattice, at 0.5 mm."""
    letter = LATTICE.get(case[0], case[0])
    runs = [planes_of(each)[0] for each in FITTED[letter]]
    return calibrate_without_flow(runs, tl.load_liner(runs[0].liner), allow_short=True)[0].liner


def check_of(found: tl.ImpedanceMap) -> float:
    """Of the answer, dB."""
    check = found.level_check
    return math.nan if check is None else float(check.liner.level[check.averagings.index(found.averaging), 0])


def row_of(case: str, plane: tl.VelocityPlane) -> dict[str, Any]:
    """Every answer to one plane."""
    about: Any = {"allow_short": True, "interval": None}
    quiet, liner = quiet_of(case), liner_of(case)
    preset = tl.educe(plane, tl.load_liner(plane.liner), **about)
    own = tl.educe(plane, liner, level_matched=True, **about)
    best = tl.educe(plane, liner, background=quiet, **about) if quiet else own
    matched = own.level_matched
    answers = {
        "preset": complex(preset.answer[0]),
        "calibrated": complex(own.answer[0]),
        "background": complex(best.answer[0]) if quiet else complex(math.nan, math.nan),
        "matched": complex(math.nan, math.nan) if matched is None else complex(matched.impedance[0]),
        "true": complex(plane.reference["true"]),
    }
    row: dict[str, Any] = {
        "case": case,
        "fitted": int(any(case in each for each in FITTED.values())),
        "height": plane.height,
        "mach": plane.mach,
        "velocity_ratio": own.choices["velocity_ratio"] or math.nan,
        "share": math.nan if matched is None else float(matched.share[0]),
        "level_check": check_of(best),
    }
    for name, value in answers.items():
        row |= {f"{name}_resistance": value.real, f"{name}_reactance": value.imag}
    return row


def value_of(row: dict[str, Any], name: str) -> complex:
    """Z of a column."""
    return complex(row[f"{name}_resistance"], row[f"{name}_reactance"])


def answer_table(rows: Sequence[dict[str, Any]]) -> str:
    """Every answer, those fitted marked, and the level check of the last prediction."""
    lines = []
    for row in rows:
        cells = [format_complex(z) if z == z else "-" for z in (value_of(row, name) for name in COLUMNS)]
        if row["fitted"]:
            cells[1] += " *"
        passes = "passes" if abs(row["level_check"]) <= 0.3 else "fails"
        lines.append(
            [
                row["case"],
                f"{1e3 * row['height']:.1f}",
                format_complex(value_of(row, "true")),
                *cells,
                f"{row['level_check']:+.2f} {passes}",
            ]
        )
    return page_table(
        "case | y (mm) | reference Z | preset | calibrated | with the quiet run | level-matched | level check (dB)",
        lines,
    )


def score_table(rows: Sequence[dict[str, Any]]) -> str:
    """How many planes that were not fitted come out within 15 % in R and 0.1 in X, and what the level check says."""
    lines = []
    for height in HEIGHTS:
        mine = [row for row in rows if abs(row["height"] / height - 1) < 0.01 and not row["fitted"]]
        cells = []
        for name in COLUMNS:
            there = [row for row in mine if value_of(row, name) == value_of(row, name)]
            misses = [(value_of(row, name), value_of(row, "true")) for row in there]
            right = sum(abs(z.real / true.real - 1) <= NEAR_R for z, true in misses)
            near = sum(abs(z.imag - true.imag) <= NEAR_X for z, true in misses)
            cells.append(f"{right}, {near} of {len(there)}")
        lines.append([f"{1e3 * height:.1f}", *cells])
    return page_table("y (mm) | preset | calibrated | with the quiet run | level-matched", lines)


def check_words(rows: Sequence[dict[str, Any]]) -> str:
    """What the level check said of the last prediction of every plane."""
    right = [abs(prediction_of(row).real / value_of(row, "true").real - 1) <= NEAR_R for row in rows]
    passes = [abs(row["level_check"]) <= 0.3 for row in rows]
    both = sum(a and b for a, b in zip(right, passes, strict=True))
    wrong = sum(a and not b for a, b in zip(passes, right, strict=True))
    missed = sum(a and not b for a, b in zip(right, passes, strict=True))
    text = (
        f"Of {len(rows)} planes {sum(passes)} pass the check with the calibrated liner, and the quiet run where there "
        f"is one: {both} of them have R within 15 %, {wrong} have not. Of the {len(rows) - sum(passes)} that fail, "
        f"{missed} have R within 15 % all the same."
    )
    return textwrap.fill(text, 120)


def prediction_of(row: dict[str, Any]) -> complex:
    """With the quiet run where there is one, else calibrated."""
    z = value_of(row, "background")
    return z if z == z else value_of(row, "calibrated")


# The study: which rms without sound acts.


def needed_rms(plane: tl.VelocityPlane, liner: Any) -> tuple[float, float]:
    """rms of the incoherent velocity that gives the reference R, and that of the record, m/s."""
    asked, chosen = torch.tensor([plane.frequency], dtype=torch.float64), Choices(interval=None)
    reading = reading_of(plane, [liner], asked, chosen, projected=True)
    known = measure(reading)
    own = float(incoherent_square(known.survey, known.membership).mean().sqrt())
    every = torch.ones(plane.probes, dtype=torch.float64)

    def miss(share: float) -> float:
        moments = reading.with_drive(known, phase_locked(known.survey, known.membership, share * every))
        found = average(moments, Asked.of(moments, liner, asked, chosen), "phase-locked")
        return float(impedance_from_reflection(found.replicates[0, 0, 0]).real) - plane.reference["true"].real

    return own * float(brentq(miss, 0.1, 3.0, xtol=1e-3)), own


def needed_rows() -> list[dict[str, Any]]:
    """Of every case with flow in three dimensions and every height."""
    rows = []
    for case in (*FLOWS, "q02_140h", "q02_145h"):
        for path in case_files(case):
            plane = tl.read_plane(path)
            needed, own = needed_rms(plane, liner_of(case))
            quiet = rms_at(case, plane.height or 0.0)
            rows.append(
                {
                    "case": case,
                    "height": plane.height,
                    "mach": plane.mach,
                    "diameters": (plane.height or 0) / liner_of(case).hole_diameter,
                    "needed": needed,
                    "own": own,
                    "quiet": quiet,
                }
            )
    return rows


def share_rows() -> list[dict[str, Any]]:
    """Share of the incoherent velocity that gives the reference R at 0.5 mm, of every case with flow, by the ratio."""
    rows = []
    for case in (*FLOWS, *SLITS):
        (plane,) = planes_of(case, HEIGHTS[:1])
        found = tl.educe(plane, liner_of(case), averaging="phase-locked", interval=None)
        needed, own = needed_rms(plane, liner_of(case))
        rows.append(
            {
                "case": case,
                "dimensions": 2 if case in SLITS else 3,
                "velocity_ratio": found.choices["velocity_ratio"],
                "share": needed / own,
            }
        )
    return sorted(rows, key=lambda row: row["velocity_ratio"])


def share_table(rows: Sequence[dict[str, Any]]) -> str:
    """The cases beside the curve of the package."""
    lines = [
        [
            row["case"],
            str(row["dimensions"]),
            f"{row['velocity_ratio']:.3f}",
            f"{row['share']:.2f}",
            f"{likely_share(row['velocity_ratio']):.2f}",
        ]
        for row in rows
    ]
    return page_table("case | dimensions | VR | share that gives the reference R | curve", lines)


def share_words(rows: Sequence[dict[str, Any]]) -> str:
    """The fit that the package states, and that to all cases."""
    weak, strong, scatter = curve_of(rows)
    ends = fit_curve(rows)
    return (
        f"three dimensions: 1 up to {weak:.4f}, 1/2 from {strong:.4f}; all cases scatter by {scatter:.3f} about it\n"
        f"all cases: 1 up to {ends[0]:.4f}, 1/2 from {ends[1]:.4f}; they scatter by {scatter_of(rows, *ends):.3f}"
    )


def rms_at(case: str, height: float) -> float:
    """rms without sound at a height, m/s; nan between those stored."""
    for plane in quiet_of(case):
        if abs((plane.height or 0) / height - 1) < 0.01:
            return float(fluctuation(plane).square().mean().sqrt())
    return math.nan


def fluctuation(plane: tl.VelocityPlane) -> torch.Tensor:
    """v less its mean, (z, x, T)."""
    velocity = plane.velocity.double()
    return velocity - velocity.mean(-1, keepdim=True)


def below(plane: tl.VelocityPlane, limit: float) -> float:
    """rms below a frequency, Hz."""
    spectrum = torch.fft.rfft(fluctuation(plane))
    spectrum[..., torch.fft.rfftfreq(plane.samples, 1 / plane.sampling_rate) > limit] = 0
    return float(torch.fft.irfft(spectrum, n=plane.samples).square().mean().sqrt())


def over_hole(plane: tl.VelocityPlane, diameter: float) -> float:
    """rms of the mean over a disc of the size of a hole, anywhere on a periodic plane."""
    step = float(torch.unique(plane.x).diff().median())
    rows, columns = plane.probe_shape
    z, x = np.meshgrid(*(step * np.fft.fftfreq(n, 1 / n) for n in (rows, columns)), indexing="ij")
    disc = torch.from_numpy((np.hypot(x, z) <= diameter / 2).astype(float))
    disc = torch.fft.fft2(disc / disc.sum())
    mean = torch.fft.ifft2(torch.fft.fft2(fluctuation(plane), dim=(0, 1)) * disc[..., None], dim=(0, 1))
    return float(mean.real.square().mean().sqrt())


def interpolated(case: str, of: Callable[[tl.VelocityPlane], float], height: float) -> float:
    """A number of two quiet planes at a height between them."""
    low, high = quiet_of(case)
    share = (height - (low.height or 0)) / ((high.height or 0) - (low.height or 0))
    return of(low) + share * (of(high) - of(low))


def candidate_table(rows: Sequence[dict[str, Any]]) -> str:
    """Needed rms at 0.5 mm over what might stand for it."""
    needed = {row["case"]: row for row in rows if abs(row["height"] - 5e-4) < 1e-6}
    diameter = liner_of("t03_130").hole_diameter

    def whole(plane: tl.VelocityPlane) -> float:
        return float(fluctuation(plane).square().mean().sqrt())

    candidates: dict[str, Callable[[str], float]] = {
        "rms of the record itself": lambda case: needed[case]["own"],
        "rms without sound, 0.41 d": lambda case: interpolated(case, whole, 5e-4),
        "rms without sound, 0.5 d": lambda case: interpolated(case, whole, diameter / 2),
        "rms without sound, 0.83 d": lambda case: interpolated(case, whole, 1e-3),
        "the same below 4 kHz, 0.5 d": lambda case: interpolated(case, lambda p: below(p, 4e3), diameter / 2),
        "the same below 8 kHz, 0.5 d": lambda case: interpolated(case, lambda p: below(p, 8e3), diameter / 2),
        "mean over a hole, 0.41 d": lambda case: interpolated(case, lambda p: over_hole(p, diameter), 5e-4),
        "mean over a hole, 0.83 d": lambda case: interpolated(case, lambda p: over_hole(p, diameter), 1e-3),
        "half the friction velocity": lambda case: FRICTION[needed[case]["mach"]] / 2,
    }
    lines = []
    for name, of in candidates.items():
        ratios = [needed[case]["needed"] / of(case) for case in FLOWS]
        spread = math.sqrt(max(ratios) / min(ratios)) - 1
        lines.append([name, *(f"{each:.2f}" for each in ratios), f"±{100 * spread:.0f} %"])
    return page_table(" | ".join(["needed rms over", *FLOWS, "spread"]), lines)


def rule_table() -> str:
    """R off by, with each quiet plane at the height of the run and with the rms at half a diameter."""
    lines = []
    for case in (*FLOWS, "q02_140h", "q02_145h"):
        flow = case.removesuffix("h")
        for path in case_files(case):
            plane = tl.read_plane(path)
            if (plane.height or 0) > 1.1e-3:
                continue
            same = [each for each in quiet_of(case) if abs((each.height or 0) / (plane.height or 1) - 1) < 0.01]
            cells = []
            for background in (None, same[0], quiet_of(flow)):
                found = tl.educe(plane, liner_of(case), background=background, interval=None)
                off = complex(found.answer[0]).real / plane.reference["true"].real - 1
                cells.append(f"{100 * off:+.0f}")
            diameters = (plane.height or 0) / liner_of(case).hole_diameter
            lines.append([case, f"{1e3 * (plane.height or 0):g}, {diameters:.2f}", *cells])
    return page_table(
        "case | y (mm, d) | as recorded (%) | quiet rms of that height (%) | of half a diameter (%)", lines
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute, print, write."""
    parser = parser_of(__doc__)
    parser.add_argument("--write", action="store_true", help="into docs/ as well")
    parser.add_argument("--check", action="store_true", help="the curve of the velocity ratio alone")
    options = options_of(parser, arguments)
    shares = share_rows()
    print(f"{share_table(shares)}\n{share_words(shares)}")
    for fault in differs(shares):
        print(fault, file=sys.stderr)
    if options.check:
        return int(bool(differs(shares)))
    FOLDER.mkdir(parents=True, exist_ok=True)
    rows = [row_of(case, plane) for case in CASES for plane in planes_of(case)]
    needed = needed_rows()
    tables = {
        "answers": answer_table(rows),
        "scores": score_table(rows),
        "checked": check_words(rows),
        "rule": rule_table(),
        "candidates": candidate_table(needed),
        "shares": share_table(shares),
    }
    for name, text in tables.items():
        print(f"\n{name}\n{text}")
    folders: list[Path] = [FOLDER, *([FIGURES] if options.write else [])]
    for folder in folders:
        write_rows(rows, folder / "parity.csv", ".5g")
        draw_parity(rows, folder / "parity.png")
        write_rows(needed, folder / "background.csv", ".5g")
        write_rows(shares, folder / "velocity_ratio.csv", ".5g")
        draw_background(needed, folder / "background.png")
    if options.write:
        for page in ("validation.md", "background.md"):
            write_tables(ROOT / "docs" / page, tables)
    return 0


if __name__ == "__main__":
    sys.exit(main())
