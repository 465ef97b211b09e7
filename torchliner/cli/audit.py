"""torchliner audit."""

from __future__ import annotations

import argparse
from pathlib import Path

from torchliner.cli.choice_options import add_choice_options, add_order_option, chosen_from
from torchliner.cli.options import (
    add_output_options,
    liner_name,
    print_json,
    progress_bar,
    refuse_inputs,
    require_ending,
    warnings_on_stderr,
)

CHOICES = ("edge", "window", "drive", "mean", "kernel", "levels", "velocity_max", "pre_roll",
           "running_window", "minimum_coherence", "wall_filter", "missing", "allow_short",
           "interval", "draws", "seed", "resample", "memory", "compile", "device", "dtype"
           )  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options; those of the base are those of ``educe``."""
    parser.add_argument("planes", nargs="+", type=Path, help="the plane, and others of the same "
                        "case: its other heights")  # fmt: skip
    parser.add_argument("--liner", help="preset name, .toml or .csv; default: named in the file")
    parser.add_argument("--frequency", type=float, metavar="HZ", help="default: the tone")
    add_order_option(parser, "probes first")
    parser.add_argument("-o", "--output", type=Path, help="the rows as CSV")
    parser.add_argument("--figure", type=Path, help="picture of the table")
    add_choice_options(parser, CHOICES)
    add_output_options(parser)


def run(options: argparse.Namespace) -> int:
    """Print the table, sorted by what moves Z most."""
    from torchliner.audits.audit import audit
    from torchliner.io.plane_file import read_plane
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.audit_report import draw_audit, format_audit, plain_audit, write_audit

    refuse_inputs([options.output], [*options.planes, options.liner], options.figure)
    require_ending(options.output, [".csv"], "--output")
    planes = [read_plane(path, lazy=True) for path in options.planes]
    liner = load_liner(options.liner or liner_name(planes[0], options.planes[0]))
    total = sum(2 * plane.samples for plane in planes) + 2 * planes[0].samples
    with (
        warnings_on_stderr(options.quiet),
        progress_bar(total, options.planes[0].name, options.quiet) as step,
    ):
        found = audit(
            planes,
            liner,
            options.frequency,
            order=options.order,
            progress=step,
            **chosen_from(options),
        )
    if options.output is not None:
        write_audit(found, options.output)
    if options.figure is not None:
        draw_audit(found, options.figure)
    if options.json:
        print_json(plain_audit(found))
    else:
        print(format_audit(found))
    return 0
