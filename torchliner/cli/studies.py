"""Commands that vary a choice, a height, a model or a map: audit, height, compare, compare-models, validate."""

from __future__ import annotations

import argparse
from pathlib import Path

import torchliner as tl
from torchliner.cli.inputs import liners_of, only_liner, read_planes, read_records, samples_of
from torchliner.cli.show import progress_bar, show
from torchliner.report.answer import answer_of
from torchliner.report.curves import draw_comparison
from torchliner.studies.heights import recommend_height, study_heights
from torchliner.studies.validation import validation_table


def audit(options: argparse.Namespace) -> None:
    """How far each open choice moves the impedance."""
    records = read_records(options.planes, options)
    liner = only_liner(options, records, options.planes)
    with progress_bar(samples_of(records), options) as step:
        found = tl.audit(records, liner, options.frequency, progress=step, **options.chosen)
    show(options, found)


def height(options: argparse.Namespace) -> None:
    """Impedance over height, and which height to take."""
    records = read_records(options.planes, options)
    liner = only_liner(options, records, options.planes)
    with progress_bar(len(records), options, "height") as step:
        study = study_heights(records, liner, options.frequency, progress=step, **options.chosen)
    answer = answer_of(study, recommend_height(study, *options.limits or ()))
    show(options, answer, draw=answer.write_pictures)


def compare(options: argparse.Namespace) -> None:
    """Difference of two maps, by cell and for the liner."""
    found = tl.compare(tl.read_map(options.first), tl.read_map(options.second), **options.chosen)
    show(options, found, draw=lambda path: draw_comparison(found, path))


def compare_models(options: argparse.Namespace) -> None:
    """Several models of the liner on one plane, in one pass."""
    stems = [Path(name).stem for name in options.liner]
    liners = dict(zip(stems if len(set(stems)) == len(stems) else options.liner, options.liner, strict=True))
    if len(liners) < len(stems):
        raise ValueError(f"--liner {' --liner '.join(options.liner)}: one is given twice; name each model once")
    records = read_records([options.plane], options)
    models = {name: tl.load_liner(liner) for name, liner in liners.items()}
    with progress_bar(samples_of(records), options) as step:
        found = tl.compare_models(records[0], models, options.frequency, progress=step, **options.chosen)
    show(options, found)


def validate(options: argparse.Namespace) -> None:
    """Every rule beside the reference impedance of resolved cases."""
    planes = read_planes(options.planes, options, lazy=False)
    liners = dict(zip(map(id, planes), liners_of(options, planes, options.planes), strict=True))
    with progress_bar(len(planes), options, "plane") as step:
        found = validation_table(planes, lambda plane: liners[id(plane)], step)
    show(options, found)
