"""torchliner truth."""

from __future__ import annotations

import argparse
from pathlib import Path

from torchliner.cli.options import add_output_options, liner_name, print_json, progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options."""
    parser.add_argument("planes", nargs="+", type=Path, help="plane files with a true impedance")
    parser.add_argument("--liner", help="model; default: the one the file names")
    parser.add_argument("-o", "--output", type=Path, help="the rows as CSV")
    add_output_options(parser)


def run(options: argparse.Namespace) -> int:
    """Print the table of all rules."""
    from torchliner.audits.truth_rows import truth_table
    from torchliner.io.plane_file import read_plane
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.truth_table import (
        format_rules,
        format_summary,
        format_truth,
        plain_truth,
    )

    planes = [read_plane(path) for path in options.planes]
    names = {
        id(plane): options.liner or liner_name(plane, path)
        for plane, path in zip(planes, options.planes, strict=True)
    }
    with progress_bar(len(planes), "truth table", options.quiet) as step:
        rows = truth_table(planes, lambda plane: load_liner(names[id(plane)]), step)
    if options.output is not None:
        plain_truth(rows).write_csv(options.output)
    if options.json:
        print_json(plain_truth(rows).as_rows())
    else:
        print(format_truth(rows))
        print(f"\n{format_rules(rows)}")
        print(f"\n{format_summary(rows)}")
    return 0
