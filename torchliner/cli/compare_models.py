"""torchliner compare-models."""

from __future__ import annotations

import argparse
from pathlib import Path

from torchliner.cli.choice_options import EDUCED, choice_options, chosen_from
from torchliner.cli.files import planes_of, read_records, show_results
from torchliner.cli.options import frequency_option, progress_bar, shared
from torchliner.cli.plane_options import plane_options

OPTIONS = (
    {
        "": {
            "plane PLANE": "file of a plane, or what torchliner reduce made of it",
            "--liner LINER": {
                "action": "append",
                "default": [],
                "help": "a model, preset, .toml, .csv or .py file; required twice or more",
            },
            **frequency_option("the tone of the file"),
            "--cell-pitch M": "side of the cells, m, for all models; default: that of the moments, "
            "else of the preset that the file names, else of the models",
            "--figure PICTURE": "draw R and X of all models with their intervals",
        }
        | shared("--output", "--json", "--quiet")
    }
    | choice_options(EDUCED)
    | plane_options()
)


def run(options: argparse.Namespace) -> int:
    """Print a row a model, the nearest to what is known first."""
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.studies import format_models, models_table
    from torchliner.report.study_figures import draw_models
    from torchliner.report.study_table import plain_of
    from torchliner.studies.compare_models import compare_models

    twice = next((name for name in options.liner if options.liner.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"--liner {twice} is given twice; name each model once")
    stems = [Path(name).stem for name in options.liner]
    names = stems if len(set(stems)) == len(stems) else options.liner
    liners = {name: load_liner(liner) for name, liner in zip(names, options.liner, strict=True)}
    (record,) = read_records([options.plane], options)
    total = 2 * planes_of([record])[0].samples
    with progress_bar(total, options.plane.name, options) as step:
        found = compare_models(
            record,
            liners,
            options.frequency,
            cell_pitch=options.cell_pitch,
            progress=step,
            **chosen_from(options, EDUCED),
        )
    show_results(
        options,
        lambda: format_models(found),
        lambda: plain_of(found),
        output=models_table(found).write_csv,
        figure=lambda path: draw_models(found, path),
    )
    return 0
