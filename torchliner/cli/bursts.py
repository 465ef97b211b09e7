"""torchliner ldv: check, convert and educe bursts of laser Doppler stations."""

from __future__ import annotations

import argparse
import sys
from typing import Any

import torchliner as tl
from torchliner.bursts.stations import Station
from torchliner.cli.inputs import preset_named
from torchliner.cli.show import progress_bar, show, told
from torchliner.cli.velocity import strict_code
from torchliner.io.burst_sources import StationSource, write_bursts
from torchliner.io.line_parts import LineParts
from torchliner.io.result_writers import require_result
from torchliner.io.whole_file import writable_folder
from torchliner.records.origin import input_file, with_choices

RECORDINGS = (".npy", ".wav", ".mat", ".h5")


def info(options: argparse.Namespace) -> int:
    """Bursts of laser Doppler stations: describe and check."""
    filters = _filters(options)
    stations = [Station.of(source.read(), filters) for source in _stations(options)]
    show(options, stations)
    return int(any(station.flags for station in stations))


def convert(options: argparse.Namespace) -> None:
    """The same: write stations as one HDF5 file."""
    records = [source.read() for source in _stations(options)]
    bursts = sum(record.bursts for record in records)
    plain = {"output": str(options.output), "stations": len(records), "bursts": bursts}
    words = f"{options.output}: {len(records)} stations, {bursts} bursts"
    show(options, told(words, plain), lambda path: write_bursts(records, path))


def educe(options: argparse.Namespace) -> int:
    """The same: impedance along a line of stations; resumable with -o."""
    sources, parts = _stations(options), None
    liner = tl.load_liner(options.liner or preset_named(sources[0].read().liner, sources[0].path))
    if options.output is not None:
        require_result(options.output, len(options.educe_at or [0]))
        parts = LineParts(f"{options.output}.parts")
        writable_folder(parts.folder)
        if parts.there and not options.quiet:
            print(f"{parts.folder} holds {parts.there} finished stations, which are taken up", file=sys.stderr)
    with progress_bar(len(sources), options, "station") as step:
        about = {"filters": _filters(options), "reference": _reference(options), "parts": parts, "progress": step}
        line = tl.educe_bursts(sources, liner, options.educe_at, **options.chosen, **about)
    line = with_choices(line, command=options.typed)
    if options.reference is not None and options.reference.is_dir():
        channels = input_file("reference channels", options.reference)
        line = with_choices(line, inputs=[*line.choices["inputs"], channels])
    show(options, line, line.write)
    if parts is not None:
        parts.clear()
    return strict_code(options, line)


def _stations(options: argparse.Namespace) -> list[StationSource]:
    """The stations, still in their files."""
    if "components" in options.reading:
        options.reading["components"] = options.reading["components"].split(",")
    return tl.list_stations(options.source, **options.reading, **options.facts)


def _filters(options: argparse.Namespace) -> tl.BurstFilters:
    """Which bursts count."""
    chosen: dict[str, Any] = {name.replace("-", "_"): None for name in options.without}
    return tl.BurstFilters(**chosen | ({"times": False} if "times" in chosen else {}))


def _reference(options: argparse.Namespace) -> Any:
    """A channel for all stations, or a function that reads that of each."""
    path, rate, start = options.reference, options.reference_rate, options.reference_start

    def read(recording: Any) -> tl.ReferenceChannel:
        found = tl.read_signal(recording, rate)
        return tl.ReferenceChannel(found.signal, found.sampling_rate, start, str(recording))

    def of_station(source: StationSource) -> tl.ReferenceChannel:
        stem = source.path.stem if source.number is None else f"{source.path.stem}_{source.number}"
        for suffix in RECORDINGS:
            if (recording := path / f"{stem}{suffix}").exists():
                return read(recording)
        raise FileNotFoundError(f"{path} holds no recording {stem}{{{','.join(RECORDINGS)}}} for {source.name}")

    if path is None:
        return None
    return of_station if path.is_dir() else read(path)
