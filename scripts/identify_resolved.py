"""The response of the resolved liners found from their runs: what docs/identify.md shows.

    python scripts/identify_resolved.py [-o FOLDER] [--check]

Curves and parameters fitted to the reference impedances at 0.5 mm, 1400 Hz, phase-locked, and what each run is
predicted as by a fit to the others.
"""

import functools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torchliner as tl
from common import case_files, run_study
from torchliner.report.studies import draw_identification
from torchliner.studies.variants import Row

REST = 0.01 + 0.01j  # the presets' linear parts are those of runs at 115 dB
SETS = (("vena_contracta",), ("vena_contracta", "mass_loss"), ("vena_contracta", "mass_loss_speed"))
FLOW = (
    ("mach_resistance",),
    ("mach_mass_loss",),
    ("vena_contracta", "mach_resistance"),
    ("vena_contracta", "mach_mass_loss"),
    ("vena_contracta", "mass_loss", "mass_loss_speed"),
)
STUDIES: dict[str, tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]] = {
    "orifice": (("o115", "o130", "o145"), SETS),
    "coarse orifice": (("t00_130", "t03_130", "t015_145"), (*SETS, *FLOW[:4])),
    "slit": (("n115", "n130", "n145", "g01_145", "g03_145"), (*SETS, *FLOW)),
}
FOUND: dict[str, Any] = {}


def rows_of() -> list[Row]:
    """A row a run and model, the model that predicts best first; of the curves the best alone."""
    rows = []
    for name, (cases, models) in STUDIES.items():
        planes = [tl.read_plane(case_files(case)[0]) for case in cases]
        liner, laws = tl.load_liner(planes[0].liner), ["curve", *models]
        found = tl.identify(planes, liner, "true", models=laws, rest=REST, allow_short=True)
        FOUND[name] = found
        curve = next(each for each in found.candidates if each.fit.law.frequencies)
        for each in found.candidates:
            if each.fit.law.frequencies and each is not curve:
                continue
            pairs = zip(each.fit.numbers.items(), each.fit.standard.tolist(), strict=True)
            values = "" if each is curve else ", ".join(f"{name} {value:.3g}±{u:.1g}" for (name, value), u in pairs)
            about = {"liner": name, "model": each.label, "error": each.error, "misfit": each.fit.misfit}
            for row in each.rows:
                mine = Row(about, run=row.label, values=values, impedance=row.impedance)
                rows.append(Row(mine, fitted=row.fitted, true=row.true))
    return rows


def draw(_: Sequence[Row], path: Path) -> None:
    """Of the orifice and the slit."""
    for name in ("orifice", "slit"):
        draw_identification(FOUND[name], path.with_name(f"identify_{name}.png"))


main = functools.partial(run_study, __doc__, "identify_resolved", rows_of, draw)


if __name__ == "__main__":
    sys.exit(main())
