"""Commands for files of planes, many planes, and planes that grow: info, convert, reduce, run, follow, report."""

import argparse
from contextlib import nullcontext
from dataclasses import replace
from math import inf
from typing import Any

import torchliner as tl
from torchliner.campaign.campaign_file import read_campaign
from torchliner.campaign.follow import Frames
from torchliner.campaign.follow import follow as following
from torchliner.campaign.index import FAILED, index_table, report_campaign
from torchliner.campaign.run import plan, run_campaign
from torchliner.campaign.workers import open_cluster
from torchliner.checks import require_positive, tell
from torchliner.cli import work
from torchliner.io.plane_writer import write_plane
from torchliner.io.planes import format_of, paths_of
from torchliner.records.notes import plane_notes
from torchliner.report.figure import require_matplotlib
from torchliner.report.inspection import inspect_moments, inspect_plane
from torchliner.report.page import report_file, require_report

STANDING = ("samples", "record s", "f Hz", "R", "X", "half-width", "needed s")


def run(options: argparse.Namespace) -> int:
    """Run a campaign of planes, liners and choices; resumable."""
    campaign = read_campaign(options.campaign, options.output)
    planned = plan(campaign)
    units = [{"unit": unit.name, "state": state} for unit, state in planned.units]
    units += [{"unit": row["unit"], "state": f"cannot be opened: {row['error']}"} for row in planned.failed]
    to_read = planned.to_read.values()
    size = sum(each.plane.velocity.dtype.itemsize * each.plane.samples * each.plane.probes for each in to_read)
    summary = f"{len(units)} units; {len(to_read)} planes to read, {size / 1e9:.3g} GB"
    if options.dry_run:
        work.show(options, work.told(summary, units, *(f"{u['unit']}: {u['state']}" for u in units)), lambda _: None)
        return 0
    if campaign.stated.figures:
        require_matplotlib()
    total = sum(2 * unit.plane.samples for unit in to_read)
    cluster = open_cluster(options.cluster, options.wait) if options.cluster else nullcontext()
    with cluster as client, work.progress_bar(total, options) as step:
        rows = run_campaign(campaign, client=client, progress=step)
    words = f"{index_table(rows).as_text()}\n{summary}\nresults in {campaign.output}, index.csv"
    work.show(options, work.told(words, index_table(rows).as_rows()), lambda _: None)
    return int(any(row["status"] == FAILED for row in rows))


def follow(options: argparse.Namespace) -> int:
    """Impedance and its interval while a plane is being written."""
    for name in ("every", "idle"):
        require_positive(f"--{name}", getattr(options, name))
    frames = Frames(options.plane, options.reading)
    first = tl.read_plane(frames.files()[0], lazy=True, **frames.request)
    (liner,) = work.liners_of(options, [first], [options.plane])
    output, options.output = options.output, None  # written once, at the end
    if not options.json:
        print("".join(f"{name:12s}" for name in STANDING), flush=True)
    wish: dict[str, Any] = {name: getattr(options, name) for name in ("every", "idle", "until")}
    latest = None
    try:
        for latest in following(frames, liner, options.frequency, **wish, **options.chosen):
            for row in latest[1]:
                work.show(options, work.told(_standing(row), row))
    finally:  # whatever ends it leaves what there is
        if output is not None and latest is not None and latest[0].periods:
            latest[0].moments().write(output)
    rows = [] if latest is None else latest[1]
    reached = options.until is None or (rows and all((row["half_width"] or inf) <= options.until for row in rows))
    return 0 if reached else 1


def _standing(row: dict[str, Any]) -> str:
    """A line, in the order of ``STANDING``."""
    numbers = (row["duration"], row["frequency"], row["impedance"].real, row["impedance"].imag)
    several = (*numbers, row["half_width"], row["needed"])
    return f"{row['samples']:<12d}" + "".join(f"{'-' if v is None else format(v, '.4g'):12s}" for v in several)


def report(options: argparse.Namespace) -> None:
    """HTML page of a result, to read, attach and repeat."""
    require_report()
    write = report_campaign if options.result.is_dir() else report_file
    answer = write(options.result, options.output)
    plain = {"title": answer.title, "answer": " ".join(answer.lines), "level_check": answer.state}
    work.show(options, work.told(answer.screen(), plain, str(options.output)), lambda _: None)


def info(options: argparse.Namespace) -> int:
    """Describe and check a velocity plane."""
    (plane,) = work.read_records([options.plane], options)
    if isinstance(plane, tl.VelocityPlane):
        found = inspect_plane(plane)
        found.facts["format"] = ", ".join({format_of(each).name: 0 for each in paths_of(options.plane)})
    else:
        found = inspect_moments(plane)
    facts = found.facts | {"not stated": ", ".join(found.missing) or None}
    checks = [f"check failed: {each}" for each in found.failures] or ["all checks passed"]
    work.show(options, work.told(work.facts_text(facts), found._asdict(), *checks))
    return int(bool(found.failures))


def convert(options: argparse.Namespace) -> None:
    """Write a plane file from files of any format."""
    (plane,) = work.read_planes([options.plane], options)
    plane = replace(plane, **options.facts, provenance={**plane.provenance, "file": options.plane.name})
    tell([note.text for note in plane_notes(plane, plane.frequency)])
    size = plane.velocity.dtype.itemsize * plane.probes * plane.samples
    with work.progress_bar(size, options, unit="B") as step:
        write_plane(plane, options.output, progress=step)
    plain = {"output": str(options.output), "probes": [*plane.probe_shape], "samples": plane.samples}
    plain["sampling_rate"] = float(plane.sampling_rate)
    shape = "x".join(map(str, plane.probe_shape)) or "1"
    words = f"{options.output}: {shape} probes, {plane.samples} samples at {plane.sampling_rate:g} Hz"
    work.show(options, work.told(words, plain), lambda _: None)


def reduce(options: argparse.Namespace) -> None:
    """Moments of a plane, enough for any liner later, without the data."""
    (plane,) = planes = work.read_planes([options.plane], options)
    liner = None if options.liner is None else tl.load_liner(options.liner)
    known = tl.load_liner(plane.liner) if liner is None and plane.liner in tl.preset_names() else liner
    pitch = options.cell_pitch
    if pitch is None and liner is None and known is not None:
        pitch = known.cell_pitch
    with work.progress_bar(work.samples_of(planes), options) as step:
        found = tl.moments(plane, liner, options.frequency, cell_pitch=pitch, progress=step, **work.choices_of(options))
    facts: dict[str, Any] = {"output": str(options.output)} | inspect_moments(found).facts
    if known is not None:
        facts["error in R"] = found.error(known, liner and (options.frequency or plane.frequency))
    work.show(options, work.told(work.facts_text(facts), facts), found.write)
