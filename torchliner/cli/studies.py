"""Commands that vary a choice, a height, a model or a map: audit, height, compare, compare-models."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import torchliner as tl
from torchliner.cli import kinds
from torchliner.cli import options as opt
from torchliner.cli.inputs import liners_of, only_liner, planes_of, read_records
from torchliner.cli.kinds import Command, Option
from torchliner.cli.output import progress_bar, show


def audit(options: argparse.Namespace) -> None:
    """Print the table, sorted by what moves Z most."""
    from torchliner.report.answer import answer_of

    records = read_records(options.planes, options)
    planes = planes_of(records)
    (liner,) = liners_of(options, planes[:1], options.planes[:1])
    total = 2 * sum(plane.samples for plane in planes) + planes[0].samples
    with progress_bar(total, options.planes[0], options) as step:
        found = tl.audit(records, liner, options.frequency, progress=step, **options.chosen)
    show(options, answer_of(found))


def height(options: argparse.Namespace) -> None:
    """Study the heights, print rows and the recommendation."""
    from torchliner.report.answer import answer_of
    from torchliner.studies.heights import recommend_height, study_heights

    planes = read_records(options.planes, options)
    liner = only_liner(options, planes, options.planes)
    with progress_bar(len(planes), "heights", options, "height") as step:
        study = study_heights(planes, liner, options.frequency, progress=step, **options.chosen)
    found = recommend_height(study, *options.limits or ())
    show(options, answer_of(study, found), draw=lambda answer, folder: answer.write_pictures(folder))


def compare(options: argparse.Namespace) -> None:
    """Print by how much the second differs from the first, for the liner and each cell."""
    from torchliner.report.answer import answer_of
    from torchliner.report.curves import draw_comparison

    maps = tl.read_map(options.first), tl.read_map(options.second)
    found = tl.compare(*maps, options.averaging)
    show(options, answer_of(found), draw=lambda _, path: draw_comparison(found, path))


def compare_models(options: argparse.Namespace) -> None:
    """Print a row a model, the nearest to what is known first."""
    from torchliner.report.answer import answer_of

    stems = [Path(name).stem for name in options.liner]
    names = stems if len(set(stems)) == len(stems) else options.liner
    if len(set(names)) < len(names):
        raise ValueError(f"--liner {' --liner '.join(names)}: one is given twice; name each model once")
    liners = {name: tl.load_liner(liner) for name, liner in zip(names, options.liner, strict=True)}
    (record,) = read_records([options.plane], options)
    with progress_bar(2 * planes_of([record])[0].samples, options.plane, options) as step:
        found = tl.compare_models(record, liners, options.frequency, progress=step, **options.chosen)
    show(options, answer_of(found))


ONE = replace(opt.ONE_PLANE, text="file of a plane, or what torchliner reduce made of it")
CASE = replace(opt.PLANES, text="the plane, and others of the same case: its other heights")
HEIGHTS = replace(opt.PLANES, text="plane files of one case, or their moments, one a height")
LIMITS = Option("--limits", "of modulation, averagings, change; default 0.1 0.1 0.1", kinds.NUMBER, nargs=3)
MODELS = Option("--liner", "preset, .toml, .csv or .py file; twice or more", kinds.LINER, many=True, required=True)
COMMANDS = {
    "audit": Command(
        audit,
        [CASE, opt.ONE_TONE, opt.figure("draw the table there"), opt.OF_LINER, opt.ROWS],
        ("plane.h5 --figure audit.png",),
        [opt.averaging("phase-locked"), *opt.of("velocity.choices:Choices", opt.OF_EDUCE, shown=opt.SHOWN)],
    ),
    "height": Command(
        height,
        [HEIGHTS, opt.ONE_TONE, LIMITS, opt.OF_LINER, opt.ROWS, opt.PICTURES_OF],
        ("plane_y*.h5 -o rows.csv --figure pictures",),
        [
            *opt.of("studies.heights:study_heights", "cell_pitch"),
            *opt.choices("averaging phase drive mean missing allow_short wall_filter", phase=opt.NO_GIVEN_PHASE),
        ],
    ),
    "compare": Command(
        compare,
        [
            Option("first", "map of torchliner educe", kinds.PATH),
            Option("second", "another one of the same cells", kinds.PATH),
            *(opt.averaging(None), opt.ROWS, opt.figure("draw R and X along x of both, and their difference")),
        ],
        ("first.h5 second.h5",),
    ),
    "compare-models": Command(
        compare_models,
        [ONE, MODELS, opt.TONE, opt.figure("draw R and X of all models with their intervals"), opt.ROWS],
        ("plane.h5 --liner onera --liner mine.toml --figure models.png",),
        [*opt.of("studies.compare:compare_models", "cell_pitch"), *opt.EDUCED],
    ),
}
