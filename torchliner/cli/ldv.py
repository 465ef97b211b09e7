"""torchliner ldv: check, convert and educe bursts of laser Doppler stations."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from torchliner import names
from torchliner.cli.choice_options import EDUCED, choice_options, chosen_from
from torchliner.cli.files import preset_named, show_results
from torchliner.cli.options import CASE, CLUSTER, dest, frequency_option, level_check_code, progress_bar, shared, stated

if TYPE_CHECKING:
    from torchliner.bursts.stations import BurstFilters
    from torchliner.io.burst_sources import StationSource

READING: dict[str, Any] = {
    "source SOURCE": "file of bursts, or folder of stations",
    "--columns LIST": "of files without a header: 'row, arrival_time [ms], transit_time [us], streamwise [m/s], "
    "wall_normal [m/s]'; default: those of the header",
    "--separator": {"choices": names.SEPARATORS, "default": "blank", "help": "without a header; default blank"},
    "--components LIST": "what LDA1, LDA2, ... of DXEX files hold: streamwise,wall_normal,skip; a minus turns one "
    "(write --components=-wall_normal); default: not stated",
    "--coincidence-window S": "pair channels of non-coincidence files within so many s; default: do not pair",
}
ABOUT = CASE | {f"--{axis} M": f"of the station, {where}, m" for axis, where in (
    ("x", "along the duct"), ("y", "above the liner"), ("z", "across the duct"))}  # fmt: skip
UNSTATED = "about the case (not for HDF5 files; default: not stated)"
FILTERS = {
    "which bursts count": {
        "--without FILTER ...": {
            "choices": names.FILTERS,
            "default": [],
            "help": f"switch off {', '.join(names.FILTERS)}; default: none is off",
        },
        "--zero-runs N": "shortest run of exact zeros that is dropped; default 10",
        "--outliers FACTOR": "limit in standard deviations, by the medians; default 6",
    }
}
STATION = {
    "--method": (names.GRID_METHODS, "of reconstruction between arrivals; default linear"),
    "--grid-rate HZ": "Hz; default: twice the mean rate of the station at least, in whole steps a period",
    "--band-limit HZ": "of --method band-limited, Hz; default a quarter of the station's mean rate",
    "--correction": (names.CORRECTIONS, "put back what the reconstruction took from the tone; default tone"),
    "--segment S": "length, s; default 1",
    "--overlap SHARE": "of segments, 0 to 1; default 0.5",
    "--window": (names.STATION_WINDOWS, "of a segment; default whole-periods, each of which weighs alike"),
    "--flagged": (names.FLAGGED, "stations with doubtful bursts, in averages; default exclude"),
    "--monte-carlo N": "draws of eq. (5.2); default 5000",
}
REFERENCE = {
    "--reference PATH": "a recording for all stations, or a folder with one a station, of its file's name: .npy, .wav, "
    ".mat, .h5; default: none",
    "--reference-rate HZ": "its sampling rate, Hz; default: that of a .wav",
    "--reference-start S": "time of its first sample on the clock of the arrivals, s; default 0",
}
RECORDINGS = (".npy", ".wav", ".mat", ".h5")
CHOICES = [name for name in EDUCED if name not in ("averaging", "background_rms", "missing", "allow_short")]
PHASE = "for --phase given: x(t) = cos(2 pi f t + RAD), or its lead over the reference; default: none"
TASKS = {
    "info": (
        "describe and check stations",
        "Table of stations; exit code 1 if one is flagged.",
        {
            "": READING
            | {
                "--output FILE": "write the table as .csv, SI units",
                "--intervals FILE": "write histograms of the intervals as .csv",
                "--figure PICTURE": "draw moments, rates and intervals there",
            }
            | shared("--json", "--quiet"),
            UNSTATED: ABOUT,
        }
        | FILTERS,
    ),
    "convert": (
        "write stations as one HDF5 file, or one as CSV",
        "Bursts as read, nothing dropped that can be read.",
        {
            "": READING
            | {"--output FILE": {"required": True, "help": "write the stations as .h5/.nc, or one as .csv"}}
            | shared("--json", "--quiet"),
            UNSTATED: ABOUT,
        },
    ),
    "educe": (
        "impedance along a line of stations",
        "Impedance of every station, segment by segment, and its averages; broken off and called again with the same "
        "-o, it takes up the stations that are done.",
        {
            "": READING
            | CLUSTER
            | shared("--liner", "--json", "--quiet", "--strict")
            | frequency_option("the tone", "--educe-at")
            | {
                "--output FILE": f"write the line as {names.RESULT_ENDINGS}",
                "--figure PICTURE": "draw Z along the line there",
            },
            UNSTATED: {spec: text for spec, text in ABOUT.items() if spec != "--liner NAME"},
        }
        | FILTERS
        | {"from bursts to segments": STATION, "reference channel (loudspeaker or microphone)": REFERENCE}
        | choice_options(CHOICES, {"--reference-phase RAD": PHASE}),
    ),
}


def run(options: argparse.Namespace) -> int:
    """The task named after ``ldv``."""
    return {"info": _info, "convert": _convert, "educe": _educe}[options.task](options)


def _stations(options: argparse.Namespace, *left_out: str) -> list[StationSource]:
    """The stations, still in their files; ``left_out`` means something else in this task."""
    from torchliner.io.burst_sources import list_stations

    components = None if options.components is None else options.components.split(",")
    about = stated(options, (key for key in map(dest, ABOUT) if key not in left_out))
    reading = options.columns, options.separator, components, options.coincidence_window
    return list_stations(options.source, *reading, **about)


def _filters(options: argparse.Namespace) -> BurstFilters:
    """Which bursts count."""
    from torchliner.bursts.stations import BurstFilters

    chosen = stated(options, ("zero_runs", "outliers"))
    for name in options.without:
        key = name.replace("-", "_")
        if key in chosen:
            raise ValueError(f"--{name} is given and switched off by --without; take one away")
        chosen[key] = False if key == "times" else None
    return BurstFilters(**chosen)


def _info(options: argparse.Namespace) -> int:
    from torchliner.bursts.stations import Station
    from torchliner.report import station_report as report

    filters = _filters(options)
    stations = [Station.of(source.read(), filters) for source in _stations(options)]
    if options.intervals is not None:
        report.intervals_of(stations).write_csv(options.intervals)
    show_results(
        options,
        lambda: report.format_stations(stations),
        lambda: report.plain_stations(stations),
        output=report.station_table(stations).write_csv,
        figure=lambda path: report.draw_stations(stations, path),
    )
    return 1 if any(station.flags for station in stations) else 0


def _convert(options: argparse.Namespace) -> int:
    from torchliner.io.burst_file import write_bursts

    records = [source.read() for source in _stations(options)]
    bursts = sum(record.bursts for record in records)
    show_results(
        options,
        lambda: f"{options.output}: {len(records)} stations, {bursts} bursts",
        lambda: {"output": str(options.output), "stations": len(records), "bursts": bursts},
        output=lambda path: write_bursts(records, path),
    )
    return 0


def _educe(options: argparse.Namespace) -> int:
    """Educe every station, print a row each and the averages, write what was asked for."""
    from torchliner.bursts.line import educe_bursts
    from torchliner.campaign.cluster import open_cluster
    from torchliner.io.line_parts import LineParts
    from torchliner.io.result_writers import require_result
    from torchliner.io.whole_file import writable_folder
    from torchliner.liners.catalogue import load_liner
    from torchliner.records.origin import input_file, with_choices
    from torchliner.report.line_table import format_line, plain_line

    chosen = chosen_from(options, CHOICES) | stated(options, map(dest, STATION)) | {"filters": _filters(options)}
    if options.cluster is not None:  # workers may be in other folders
        options.source = options.source.absolute()
    sources = _stations(options, "liner", "title")
    liner = load_liner(options.liner or preset_named(sources[0].read().liner, sources[0].path))
    parts = None
    if options.output is not None:
        require_result(options.output, len(options.educe_at or [0]))
        parts = LineParts(f"{options.output}.parts")
        writable_folder(parts.folder)
        if parts.there and not options.quiet:
            print(
                f"{parts.folder} holds {parts.there} finished stations: those of these data are taken", file=sys.stderr
            )
    with (
        open_cluster(options.cluster, options.wait) as client,
        progress_bar(len(sources), options.source.name, options, "station") as step,
    ):
        chosen |= {"reference": _reference(options), "parts": parts, "progress": step, "client": client}
        line = with_choices(educe_bursts(sources, liner, options.educe_at, **chosen), command=options.typed)
    if options.reference is not None and options.reference.is_dir():
        channels = input_file("reference channels", options.reference)
        line = with_choices(line, inputs=[*line.choices["inputs"], channels])
    if options.title is not None:
        line = replace(line, title=options.title)
    show_results(options, lambda: format_line(line), lambda: plain_line(line), output=line.write, figure=line.plot)
    if parts is not None:
        parts.clear()
    return level_check_code(options, [line])


def _reference(options: argparse.Namespace) -> Any:
    """A channel for all stations, or a function that reads that of each."""
    from torchliner.io.signal_file import read_signal
    from torchliner.records import ReferenceChannel

    path = options.reference
    if path is None:
        if options.reference_rate is not None or options.reference_start is not None:
            raise ValueError("--reference-rate and --reference-start are of a --reference; name the recording")
        return None
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder")

    def read(recording: Any) -> ReferenceChannel:
        found = read_signal(recording, options.reference_rate)
        return ReferenceChannel(found.signal, found.sampling_rate, options.reference_start or 0.0, str(recording))

    def of_station(source: StationSource) -> ReferenceChannel:
        stem = source.path.stem if source.number is None else f"{source.path.stem}_{source.number}"
        there = (path / f"{stem}{suffix}" for suffix in RECORDINGS)
        recording = next((each for each in there if each.exists()), None)
        if recording is None:
            raise FileNotFoundError(f"{path} holds no recording {stem}{{{','.join(RECORDINGS)}}} for {source.name}")
        return read(recording)

    return of_station if path.is_dir() else read(path)
