"""torchliner height."""

from __future__ import annotations

import argparse

from torchliner.cli.choice_options import NO_GIVEN_PHASE, choice_options, chosen_from
from torchliner.cli.files import only_liner, read_records, show_results
from torchliner.cli.options import progress_bar, shared
from torchliner.cli.plane_options import plane_options

CHOICES = (
    "averaging",
    "phase",
    "drive",
    "mean",
    "missing",
    "allow_short",
    "wall_filter",
)

OPTIONS = (
    {
        "": {
            "planes PLANE ...": "plane files of one case, or their moments, one a height",
            "--frequency HZ": "default: the tone of the files",
            "--lengths MM ...": "averaging, mm; default: a spacing, shares of a cell, cells, all",
            "--cell-pitch MM": "mm; default: the liner's",
            "--duct-height MM": {"default": 50.0, "help": "of the jets' cross-flow, mm; default 50"},
            "--shear D": {"default": 0.05, "help": "of its tanh profile, half heights; default 0.05"},
            "--limits MODULATION AVERAGINGS CHANGE": "where the level is not checked, relative; default 0.1 0.1 0.1",
        }
        | shared("--liner", "--output", "--figure", "--json", "--quiet"),
    }
    | choice_options(CHOICES, NO_GIVEN_PHASE)
    | plane_options()
)


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
    with progress_bar(len(planes), "heights", options, "height") as step:
        study = study_heights(
            planes,
            liner,
            options.frequency,
            lengths=lengths,
            cell_pitch=pitch,
            shear=options.shear,
            duct_height=1e-3 * options.duct_height,
            progress=step,
            **chosen_from(options, CHOICES),
        )
    found = recommend_height(study, *options.limits or ())
    if options.figure is not None:
        options.figure.mkdir(parents=True, exist_ok=True)
        figures.draw_heights(study, options.figure / "heights.png")
        if any(one.modulation is not None for one in study.facts):
            figures.draw_modulation(study, options.figure / "modulation.png")
        table_of(study.facts, "").write_csv(options.figure / "facts.csv")
    lengths_of = {name: study[name] and study[name].length for name in ("decay", "first_decay")}
    show_results(
        options,
        lambda: format_heights(study, found),
        lambda: plain_of(
            study
            | {
                "decay_length": lengths_of["decay"],
                "first_decay_length": lengths_of["first_decay"],
                "recommended": found,
            }
        ),
        output=height_table(study).write_csv,
    )
    return 0
