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
    opt.Option("--lengths", "averaging, mm; default: a spacing, shares of a cell, cells, all", opt.MM, nargs="+"),
    opt.Option("--cell-pitch", "mm; default: the liner's", opt.MM),
    opt.Option("--duct-height", "of the jets' cross-flow, mm; default 50", opt.MM, default=50.0),
    opt.Option("--shear", "of its tanh profile, half heights; default 0.05", opt.NUMBER, default=0.05),
    opt.Option("--limits", "of modulation, averagings, change; default 0.1 0.1 0.1", opt.NUMBER, nargs=3),
]
OPTIONS = [*OWN, opt.OF_LINER, opt.ROWS, *opt.PICTURES_OF, *opt.PRINTING, *CHOICES, *READING]


def run(options: argparse.Namespace) -> int:
    """Study the heights, print rows, facts and the recommendation."""
    from torchliner.report import study_figures as figures
    from torchliner.report.studies import format_heights, height_table
    from torchliner.report.study_table import plain_of, table_of
    from torchliner.studies.heights import recommend_height, study_heights

    planes = read_records(options.planes, options)
    liner = only_liner(options.liner, planes, options.planes)
    lengths = None if options.lengths is None else [1e-3 * value for value in options.lengths]
    pitch = None if options.cell_pitch is None else 1e-3 * options.cell_pitch
    chosen = {"lengths": lengths, "cell_pitch": pitch, "shear": options.shear} | opt.given(options, CHOICES)
    with progress_bar(len(planes), "heights", options, "height") as step:
        tall = 1e-3 * options.duct_height
        study = study_heights(planes, liner, options.frequency, duct_height=tall, progress=step, **chosen)
    found = recommend_height(study, *options.limits or ())
    if options.figure is not None:
        options.figure.mkdir(parents=True, exist_ok=True)
        figures.draw_heights(study, options.figure / "heights.png")
        if any(one.modulation is not None for one in study.facts):
            figures.draw_modulation(study, options.figure / "modulation.png")
        table_of(study.facts, "").write_csv(options.figure / "facts.csv")
    decays = {f"{name}_length": study[name] and study[name].length for name in ("decay", "first_decay")}
    plain = plain_of(study | decays | {"recommended": found})
    show_results(options, format_heights(study, found), plain, output=height_table(study).write_csv)
    return 0
