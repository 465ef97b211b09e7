"""torchliner run."""

from __future__ import annotations

import argparse
from typing import Any

from torchliner.cli import options as opt
from torchliner.cli.files import show_results
from torchliner.cli.messages import progress_bar

EXAMPLES = ("campaign.toml", "campaign.toml --dry-run")
OPTIONS = [
    opt.Option("campaign", "TOML file of a campaign", opt.PATH),
    opt.Option("--output", "write the results there; default: as the file says, else NAME_results", opt.FOLDER),
    opt.Option("--dry-run", "say what would be done, and write nothing"),
    *opt.CLUSTER,
    *opt.PRINTING,
]


def run(options: argparse.Namespace) -> int:
    """Do what is not done yet; 1 if a unit failed."""
    from torchliner.campaign.campaign_file import read_campaign
    from torchliner.campaign.cluster import open_cluster
    from torchliner.campaign.index import FAILED, index_text
    from torchliner.campaign.run import plan, run_campaign

    campaign = read_campaign(options.campaign, options.output)
    planned = plan(campaign)
    units, summary = _planned(planned)
    if options.dry_run:
        lines = [f"{u['unit']}: " + (f"cannot be opened: {u['error']}" if "error" in u else u["state"]) for u in units]
        show_results(options, "\n".join([*lines, summary]), units)
        return 0
    if campaign.figures:
        from torchliner.report.figure import require_matplotlib

        require_matplotlib()
    total = sum(2 * unit.samples for unit in planned.to_read.values())
    with (
        open_cluster(options.cluster, options.wait) as client,
        progress_bar(total, options.campaign.name, options) as bar,
    ):
        rows = run_campaign(campaign, client=client, progress=bar)
    text = f"{index_text(rows)}\n{summary}\nresults in {campaign.output}, index.csv"
    show_results(options, text, rows)
    return 1 if any(row["status"] == FAILED for row in rows) else 0


def _planned(planned: Any) -> tuple[list[dict[str, str]], str]:
    """A row a unit, and what all of it takes."""
    units = [{"unit": unit.name, "state": planned.state(unit)} for unit in planned.units]
    failed = [{"unit": row["unit"], "state": "failed", "error": row["error"]} for row in planned.failed]
    states = [unit["state"] for unit in units] + ["cannot be opened"] * len(failed)
    counts = ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(states))
    size = sum(unit.bytes for unit in planned.to_read.values())
    reading = f"{len(planned.to_read)} planes to read, {size / 1e9:.3g} GB"
    return units + failed, f"{len(states)} units: {counts}; {reading}"
