"""torchliner truth."""

from __future__ import annotations

import argparse

from torchliner.cli.files import check_files, liner_names, read_planes
from torchliner.cli.options import print_json, progress_bar, shared

OPTIONS = {
    "": {"planes PLANE ...": "plane files with a true impedance"}
    | shared("--liner", "--output", "--json", "--quiet")
}


def run(options: argparse.Namespace) -> int:
    """Print the table of all rules."""
    from torchliner.audits.truth_rows import truth_table
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.truth_table import (
        format_rules,
        format_summary,
        format_truth,
        plain_truth,
    )

    check_files(options, [*options.planes, options.liner])
    planes = read_planes(options.planes, lazy=False)
    names = liner_names(options.liner, planes, options.planes)
    liners = {id(plane): load_liner(name) for plane, name in zip(planes, names, strict=True)}
    with progress_bar(len(planes), "truth table", options) as step:
        rows = truth_table(planes, lambda plane: liners[id(plane)], step)
    if options.output is not None:
        plain_truth(rows).write_csv(options.output)
    if options.json:
        print_json(plain_truth(rows).as_rows())
    else:
        print(format_truth(rows))
        print(f"\n{format_rules(rows)}")
        print(f"\n{format_summary(rows)}")
    return 0
