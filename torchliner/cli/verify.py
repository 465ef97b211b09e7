"""torchliner verify."""

from __future__ import annotations

import argparse

from torchliner.cli.files import show_results
from torchliner.cli.options import shared

DEGREES = {"default": [1, 2, 3, 4], "help": "polynomial degrees of the elements; default 1 to 4"}
OPTIONS = {"": {"--degrees N ...": DEGREES} | shared("--output", "--json", "--quiet")}


def run(options: argparse.Namespace) -> int:
    """Print tables and checks; 1 if one fails."""
    from torchliner.lee.verification import checks, order_rows
    from torchliner.report.verification_table import format_verification, order_table

    rows = order_rows(options.degrees)
    found = checks(rows)
    table = order_table(rows)
    show_results(
        options, lambda: format_verification(table, found),
        lambda: {"orders": rows, "checks": found}, output=table.write_csv,
    )  # fmt: skip
    return 0 if all(check["passed"] for check in found) else 1
