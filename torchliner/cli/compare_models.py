"""torchliner compare-models."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.choices import EDUCED, READING
from torchliner.cli.files import planes_of, read_records, show_results
from torchliner.cli.messages import progress_bar
from torchliner.cli.signatures import of

EXAMPLES = ("plane.h5 --liner onera --liner mine.toml --figure models.png",)
OWN = [
    replace(opt.ONE_PLANE, text="file of a plane, or what torchliner reduce made of it"),
    opt.Option("--liner", "a model, preset, .toml, .csv or .py file; required twice or more", opt.LINER, many=True),
    opt.TONE,
    *of("studies.compare_models:compare_models", "cell_pitch"),
    *opt.figure("draw R and X of all models with their intervals"),
]
OPTIONS = [*OWN, opt.ROWS, *opt.PRINTING, *EDUCED, *READING]


def run(options: argparse.Namespace) -> int:
    """Print a row a model, the nearest to what is known first."""
    from torchliner.report.studies import format_models, models_table
    from torchliner.report.study_figures import draw_models
    from torchliner.report.study_table import plain_of

    twice = next((name for name in options.liner if options.liner.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"--liner {twice} is given twice; name each model once")
    stems = [Path(name).stem for name in options.liner]
    names = stems if len(set(stems)) == len(stems) else options.liner
    liners = {name: tl.load_liner(liner) for name, liner in zip(names, options.liner, strict=True)}
    (record,) = read_records([options.plane], options)
    chosen = opt.given(options, EDUCED) | {"cell_pitch": options.cell_pitch}
    with progress_bar(2 * planes_of([record])[0].samples, options.plane.name, options) as step:
        found = tl.compare_models(record, liners, options.frequency, progress=step, **chosen)
    show_results(
        options,
        format_models(found),
        plain_of(found),
        output=models_table(found).write_csv,
        figure=lambda path: draw_models(found, path),
    )
    return 0
