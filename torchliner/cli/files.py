"""Commands for files of planes: info, convert, reduce."""

import argparse
from dataclasses import replace
from typing import Any

import torchliner as tl
from torchliner.checks import tell
from torchliner.cli import work
from torchliner.io.plane_writer import write_plane
from torchliner.io.planes import format_of, paths_of
from torchliner.records.notes import plane_notes
from torchliner.report.inspection import inspect_moments, inspect_plane


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
    if "incident_level" in options.facts:  # of the plane as written
        plane = replace(plane, incident_level=None)
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
    """Moments of a plane: any liner later, without the data."""
    (plane,) = planes = work.read_planes([options.plane], options)
    liner = None if options.liner is None else tl.load_liner(options.liner)
    known = tl.load_liner(plane.liner) if liner is None and plane.liner in tl.preset_names() else liner
    pitch = options.cell_pitch
    if pitch is None and liner is None and known is not None:
        pitch = known.cell_pitch
    if "background" in options.chosen:
        options.chosen["background"] = work.background_of(options.chosen["background"])
    with work.progress_bar(work.samples_of(planes), options) as step:
        found = tl.moments(plane, liner, options.frequency, cell_pitch=pitch, progress=step, **options.chosen)
    facts: dict[str, Any] = {"output": str(options.output)} | inspect_moments(found).facts
    if known is not None:
        facts["error in R"] = found.error(known, liner and (options.frequency or plane.frequency))
    work.show(options, work.told(work.facts_text(facts), facts), found.write)
