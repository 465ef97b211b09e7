"""torchliner report."""

from __future__ import annotations

import argparse
from typing import Any

from torchliner.cli.files import show_results
from torchliner.cli.options import shared

OPTIONS = {
    "": {
        "result PATH": "map, line, points, impedances from microphones (kt -o) or a solved duct "
                       "(duct solve -o) as .h5/.nc, or the folder of a campaign",
        "--output FILE": {"required": True, "help": "write the page as .html"},
        "--cases": "of a campaign: a page for each case as well, in OUTPUT_cases beside",
    }
    | shared("--json", "--quiet"),
}  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Write the page and print its one sentence."""
    from torchliner.report.page.render import require_report

    require_report()
    if options.result.is_dir():
        page, written = _campaign(options)
    else:
        from torchliner.report.page.opening import report_file

        if options.cases:
            raise ValueError(f"--cases is for the folder of a campaign; {options.result} is a file")
        page = report_file(options.result, options.output)
        written = [options.output]
    facts = {"title": page.title, "answer": page.answer, "level_check": page.state,
             "written": [str(path) for path in written]}  # fmt: skip
    show_results(options, lambda: f"{page.title}\n{page.answer}\n{options.output}", lambda: facts)
    return 0


def _campaign(options: argparse.Namespace) -> tuple[Any, list[Any]]:
    from torchliner.campaign.page import report_campaign

    return report_campaign(options.result, options.output, cases=options.cases)
