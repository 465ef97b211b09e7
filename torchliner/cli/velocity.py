"""Commands that educe an impedance from velocity: educe, replay."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import torchliner as tl
from torchliner.cli.inputs import (
    incident_signal,
    liners_of,
    planes_of,
    read_planes,
    read_records,
    samples_of,
    with_facts,
)
from torchliner.cli.show import progress_bar, show
from torchliner.io.microphone_file import read_wall_pressure
from torchliner.io.result_writers import require_result
from torchliner.io.whole_file import writable
from torchliner.pressure.dean import with_in_situ
from torchliner.records.origin import with_choices
from torchliner.report.of_map import draw_pictures


def educe(options: argparse.Namespace) -> int:
    """Impedance map of one or several velocity planes."""
    pressure = None if options.in_situ is None else tl.read_pressure(options.in_situ)
    wall = None if options.wall_pressure is None else read_wall_pressure(options.wall_pressure)
    records = [with_facts(each, options.facts) for each in read_records(options.planes, options)]
    planes = planes_of(records)
    outputs = _outputs(options, planes, len(options.frequency or [0]))
    liners, found = liners_of(options, records, options.planes), []
    with progress_bar(samples_of(planes), options) as step:
        about = {"pressure": wall or pressure, "progress": step} | options.chosen
        for record, liner in zip(records, liners, strict=True):
            found.append(tl.educe(record, liner, options.frequency, **about))
    if pressure is not None:
        found = with_in_situ(found, planes, pressure)
    return _finish(options, found, planes, outputs)


def replay(options: argparse.Namespace) -> int:
    """The same under any incident wave, with the reflected signal."""
    incident = incident_signal(options)
    (plane,) = planes = read_planes([options.plane], options)
    outputs = _outputs(options, planes, len(options.frequency or [0]) if incident is None else math.inf)
    incident = incident or options.frequency or plane.frequency
    if incident is None:
        raise ValueError(f"{options.plane} states no tone; name --incident or --frequency")
    (liner,) = liners_of(options, planes, [options.plane])
    with progress_bar(plane.samples, options) as step:
        about = {"reflected": options.reflected, "progress": step} | options.chosen
        found = tl.replay(plane, liner, incident, options.frequency, **about)
    return _finish(options, [found], planes, outputs)


def _outputs(options: argparse.Namespace, planes: list[Any], frequencies: float) -> list[Path]:
    """The map file of each plane, if any: of several their names are appended."""
    path: Path | None = options.output
    if path is None:
        return []
    found = [path]
    if len(planes) > 1:
        found = [path.with_stem(f"{path.stem}_{each.stem}") for each in options.planes]
    if len(set(found)) < len(planes):
        raise ValueError("planes of the same name would share one map file; educe them one by one")
    for each, plane in zip(found, planes, strict=True):
        writable(each)
        require_result(each, frequencies, plane.x is not None or plane.z is not None)
    return found


def _finish(options: argparse.Namespace, found: list[Any], planes: list[Any], outputs: list[Path]) -> int:
    """Write, draw and print maps; the exit code."""
    found = [with_choices(each, command=options.typed) for each in found]

    def write(_: Any) -> None:
        for path, result in zip(outputs, found, strict=True):
            result.write(path)

    show(options, found, write, lambda folder: draw_pictures(found, planes, folder))
    return strict_code(options, *found)


def strict_code(options: argparse.Namespace, *results: Any) -> int:
    """1 with --strict where the level check of a map or a line fails, else 0."""
    return int(options.strict and any(each.level_check is not None and each.level_check.failed for each in results))
