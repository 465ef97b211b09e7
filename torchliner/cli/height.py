"""torchliner height."""

from __future__ import annotations

import argparse
from dataclasses import replace

from torchliner.cli import options as opt
from torchliner.cli.choices import NO_GIVEN_PHASE, READING, choices
from torchliner.cli.files import only_liner, read_records, show_results
from torchliner.cli.messages import progress_bar

EXAMPLES = ("plane_y*.h5 -o rows.csv --figure pictures",)
CHOICES = choices("averaging phase drive mean missing allow_short wall_filter", phase=NO_GIVEN_PHASE)
OWN = [
    replace(opt.PLANES, text="plane files of one case, or their moments, one a height"),
    opt.Option("--frequency", "default: the tone of the files", opt.HZ),
    opt.Option("--cell-pitch", "mm; default: the liner's", opt.MM),
    opt.Option("--limits", "of modulation, averagings, change; default 0.1 0.1 0.1", opt.NUMBER, nargs=3),
]
OPTIONS = [*OWN, opt.OF_LINER, opt.ROWS, *opt.PICTURES_OF, *opt.PRINTING, *CHOICES, *READING]


def run(options: argparse.Namespace) -> int:
    """Study the heights, print rows and the recommendation."""
    from torchliner.report import study_figures as figures
    from torchliner.report.studies import format_heights, height_table
    from torchliner.report.study_table import plain_of
    from torchliner.studies.heights import recommend_height, study_heights

    planes = read_records(options.planes, options)
    liner = only_liner(options.liner, planes, options.planes)
    pitch = None if options.cell_pitch is None else 1e-3 * options.cell_pitch
    chosen = {"cell_pitch": pitch} | opt.given(options, CHOICES)
    with progress_bar(len(planes), "heights", options, "height") as step:
        study = study_heights(planes, liner, options.frequency, progress=step, **chosen)
    found = recommend_height(study, *options.limits or ())
    if options.figure is not None:
        options.figure.mkdir(parents=True, exist_ok=True)
        figures.draw_heights(study, options.figure / "heights.png")
        if any(row.modulation is not None for row in study.rows):
            figures.draw_modulation(study, options.figure / "modulation.png")
    decays = {f"{name}_length": study[name] and study[name].length for name in ("decay", "first_decay")}
    plain = plain_of(study | decays | {"recommended": found})
    show_results(options, format_heights(study, found), plain, output=height_table(study).write_csv)
    return 0
