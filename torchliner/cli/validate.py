"""torchliner validate."""

from __future__ import annotations

import argparse
from dataclasses import replace

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.choices import READING
from torchliner.cli.files import liner_names, read_planes, show_results
from torchliner.cli.messages import progress_bar

EXAMPLES = ("data/slit_n130_y*.h5 -o rules.csv",)
PLANES = replace(opt.PLANES, text="files with a reference impedance")
OPTIONS = [PLANES, opt.OF_LINER, opt.ROWS, *opt.PRINTING, *READING]


def run(options: argparse.Namespace) -> int:
    """Print the table of all rules."""
    from torchliner.report.truth_table import format_rules, format_summary, format_truth, plain_truth
    from torchliner.studies.validate import validation_table

    planes = read_planes(options.planes, options, lazy=False)
    names = liner_names(options.liner, planes, options.planes)
    liners = {id(plane): tl.load_liner(name) for plane, name in zip(planes, names, strict=True)}
    with progress_bar(len(planes), "validation", options, "plane") as step:
        rows = validation_table(planes, lambda plane: liners[id(plane)], step)
    text = "\n\n".join(table(rows) for table in (format_truth, format_rules, format_summary))
    plain = plain_truth(rows)
    show_results(options, text, plain.as_rows(), output=plain.write_csv)
    return 0
