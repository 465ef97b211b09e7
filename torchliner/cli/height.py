"""torchliner height."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from torchliner.cli.choice_options import NO_GIVEN_PHASE, choice_options, chosen_from
from torchliner.cli.files import only_liner, read_records, show_results
from torchliner.cli.options import progress_bar, shared
from torchliner.cli.plane_options import plane_options

if TYPE_CHECKING:
    from torchliner.studies.rows import Study

CHOICES = (
    "averaging", "phase", "drive", "mean", "missing", "allow_short", "wall_filter",
)  # fmt: skip

OPTIONS = {
    "": {
        "planes PLANE ...": "plane files of one case, or their moments, one a height",
        "--frequency HZ": "default: the tone of the files",
        "--lengths MM ...": "averaging, mm; default: a spacing, shares of a cell, cells, all",
        "--cell-pitch MM": "mm; default: the liner's",
        "--duct-height MM": {"default": 50.0, "help": "of the jets' cross-flow, mm; default 50"},
        "--shear D": {"default": 0.05, "help": "of its tanh profile, half heights; default 0.05"},
        "--limits MODULATION AVERAGINGS CHANGE": "where the level is not checked, relative; default 0.1 "
                                          "0.1 0.1",
    }
    | shared("--liner", "--output", "--figure", "--json", "--quiet"),
} | choice_options(CHOICES, NO_GIVEN_PHASE) | plane_options()  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Study the heights, print rows, facts and the recommendation."""
    from torchliner.report.height_table import format_study, height_table, plain_study
    from torchliner.studies.heights import study_heights
    from torchliner.studies.recommend import Limits, recommend_height

    limits = Limits(*options.limits) if options.limits else Limits()
    planes = read_records(options.planes, options)
    liner = only_liner(options.liner, planes, options.planes)
    lengths = None if options.lengths is None else [1e-3 * value for value in options.lengths]
    pitch = None if options.cell_pitch is None else 1e-3 * options.cell_pitch
    with progress_bar(len(planes), "heights", options, "height") as step:
        study = study_heights(
            planes, liner, options.frequency, lengths=lengths, cell_pitch=pitch, shear=options.shear,
            duct_height=1e-3 * options.duct_height, progress=step, **chosen_from(options, CHOICES),
        )  # fmt: skip
    found = recommend_height(study, limits)
    if options.figure is not None:
        _draw(study, options.figure)
    show_results(
        options, lambda: format_study(study, found), lambda: plain_study(study, found),
        output=height_table(study).write_csv,
    )  # fmt: skip
    return 0


def _draw(study: Study, folder: Path) -> None:
    from torchliner.report import height_figures as height

    folder.mkdir(parents=True, exist_ok=True)
    height.draw_impedance_over_height(study, folder / "impedance_over_height.png")
    height.impedance_over_height(study).write_csv(folder / "impedance_over_height.csv")
    imprint = height.imprint_over_height(study)
    if imprint.values:
        height.draw_imprint(study, folder / "imprint_over_height.png")
        imprint.write_csv(folder / "imprint_over_height.csv")
