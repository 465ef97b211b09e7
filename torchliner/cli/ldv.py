"""torchliner ldv: check, convert and educe bursts of laser Doppler stations."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import torchliner as tl
from torchliner import names
from torchliner.cli import options as opt
from torchliner.cli.choices import ALL, choices
from torchliner.cli.educe import strict_code
from torchliner.cli.files import preset_named, show_results
from torchliner.cli.messages import progress_bar
from torchliner.cli.signatures import of

if TYPE_CHECKING:
    from torchliner.bursts.stations import BurstFilters
    from torchliner.io.burst_sources import StationSource

FORMAT = [
    *of("io.burst_text:read_burst_columns", "columns separator", separator={"kind": names.SEPARATORS}),
    *of("io.dantec:read_dantec", "components coincidence_window", coincidence_window={"kind": opt.S}),
]
READING = [opt.Option("source", "file of bursts, or folder of stations", opt.PATH), *FORMAT]
PLACE = [
    opt.Option(f"--{axis}", f"of the station, {where}, m", opt.M)
    for axis, where in (("x", "along the duct"), ("y", "above the liner"), ("z", "across the duct"))
]
ABOUT = opt.group("about the case (not for HDF5 files; default: not stated)", *opt.CASE, *PLACE)
# What means something else where stations are educed.
FACTS = [each for each in ABOUT if each.flag not in ("--liner", "--title")]
LIMITS = of("bursts.stations:BurstFilters", "zero_runs outliers", group="which bursts count")
WITHOUT = opt.Option("--without", "switch off filters; default: none", names.FILTERS, nargs="+", default=[])
FILTERS = [*opt.group("which bursts count", WITHOUT), *LIMITS]
STATION = of(
    "bursts.choices:StationChoices",
    "method grid_rate band_limit correction segment overlap window flagged monte_carlo",
    group="from bursts to segments",
    method={"kind": names.GRID_METHODS},
    grid_rate={"kind": opt.HZ},
    band_limit={"kind": opt.HZ},
    overlap={"kind": opt.NUMBER},
    window={"kind": names.STATION_WINDOWS},
)
REFERENCE = opt.group(
    "reference channel (loudspeaker or microphone)",
    opt.Option("--reference", "one recording, or a folder with one a station (.npy, .wav, .mat, .h5)", opt.PATH),
    opt.Option("--reference-rate", "its sampling rate, Hz; default: that of a .wav", opt.HZ),
    opt.Option("--reference-start", "of its first sample, s, on the clock of the arrivals; default 0", opt.S),
)
RECORDINGS = (".npy", ".wav", ".mat", ".h5")
NOT_OF_STATIONS = ("averaging", "background", "missing", "allow_short")
CHOICES = [
    *choices(" ".join(name for name in ALL.split() if name not in (*NOT_OF_STATIONS, "reference_phase"))),
    *of("bursts.line:educe_bursts", "reference_phase", group="choices", reference_phase={"kind": opt.NUMBER}),
]
TASKS = {
    "info": (
        "describe and check stations",
        "Table of stations; exit code 1 if one is flagged.",
        [
            *READING,
            opt.output("write the table, SI units,", ".csv"),
            replace(opt.output("write histograms of the intervals", ".csv"), flag="--intervals"),
            *opt.figure("draw moments, rates and intervals there"),
            *opt.PRINTING,
            *ABOUT,
            *FILTERS,
        ],
        ("bursts/ --json",),
    ),
    "convert": (
        "write stations as one HDF5 file, or one as CSV",
        "Bursts as read, nothing dropped that can be read.",
        [
            *READING,
            opt.output("write the stations", *opt.HDF5, required=True),
            *opt.PRINTING,
            *ABOUT,
        ],
        ("bursts/ -o line.h5",),
    ),
    "educe": (
        "impedance along a line of stations",
        "Impedance of every station, segment by segment, and its averages;\nbroken off and called again with the same "
        "-o, it takes up the stations that are done.",
        [
            *READING,
            *opt.CLUSTER,
            opt.OF_LINER,
            *opt.PRINTING,
            opt.STRICT,
            opt.frequency("the tone", "--educe-at"),
            opt.output("write the line", *opt.RESULT),
            *opt.figure("draw Z along the line there"),
            *[each for each in ABOUT if each.flag != "--liner"],
            *FILTERS,
            *STATION,
            *REFERENCE,
            *CHOICES,
        ],
        ("bursts/ --frequency 1400 --liner onera -o line_z.h5",),
    ),
}


def run(options: argparse.Namespace) -> int:
    """The task named after ``ldv``."""
    return {"info": _info, "convert": _convert, "educe": _educe}[options.task](options)


def _stations(options: argparse.Namespace, about: list[opt.Option] = ABOUT) -> list[StationSource]:
    """The stations, still in their files."""
    said = opt.given(options, FORMAT)
    if "components" in said:
        said["components"] = said["components"].split(",")
    return tl.list_stations(options.source, **said, **opt.given(options, about))


def _filters(options: argparse.Namespace) -> BurstFilters:
    """Which bursts count."""
    chosen = opt.given(options, LIMITS)
    for name in options.without:
        key = name.replace("-", "_")
        if key in chosen:
            raise ValueError(f"--{name} is given and switched off by --without; take one away")
        chosen[key] = False if key == "times" else None
    return tl.BurstFilters(**chosen)


def _info(options: argparse.Namespace) -> int:
    from torchliner.bursts.stations import Station
    from torchliner.report import station_report as report

    filters = _filters(options)
    stations = [Station.of(source.read(), filters) for source in _stations(options)]
    if options.intervals is not None:
        report.intervals_of(stations).write_csv(options.intervals)
    show_results(
        options,
        report.format_stations(stations),
        report.plain_stations(stations),
        output=report.station_table(stations).write_csv,
        figure=lambda path: report.draw_stations(stations, path),
    )
    return 1 if any(station.flags for station in stations) else 0


def _convert(options: argparse.Namespace) -> int:
    from torchliner.io.burst_sources import write_bursts

    records = [source.read() for source in _stations(options)]
    write_bursts(records, options.output)
    bursts = sum(record.bursts for record in records)
    plain = {"output": str(options.output), "stations": len(records), "bursts": bursts}
    show_results(options, f"{options.output}: {len(records)} stations, {bursts} bursts", plain)
    return 0


def _educe(options: argparse.Namespace) -> int:
    """Educe every station, print a row each and the averages, write what was asked for."""
    from torchliner.campaign.cluster import open_cluster
    from torchliner.io.line_parts import LineParts
    from torchliner.io.result_writers import require_result
    from torchliner.io.whole_file import writable_folder
    from torchliner.records.origin import input_file, with_choices
    from torchliner.report.line_table import format_line, plain_line

    chosen = opt.given(options, [*CHOICES, *STATION]) | {"filters": _filters(options)}
    if options.cluster is not None:  # workers may be in other folders
        options.source = options.source.absolute()
    sources = _stations(options, FACTS)
    liner = tl.load_liner(options.liner or preset_named(sources[0].read().liner, sources[0].path))
    parts = None
    if options.output is not None:
        require_result(options.output, len(options.educe_at or [0]))
        parts = LineParts(f"{options.output}.parts")
        writable_folder(parts.folder)
        if parts.there and not options.quiet:
            taken = f"{parts.there} finished stations: those of these data are taken"
            print(f"{parts.folder} holds {taken}", file=sys.stderr)
    with (
        open_cluster(options.cluster, options.wait) as client,
        progress_bar(len(sources), options.source.name, options, "station") as step,
    ):
        chosen |= {"reference": _reference(options), "parts": parts, "progress": step, "client": client}
        line = with_choices(tl.educe_bursts(sources, liner, options.educe_at, **chosen), command=options.typed)
    if options.reference is not None and options.reference.is_dir():
        channels = input_file("reference channels", options.reference)
        line = with_choices(line, inputs=[*line.choices["inputs"], channels])
    if options.title is not None:
        line = replace(line, title=options.title)
    show_results(options, format_line(line), plain_line(line), output=line.write, figure=line.plot)
    if parts is not None:
        parts.clear()
    return strict_code(options, line)


def _reference(options: argparse.Namespace) -> Any:
    """A channel for all stations, or a function that reads that of each."""
    path = options.reference
    if path is None:
        if options.reference_rate is not None or options.reference_start is not None:
            raise ValueError("--reference-rate and --reference-start are of a --reference; name the recording")
        return None

    def read(recording: Any) -> tl.ReferenceChannel:
        found = tl.read_signal(recording, options.reference_rate)
        return tl.ReferenceChannel(found.signal, found.sampling_rate, options.reference_start or 0.0, str(recording))

    def of_station(source: StationSource) -> tl.ReferenceChannel:
        stem = source.path.stem if source.number is None else f"{source.path.stem}_{source.number}"
        there = (path / f"{stem}{suffix}" for suffix in RECORDINGS)
        recording = next((each for each in there if each.exists()), None)
        if recording is None:
            raise FileNotFoundError(f"{path} holds no recording {stem}{{{','.join(RECORDINGS)}}} for {source.name}")
        return read(recording)

    return of_station if path.is_dir() else read(path)
