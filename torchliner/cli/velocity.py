"""Commands that educe an impedance from velocity: educe, replay, ldv info, ldv educe."""

import argparse
import shutil
import sys
from pathlib import Path
from typing import Any

import torchliner as tl
from torchliner.bursts.stations import Station
from torchliner.cli import work
from torchliner.engine.moments import ReducedVelocity
from torchliner.io.burst_sources import StationSource
from torchliner.io.result_writers import require_places
from torchliner.io.whole_file import writable, writable_folder
from torchliner.pressure.dean import with_in_situ
from torchliner.records.origin import with_choices


def educe(options: argparse.Namespace) -> int:
    """Impedance map of one or several velocity planes."""
    pressure = None if options.in_situ is None else tl.read_pressure(options.in_situ)
    wall = None if options.wall_pressure is None else tl.read_pressure(options.wall_pressure)
    records = [work.with_facts(each, options.facts) for each in work.read_records(options.planes, options)]
    planes = work.planes_of(records)
    outputs = _outputs(options, planes)
    liners, found = work.liners_of(options, records, options.planes), []
    with work.progress_bar(work.samples_of(planes), options) as step:
        about = {"pressure": wall or pressure, "progress": step} | work.choices_of(options)
        for record, liner in zip(records, liners, strict=True):
            found.append(tl.educe(record, liner, options.frequency, **about))
    if pressure is not None:
        found = with_in_situ(found, planes, pressure)
    return _finish(options, found, planes, outputs)


def replay(options: argparse.Namespace) -> int:
    """Impedance map under any incident wave, with the reflected signal."""
    incident = work.incident_signal(options)
    (plane,) = planes = work.read_planes([options.plane], options)
    outputs = _outputs(options, planes)
    incident = incident or options.frequency or plane.frequency
    if incident is None:
        raise ValueError(f"{options.plane} states no tone; name --incident or --frequency")
    (liner,) = work.liners_of(options, planes, [options.plane])
    with work.progress_bar(plane.samples, options) as step:
        about = {"reflected": options.reflected, "progress": step} | options.chosen
        found = tl.replay(plane, liner, incident, options.frequency, **about)
    return _finish(options, [found], planes, outputs)


def _outputs(options: argparse.Namespace, planes: list[Any]) -> list[Path]:
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
        require_places(each, plane.x is not None or plane.z is not None)
    return found


def _finish(options: argparse.Namespace, found: list[Any], planes: list[Any], outputs: list[Path]) -> int:
    """Write, draw and print maps; the exit code."""
    found = [with_choices(each, command=options.typed) for each in found]

    def write(_: Path) -> None:
        for path, result in zip(outputs, found, strict=True):
            result.write(path)

    whole = not any(isinstance(each.velocity, ReducedVelocity) for each in planes)  # of moments there is none to draw
    work.show(options, found, write, planes=planes if whole else ())
    return int(options.strict and any(each.level_check is not None and each.level_check.failed for each in found))


def ldv_info(options: argparse.Namespace) -> int:
    """Describe and check bursts of laser Doppler stations."""
    stations = [Station.of(source.read(), options.without) for source in _stations(options)]
    work.show(options, stations)
    return int(any(station.flags for station in stations))


def ldv_educe(options: argparse.Namespace) -> None:
    """Impedance along a line of laser Doppler stations; resumable with -o."""
    sources, parts = _stations(options), None
    liner = tl.load_liner(options.liner or work.preset_named(sources[0].read().liner, sources[0].path))
    if options.output is not None:
        parts = Path(f"{options.output}.parts")
        writable_folder(parts)
        if (there := len([*parts.glob("*.h5")])) and not options.quiet:
            print(f"{parts} holds {there} finished stations, which are taken up", file=sys.stderr)
    with work.progress_bar(len(sources), options, "station") as step:
        about = options.chosen | {"without": options.without, "parts": parts, "progress": step}
        line = with_choices(tl.educe_bursts(sources, liner, options.educe_at, **about), command=options.typed)
    work.show(options, line, line.write)
    if parts is not None:
        shutil.rmtree(parts, ignore_errors=True)


def _stations(options: argparse.Namespace) -> list[StationSource]:
    """The stations, still in their files."""
    if "components" in options.reading:
        options.reading["components"] = options.reading["components"].split(",")
    return tl.list_stations(options.source, **options.reading, **options.facts)
