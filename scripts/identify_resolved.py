"""The response of the resolved liners found from their runs: what docs/identify.md shows.

    python scripts/identify_resolved.py [--write]

Curves and parameters fitted to the true impedances at 0.5 mm, 1400 Hz, phase-locked;
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
from torchliner.report.studies import draw_identification
from torchliner.studies.rows import Row
from truth_page import page_table, write_tables

PAGE, FOLDER = ROOT / "docs" / "identify.md", RESULTS / "identify_resolved"
REST = 0.01 + 0.01j  # the presets' linear parts are those of runs at 115 dB
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
    return tl.identify(
        planes, tl.load_liner(planes[0].liner), "true", rest=REST, models=["curve", *study.models], allow_short=True
    )


def values_of(candidate: Row) -> str:
    """Parameters found, or nothing."""
    if is_curve(candidate):
        return ""
    both = zip(candidate.fit.values.tolist(), candidate.fit.standard.tolist(), strict=True)
    return ", ".join(f"{value:.3g}±{spread:.1g}" for value, spread in both)


def model_table(found: Any) -> str:
    """Models, the one that predicts best first, and R of each run by the others; one curve."""
    curve = next(each for each in found.candidates if is_curve(each))
    lines = []
    for each in found.candidates:
        if each is curve or not is_curve(each):
            off = ", ".join(f"{percent(row):+d}" for row in each.rows)
            lines.append([each.label, f"{each.error:.3f}", f"{each.fit.misfit:.1f}", values_of(each), off])
    return page_table("model | error left out | misfit/noise | values | R off by (%)", lines)


def is_curve(candidate: Row) -> bool:
    """Of some freedom."""
    return bool(candidate.fit.law.frequencies)


def percent(row: Any) -> int:
    """By which R is off."""
    return round(100 * (row.impedance.real / row.true.real - 1)) + 0


def flow_table(study: Study, found: Any) -> str:
    """One coefficient of Mach: what it makes of the runs with flow, fitted to them too."""
    wanted = {row for row in study.cases if row[0] == "g"}
    lines = []
    for each in found.candidates:
        if "mach" not in each.label:
            continue
        rows = [row for row in each.rows if row.group in wanted]
        ways = []
        for value in ("fitted", "impedance"):
            away = [getattr(row, value) - row.true for row in rows]
            shares = [miss.real / row.true.real for miss, row in zip(away, rows, strict=True)]
            ways.append(", ".join(f"{100 * share:+.0f}" for share in shares))
            ways.append(", ".join(f"{miss.imag:+.2f}" for miss in away))
        lines.append([each.label, *ways])
    return page_table("model | fitted: R (%) | X | predicted: R (%) | X", lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit, leave out, print, draw."""
    parser = parser_of(__doc__)
    parser.add_argument("--write", action="store_true", help="into docs/ as well")
    options = options_of(parser, arguments)
    FOLDER.mkdir(parents=True, exist_ok=True)
    found = [(study, identified(study)) for study in STUDIES]
    tables = {"flow": flow_table(*found[2])}
    for study, each in found:
        name = study.name.split(maxsplit=1)[0].strip(",")
        tables[f"{name}_models"] = model_table(each)
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
