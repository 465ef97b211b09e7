"""torchliner run."""

from __future__ import annotations

import argparse
from typing import Any

from torchliner.cli.files import show_results
from torchliner.cli.options import CLUSTER, progress_bar, shared

OPTIONS = {
    "": {
        "campaign PATH": "TOML file of a campaign",
        "--output FOLDER": "write the results there; default: the output of the file, else "
                           "NAME_results beside it",
        "--dry-run": "say what would be done, and write nothing",
    }
    | CLUSTER
    | shared("--json", "--quiet"),
}  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Do what is not done yet; 1 if a unit failed."""
    from torchliner.campaign.campaign_file import read_campaign
    from torchliner.campaign.cluster import open_cluster
    from torchliner.campaign.index import FAILED, index_text
    from torchliner.campaign.run import plan, run_campaign

    campaign = read_campaign(options.campaign, options.output)
    planned = plan(campaign)
    if options.dry_run:
        show_results(options, lambda: _plan_text(planned), lambda: _plain_plan(planned))
        return 0
    if campaign.figures:
        from torchliner.report.figure import require_matplotlib

        require_matplotlib()
    summary = _plan_text(planned, units=False)
    total = sum(2 * unit.samples for unit in planned.to_read.values())
    with (
        open_cluster(options.cluster, options.wait) as client,
        progress_bar(total, options.campaign.name, options) as bar,
    ):
        rows = run_campaign(campaign, client=client, progress=bar)
    text = f"{summary}\nresults in {campaign.output}, index.csv"
    show_results(options, lambda: f"{index_text(rows)}\n{text}", lambda: rows)
    return 1 if any(row["status"] == FAILED for row in rows) else 0


def _plan_text(planned: Any, units: bool = True) -> str:
    """A line a unit, and what all of it takes."""
    states = [planned.state(unit) for unit in planned.units]
    lines = [f"{unit.name}: {state}" for unit, state in zip(planned.units, states, strict=True)]
    lines += [f"{row['unit']}: cannot be opened: {row['error']}" for row in planned.failed]
    size = sum(unit.bytes for unit in planned.to_read.values())
    counts = [f"{states.count(state)} {state}" for state in dict.fromkeys(states)]
    counts += [f"{len(planned.failed)} cannot be opened"] * bool(planned.failed)
    summary = (
        f"{len(states) + len(planned.failed)} units: {', '.join(counts)}; "
        f"{len(planned.to_read)} planes to read, {size / 1e9:.3g} GB"
    )
    return "\n".join([*lines, summary] if units else [summary])


def _plain_plan(planned: Any) -> Any:
    return [{"unit": unit.name, "state": planned.state(unit)} for unit in planned.units] + [
        {"unit": row["unit"], "state": "failed", "error": row["error"]} for row in planned.failed
    ]
