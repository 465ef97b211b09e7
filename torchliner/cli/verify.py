"""torchliner verify."""

from __future__ import annotations

import argparse
from pathlib import Path

from torchliner.cli.options import add_output_options, print_json, refuse_inputs, require_ending


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options."""
    parser.add_argument("--degrees", nargs="+", type=int, default=[1, 2, 3, 4], metavar="P",
                        help="polynomial degrees of the elements; default 1 to 4")  # fmt: skip
    parser.add_argument("-o", "--output", type=Path, help="the tables as CSV")
    add_output_options(parser)


def run(options: argparse.Namespace) -> int:
    """Print tables and checks; 1 if one fails."""
    from torchliner.lee.verification import checks, order_rows
    from torchliner.report.verification_table import format_verification, order_table

    require_ending(options.output, [".csv"], "--output")
    refuse_inputs((options.output,), ())
    rows = order_rows(options.degrees)
    found = checks(rows)
    table = order_table(rows)
    if options.output is not None:
        table.write_csv(options.output)
    if options.json:
        print_json({"orders": rows, "checks": found})
    else:
        print(format_verification(table, found))
    return 0 if all(check["passed"] for check in found) else 1
