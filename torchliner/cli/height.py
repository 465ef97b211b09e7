"""torchliner height."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from torchliner.cli.choice_options import NO_GIVEN_PHASE, add_choice_options, chosen_from
from torchliner.cli.options import (
    add_output_options,
    liner_name,
    print_json,
    progress_bar,
    refuse_inputs,
    require_ending,
    warnings_on_stderr,
)

if TYPE_CHECKING:
    from torchliner.heights.study import HeightStudy

CHOICES = ("phase", "drive", "mean", "edge", "missing", "allow_short", "wall_filter", "memory")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options."""
    parser.add_argument("planes", nargs="+", type=Path, help="plane files of one case, by height")
    parser.add_argument("--liner", help="preset name, .toml or .csv; default: named in the files")
    parser.add_argument("--frequency", type=float, metavar="HZ", help="default: the tone")
    parser.add_argument("--lengths", nargs="+", type=float, metavar="MM", help="averaging lengths; "
                        "default: a spacing, shares of a cell, whole cells, all")  # fmt: skip
    parser.add_argument("--cell-pitch", type=float, metavar="MM", help="default: the liner's")
    parser.add_argument("--duct-height", type=float, metavar="MM", default=50.0,
                        help="of the jets' cross-flow (default 50)")  # fmt: skip
    parser.add_argument("--shear", type=float, default=0.05, help="of its tanh profile, in half "
                        "heights (default 0.05)")  # fmt: skip
    parser.add_argument("--limits", nargs=3, type=float, metavar=("IMPRINT", "ORDERS", "CHANGE"),
                        help="a height must keep to (default 0.1 0.1 0.1)")  # fmt: skip
    parser.add_argument("-o", "--output", type=Path, help="the rows as CSV")
    parser.add_argument("--figures", type=Path, metavar="FOLDER", help="draw pictures there")
    add_choice_options(parser, CHOICES, phase=NO_GIVEN_PHASE)
    add_output_options(parser)


def run(options: argparse.Namespace) -> int:
    """Study the heights, print rows, facts and the recommendation."""
    from torchliner.heights.facts import JetFlow
    from torchliner.heights.recommend import Limits, recommend_height
    from torchliner.heights.study import study_heights
    from torchliner.io.plane_file import read_plane
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.height_table import format_study, height_table, plain_study

    refuse_inputs([options.output], [*options.planes, options.liner])
    require_ending(options.output, [".csv"], "--output")
    limits = Limits(*options.limits) if options.limits else Limits()
    flow = JetFlow(1e-3 * options.duct_height, options.shear)
    planes = [read_plane(path, lazy=True) for path in options.planes]
    names = [options.liner or liner_name(p, f) for p, f in zip(planes, options.planes, strict=True)]
    if len(set(names)) > 1:
        raise ValueError(
            f"the planes name different liners, {', '.join(sorted(set(names)))}; choose one with "
            "--liner, or give the heights of one case"
        )
    lengths = None if options.lengths is None else [1e-3 * value for value in options.lengths]
    pitch = None if options.cell_pitch is None else 1e-3 * options.cell_pitch
    with (
        warnings_on_stderr(options.quiet),
        progress_bar(len(lengths or []) or 8, "averaging lengths", options.quiet) as step,
    ):
        study = study_heights(
            planes, load_liner(names[0]), options.frequency, lengths=lengths, cell_pitch=pitch,
            flow=flow, progress=step, **chosen_from(options),
        )  # fmt: skip
    found = recommend_height(study, limits)
    if options.output is not None:
        height_table(study).write_csv(options.output)
    if options.figures is not None:
        _draw(study, options.figures)
    if options.json:
        print_json(plain_study(study, found))
    else:
        print(format_study(study, found))
    return 0


def _draw(study: HeightStudy, folder: Path) -> None:
    from torchliner.report import height_figures as height

    folder.mkdir(parents=True, exist_ok=True)
    height.draw_impedance_over_height(study, folder / "impedance_over_height.png")
    height.impedance_over_height(study).write_csv(folder / "impedance_over_height.csv")
    imprint = height.imprint_over_height(study)
    if imprint.values:
        height.draw_imprint(study, folder / "imprint_over_height.png")
        imprint.write_csv(folder / "imprint_over_height.csv")
