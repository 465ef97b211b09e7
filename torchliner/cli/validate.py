"""torchliner validate."""

from __future__ import annotations

import argparse

from torchliner.cli.files import liner_names, read_planes, show_results
from torchliner.cli.options import progress_bar, shared
from torchliner.cli.plane_options import plane_options

OPTIONS = {
    "": {"planes PLANE ...": "files with a reference impedance"} | shared("--liner", "--output", "--json", "--quiet")
} | plane_options()


def run(options: argparse.Namespace) -> int:
    """Print the table of all rules."""
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.truth_table import (
        format_rules,
        format_summary,
        format_truth,
        plain_truth,
    )
    from torchliner.studies.validate import validation_table

    planes = read_planes(options.planes, options, lazy=False)
    names = liner_names(options.liner, planes, options.planes)
    liners = {id(plane): load_liner(name) for plane, name in zip(planes, names, strict=True)}
    with progress_bar(len(planes), "validation", options, "plane") as step:
        rows = validation_table(planes, lambda plane: liners[id(plane)], step)
    tables = (format_truth, format_rules, format_summary)
    plain = plain_truth(rows)
    show_results(
        options,
        lambda: "\n\n".join(table(rows) for table in tables),
        plain.as_rows,
        output=plain.write_csv,
    )
    return 0
