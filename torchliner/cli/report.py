"""torchliner report."""

from __future__ import annotations

import argparse

from torchliner.cli import options as opt
from torchliner.cli.files import show_results

EXAMPLES = ("map.h5 -o report.html", "kt.h5 -o report.html", "results -o campaign.html --cases")
OPTIONS = [
    opt.Option(
        "result",
        "map, line, points, impedances from microphones (kt -o) or a solved duct (duct solve -o) as .h5/.nc, or the "
        "folder of a campaign",
        opt.PATH,
    ),
    opt.output("write the page", ".html", required=True),
    opt.Option("--cases", "of a campaign: a page for each case as well, in OUTPUT_cases beside"),
    *opt.PRINTING,
]


def run(options: argparse.Namespace) -> int:
    """Write the page and print its one sentence."""
    from torchliner.campaign.page import report_campaign
    from torchliner.report.page.opening import report_file
    from torchliner.report.page.render import require_report

    require_report()
    if options.result.is_dir():
        page, written = report_campaign(options.result, options.output, cases=options.cases)
    elif options.cases:
        raise ValueError(f"--cases is for the folder of a campaign; {options.result} is a file")
    else:
        page, written = report_file(options.result, options.output), [options.output]
    facts = {"title": page.title, "answer": page.answer, "level_check": page.state, "written": [*map(str, written)]}
    show_results(options, f"{page.title}\n{page.answer}\n{options.output}", facts)
    return 0
