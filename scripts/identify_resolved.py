"""The response of the resolved liners found from their runs: what docs/identify.md shows.

    python scripts/identify_resolved.py [--write]

Curves and parameters fitted to the true impedances at 0.5 mm, 1400 Hz, in the order coherent first;
what each run is predicted as by a fit to the others. ``--write`` puts the tables into
docs/identify.md and the pictures into docs/figures.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torchliner as tl
from common import FIGURES, RESULTS, ROOT, case_files, options_of, parser_of
from torchliner.identification.leave_out import Candidate
from torchliner.identification.parameter_model import FittedParameters
from torchliner.report.identification_report import draw_identification
from torchliner.report.table import format_complex, format_pair
from truth_page import table, write_tables

PAGE, FOLDER = ROOT / "docs" / "identify.md", RESULTS / "identify_resolved"
REST = 0.01 + 0.01j  # the presets' linear parts are those of runs at 115 dB
WITHIN = 0.15  # of R, asked of the runs with flow
SETS = (
    ("vena_contracta",),
    ("vena_contracta", "mass_loss"),
    ("vena_contracta", "mass_loss_speed"),
)
FLOW = (
    ("mach_resistance",),
    ("mach_mass_loss",),
    ("vena_contracta", "mach_resistance"),
    ("vena_contracta", "mach_mass_loss"),
    ("vena_contracta", "mass_loss", "mass_loss_speed"),
)


@dataclass(frozen=True)
class Study:
    """Runs of one liner, and the models that are compared."""

    name: str
    cases: tuple[str, ...]
    models: tuple[tuple[str, ...], ...]

    @property
    def stem(self) -> str:
        """Of its picture."""
        return "identify_" + self.name.split(",")[0]


STUDIES = (
    Study("orifice", ("o115", "o130", "o145"), SETS),
    Study("coarse orifice, with flow", ("t00_130", "t03_130", "t015_145"), (*SETS, *FLOW[:4])),
    Study("slit, with flow", ("n115", "n130", "n145", "g01_145", "g03_145"), (*SETS, *FLOW)),
)


def identified(study: Study) -> Any:
    """All models of a study, the curve among them."""
    planes = [tl.read_plane(case_files(case)[0]) for case in study.cases]
    return tl.identify(planes, tl.load_liner(planes[0].liner), "true", rest=REST,
                       models=["curve", *study.models], allow_short=True)  # fmt: skip


def values_of(candidate: Candidate) -> str:
    """Parameters found, or nothing."""
    fitted = candidate.fitted
    if not isinstance(fitted, FittedParameters):
        return ""
    both = zip(fitted.values.values(), fitted.standard.values(), strict=True)
    return ", ".join(f"{value:.3g} ± {spread:.1g}" for value, spread in both)


def model_table(study: Study, found: Any) -> str:
    """Models, the one that predicts best first, and R of the runs that it is asked for."""
    lines = []
    for each in found.candidates:
        off = [f"{percent(row):+d} %" for row in each.rows]
        lines.append([each.label, f"{each.error:.3f}", f"{each.fitted.misfit:.1f}",
                      values_of(each), *off])  # fmt: skip
    cases = " | ".join(f"{case}, R off by" for case in study.cases)
    return table(f"model | error left out | misfit/noise | values | {cases}", lines)


def percent(row: Any) -> int:
    """By which R is off."""
    return round(100 * (row.predicted.real / row.true.real - 1)) + 0


def run_table(found: Any) -> str:
    """Of the best model and the best curve: each run without and with it."""
    curve = next(each for each in found.candidates if each.label.startswith("curve"))
    chosen = [found.best, *([curve] if curve is not found.best else [])]
    lines = [
        [row.label, each.label, format_complex(row.true), format_complex(row.predicted),
         format_pair(row.standard), f"{percent(row):+d} %",
         f"{row.predicted.imag - row.true.imag:+.2f}", f"{100 * row.outside:.0f} %",
         format_complex(row.fitted)]
        for each in chosen
        for row in each.rows
    ]  # fmt: skip
    return table(
        "run | model | true | predicted by the others | u(R), u(X) | R off by | X off by | its |v| "
        "unseen by the others | fitted with it".replace("|v|", "speeds"),
        lines,
    )


def flow_table(study: Study, found: Any) -> str:
    """One coefficient of Mach: what it makes of the runs with flow, fitted to them too."""
    wanted = {row for row in study.cases if row[0] == "g"}
    lines = []
    for each in found.candidates:
        if "mach" not in each.label:
            continue
        rows = [row for row in each.rows if row.group in wanted]
        ways = []
        for value in ("fitted", "predicted"):
            away = [getattr(row, value).real / row.true.real - 1 for row in rows]
            ways.append(", ".join(f"{100 * part:+.0f} %" for part in away))
            ways.append(", ".join(f"{getattr(r, value).imag - r.true.imag:+.2f}" for r in rows))
            ways.append("yes" if max(map(abs, away)) <= WITHIN else "no")
        lines.append([each.label, values_of(each), *ways])
    return table(
        "model | values | g01, g03 fitted: R off by | X off by | within 15 %? | predicted by the "
        "others: R off by | X off by | within 15 %?",
        lines,
    )


def speed_table(studies: Sequence[tuple[Study, Any]]) -> str:
    """rms |v| of each run, and what its Z weighs."""
    from torchliner.report.identification_report import seen_table

    lines = [
        [row["label"], f"{row['rms_speed']:.2f}", f"{row['low_speed']:.2f}",
         f"{row['high_speed']:.2f}"]
        for _, found in studies
        for row in seen_table(found).as_rows()
    ]  # fmt: skip
    return table("run | rms speed (m/s) | 5 % of Z below | 95 % below", lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit, leave out, print, draw."""
    parser = parser_of(__doc__)
    parser.add_argument("--write", action="store_true", help="into docs/ as well")
    options = options_of(parser, arguments)
    FOLDER.mkdir(parents=True, exist_ok=True)
    found = [(study, identified(study)) for study in STUDIES]
    tables = {"speeds": speed_table(found), "flow": flow_table(*found[2])}
    for study, each in found:
        name = study.name.split(maxsplit=1)[0].strip(",")
        tables |= {f"{name}_models": model_table(study, each), f"{name}_runs": run_table(each)}
    for name, text in tables.items():
        print(f"\n{name}\n{text}")
    folders: list[Path] = [FOLDER, *([FIGURES] if options.write else [])]
    for folder in folders:
        for study, each in (found[0], found[2]):
            draw_identification(each, folder / f"{study.stem}.png")
    if options.write:
        write_tables(PAGE, tables)
    print(f"\nPictures are in {FOLDER}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
