"""Commands for files: demo, info, convert, run, report."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import replace
from importlib import resources
from importlib.util import find_spec
from typing import Any

import torchliner as tl
from torchliner.cli import kinds
from torchliner.cli import options as opt
from torchliner.cli.inputs import planes_of, read_planes, read_records
from torchliner.cli.kinds import Command, Option
from torchliner.cli.output import facts_text, progress_bar, show

DEMO_PLANES = ("slit_n130_y0.5mm.h5", "slit_n130_y2.5mm.h5")


def demo(options: argparse.Namespace) -> int:
    """The main job on two shipped planes, by the command that one would type."""
    from torchliner.cli.main import main

    with resources.as_file(resources.files("torchliner").joinpath("demo_planes")) as folder:
        words = ["educe", *(str(folder / name) for name in DEMO_PLANES)]
        if options.folder is not None:
            words += ["-o", str(options.folder)]
            if find_spec("matplotlib") is not None:
                words += ["--figure", str(options.folder)]
        about = "A slit liner under 130 dB without flow, at 0.5 and 2.5 mm, from a simulation that resolves its holes."
        print(f"{about}\n$ torchliner {shlex.join(words)}\n", flush=True)
        code = main([*words, "--quiet"])
    if options.folder is not None and code == 0:
        print(f"\nMaps (.h5), numbers (.csv) and pictures (.png) are in {options.folder}")
    return code


def info(options: argparse.Namespace) -> int:
    """Print the description; 1 if a check fails."""
    from torchliner.io.planes import format_of, paths_of
    from torchliner.report.curves import draw_velocity
    from torchliner.report.inspection import inspect_moments, inspect_plane

    # Of moments there is nothing to draw: the plane is asked for.
    read: Any = read_records if options.figure is None else read_planes
    (plane,) = read([options.plane], options)
    if isinstance(plane, tl.VelocityPlane):
        found = inspect_plane(plane)
        found.facts["format"] = ", ".join({format_of(each).name: 0 for each in paths_of(options.plane)})
    else:
        found = inspect_moments(plane)

    missing = {"not stated": ", ".join(found.missing) or None}
    checks = [f"check failed: {each}" for each in found.failures] or ["all checks passed"]
    show(
        options,
        {"facts": found.facts, "failures": found.failures, "missing": found.missing},
        lambda _: "\n".join([facts_text(found.facts | missing), *checks]),
        draw=lambda _, path: draw_velocity(planes_of([plane]), path),
    )
    return 1 if found.failures else 0


def convert(options: argparse.Namespace) -> None:
    """Read, scale, write, and say what was written."""
    from torchliner.checks import tell
    from torchliner.io.plane_selection import scaled
    from torchliner.io.plane_writer import write_plane
    from torchliner.records.unit_checks import plane_unit_warnings

    plane = tl.read_plane(options.source, lazy=True, **options.chosen)
    facts = opt.given(options, ABOUT)
    if "incident_level" in facts:  # of the plane as written
        plane = replace(plane, incident_level=None)
    if (options.scale_length, options.scale_velocity) != (1.0, 1.0):
        plane = scaled(plane, options.scale_length, options.scale_velocity)
    plane = replace(plane, **facts, provenance={**plane.provenance, "file": options.source.name})
    tell(plane_unit_warnings(plane, plane.frequency))
    size = plane.velocity.dtype.itemsize * plane.probes * plane.samples * (1 if plane.streamwise is None else 2)
    with progress_bar(size, options.source, options, unit="B") as step:
        write_plane(plane, options.output, options.compress, progress=step)
    found = {
        "output": str(options.output),
        "probes": list(plane.probe_shape),
        "samples": plane.samples,
        "sampling_rate": float(plane.sampling_rate),
    }
    shape = "x".join(map(str, plane.probe_shape)) or "1"
    words = f"{options.output}: {shape} probes, {plane.samples} samples at {plane.sampling_rate:g} Hz"
    show(options, found, lambda _: words)


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
        show(options, units, lambda _: "\n".join([*lines, summary]))
        return 0
    if campaign.figures:
        from torchliner.report.figure import require_matplotlib

        require_matplotlib()
    total = sum(2 * unit.samples for unit in planned.to_read.values())
    with open_cluster(options.cluster, options.wait) as client, progress_bar(total, options.campaign, options) as bar:
        rows = run_campaign(campaign, client=client, progress=bar)
    text = f"{index_text(rows)}\n{summary}\nresults in {campaign.output}, index.csv"
    show(options, rows, lambda _: text)
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


def report(options: argparse.Namespace) -> None:
    """Write the page and print its one sentence."""
    from torchliner.campaign.page import report_campaign
    from torchliner.report.page import report_file, require_report

    require_report()
    if options.result.is_dir():
        answer, written = report_campaign(options.result, options.output, cases=options.cases)
    elif options.cases:
        raise ValueError(f"--cases is for the folder of a campaign; {options.result} is a file")
    else:
        answer, written = report_file(options.result, options.output), [options.output]
    facts = {"title": answer.title, "answer": " ".join(answer.lines), "level_check": answer.state}
    show(options, facts | {"written": [*map(str, written)]}, lambda _: f"{answer.screen()}\n{options.output}")


SCALING = "scaling (time scales by length over velocity)"
ABOUT = opt.group(
    "about the case (SI, of the plane as written; default: not stated)",
    Option("--height", "above the liner, m", kinds.M),
    *opt.CASE,
)
RESULT = (
    "map, line, points, impedances from microphones (kt -o) or a solved duct (duct solve -o) as .h5/.nc, or the "
    "folder of a campaign"
)
COMMANDS = {
    "demo": Command(
        demo,
        [Option("--folder", "write maps and, with matplotlib, pictures here; default: the table alone", kinds.FOLDER)],
        ("",),
    ),
    "info": Command(info, [opt.ONE_PLANE, opt.figure("draw v0, v', u' along x there")], ("plane.h5",)),
    "convert": Command(
        convert,
        [
            Option("source", "file or folder of any format of planes, or 'run_*.nc': restarts to join", kinds.PATH),
            opt.output("write the plane", *opt.HDF5, required=True),
            *(Option("--compress", "gzip: smaller, slower to read"), *ABOUT),
            Option("--scale-length", "of lengths; default 1", kinds.NUMBER, default=1.0, group=SCALING),
            Option("--scale-velocity", "of velocities; default 1", kinds.NUMBER, default=1.0, group=SCALING),
        ],
        ("'run_*.nc' -o plane.h5 --normal y",),
        [*opt.SELECTION, *opt.STATED],
    ),
    "run": Command(
        run,
        [
            Option("campaign", "TOML file of a campaign", kinds.PATH),
            Option("--output", "write the results there; default: as the file says, else NAME_results", kinds.FOLDER),
            *(Option("--dry-run", "say what would be done, and write nothing"), *opt.CLUSTER),
        ],
        ("campaign.toml", "campaign.toml --dry-run"),
    ),
    "report": Command(
        report,
        [
            *(Option("result", RESULT, kinds.PATH), opt.output("write the page", ".html", required=True)),
            Option("--cases", "of a campaign: a page for each case as well, in OUTPUT_cases beside"),
        ],
        ("map.h5 -o report.html", "kt.h5 -o report.html", "results -o campaign.html --cases"),
    ),
}
