"""torchliner ldv: check, convert and educe bursts of laser Doppler stations."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import torchliner as tl
from torchliner import names
from torchliner.cli import kinds
from torchliner.cli import options as opt
from torchliner.cli.inputs import preset_named
from torchliner.cli.kinds import Command, Option
from torchliner.cli.output import progress_bar, show
from torchliner.cli.velocity import strict_code

if TYPE_CHECKING:
    from torchliner.bursts.stations import BurstFilters
    from torchliner.io.burst_sources import StationSource

RECORDINGS = (".npy", ".wav", ".mat", ".h5")


def info(options: argparse.Namespace) -> int:
    """Describe and check stations.

    Table of stations; exit code 1 if one is flagged.
    """
    from torchliner.bursts.stations import Station
    from torchliner.report.answer import answer_of

    filters = _filters(options)
    stations = [Station.of(source.read(), filters) for source in _stations(options, ABOUT)]
    show(options, answer_of(stations))
    return 1 if any(station.flags for station in stations) else 0


def convert(options: argparse.Namespace) -> None:
    """Write stations as one HDF5 file.

    Bursts as read, nothing dropped that can be read.
    """
    from torchliner.io.burst_sources import write_bursts

    records = [source.read() for source in _stations(options, ABOUT)]
    write_bursts(records, options.output)
    bursts = sum(record.bursts for record in records)
    plain = {"output": str(options.output), "stations": len(records), "bursts": bursts}
    show(options, plain, lambda _: f"{options.output}: {len(records)} stations, {bursts} bursts")


def educe(options: argparse.Namespace) -> int:
    """Impedance along a line of stations.

    Impedance of every station, segment by segment, and its averages;
    broken off and called again with the same -o, it takes up the stations that are done.
    """
    from torchliner.campaign.cluster import open_cluster
    from torchliner.io.line_parts import LineParts
    from torchliner.io.result_writers import require_result
    from torchliner.io.whole_file import writable_folder
    from torchliner.records.origin import input_file, with_choices
    from torchliner.report.answer import answer_of

    chosen = options.chosen | {"filters": _filters(options), "reference": _reference(options)}
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
            print(f"{parts.folder} holds {parts.there} finished stations, which are taken up", file=sys.stderr)
    with (
        open_cluster(options.cluster, options.wait) as client,
        progress_bar(len(sources), options.source.name, options, "station") as step,
    ):
        chosen |= {"parts": parts, "progress": step, "client": client}
        line = with_choices(tl.educe_bursts(sources, liner, options.educe_at, **chosen), command=options.typed)
    if options.reference is not None and options.reference.is_dir():
        channels = input_file("reference channels", options.reference)
        line = with_choices(line, inputs=[*line.choices["inputs"], channels])
    if options.title is not None:
        line = replace(line, title=options.title)
    show(options, answer_of(line), write=line.write)
    if parts is not None:
        parts.clear()
    return strict_code(options, line)


def _stations(options: argparse.Namespace, about: list[Option]) -> list[StationSource]:
    """The stations, still in their files."""
    said = opt.given(options, FORMAT)
    if "components" in said:
        said["components"] = said["components"].split(",")
    return tl.list_stations(options.source, **said, **opt.given(options, about))


def _filters(options: argparse.Namespace) -> BurstFilters:
    """Which bursts count."""
    chosen: dict[str, Any] = {name.replace("-", "_"): None for name in options.without}
    return tl.BurstFilters(**chosen | ({"times": False} if "times" in chosen else {}))


def _reference(options: argparse.Namespace) -> Any:
    """A channel for all stations, or a function that reads that of each."""
    path, rate, start = options.reference, options.reference_rate, options.reference_start
    if path is None:
        if rate is not None or start is not None:
            raise ValueError("--reference-rate and --reference-start are of a --reference; name the recording")
        return None

    def read(recording: Any) -> tl.ReferenceChannel:
        found = tl.read_signal(recording, rate)
        return tl.ReferenceChannel(found.signal, found.sampling_rate, start or 0.0, str(recording))

    def of_station(source: StationSource) -> tl.ReferenceChannel:
        stem = source.path.stem if source.number is None else f"{source.path.stem}_{source.number}"
        for suffix in RECORDINGS:
            if (recording := path / f"{stem}{suffix}").exists():
                return read(recording)
        raise FileNotFoundError(f"{path} holds no recording {stem}{{{','.join(RECORDINGS)}}} for {source.name}")

    return of_station if path.is_dir() else read(path)


FORMAT = [
    *opt.of("io.burst_text:read_burst_columns", "columns separator", separator={"kind": names.SEPARATORS}),
    *opt.of("io.dantec:read_dantec", "components coincidence_window"),
]
SOURCE = [Option("source", "file of bursts, or folder of stations", kinds.PATH), *FORMAT]
PLACE = [
    Option(f"--{axis}", f"of the station, {where}, m", kinds.M)
    for axis, where in (("x", "along the duct"), ("y", "above the liner"), ("z", "across the duct"))
]
ABOUT = opt.group("about the case (not for HDF5 files; default: not stated)", *opt.CASE, *PLACE)
# What means something else where stations are educed.
FACTS = [each for each in ABOUT if each.flag not in ("--liner", "--title")]
FILTERS = Option("--without", "switch off filters of bursts; default: none", names.FILTERS, nargs="+", default=[])
STATION = opt.of(
    "bursts.choices:StationChoices",
    "method grid_rate band_limit correction segment overlap window flagged monte_carlo",
    group="from bursts to segments",
    method={"kind": names.GRID_METHODS},
    overlap={"kind": kinds.NUMBER},
    window={"kind": names.STATION_WINDOWS},
)
REFERENCE = opt.group(
    "reference channel (loudspeaker or microphone)",
    Option("--reference", "one recording, or a folder with one a station (.npy, .wav, .mat, .h5)", kinds.PATH),
    Option("--reference-rate", "its sampling rate, Hz; default: that of a .wav", kinds.HZ),
    Option("--reference-start", "of its first sample, s, on the clock of the arrivals; default 0", kinds.S),
)
CHOICES = [
    *opt.choices("phase drive running_window mean wall_filter minimum_coherence interval level_limit"),
    *opt.choices("level_uncertainty level_matched device dtype"),
    *opt.of("bursts.line:educe_bursts", "reference_phase", group="choices", reference_phase={"kind": kinds.NUMBER}),
]
COMMANDS = {
    "ldv": {
        "info": Command(
            info,
            [
                *(*SOURCE, opt.output("write the table, SI units,", ".csv")),
                *(opt.figure("draw moments, rates and intervals there"), *ABOUT, FILTERS),
            ],
            ("bursts/ --json",),
        ),
        "convert": Command(
            convert,
            [*SOURCE, opt.output("write the stations", *opt.HDF5, required=True), *ABOUT],
            ("bursts/ -o line.h5",),
        ),
        "educe": Command(
            educe,
            [
                *(*SOURCE, *opt.CLUSTER, opt.OF_LINER, opt.STRICT, opt.frequency("the tone", "--educe-at")),
                *(opt.output("write the line", *opt.RESULT), opt.figure("draw Z along the line there")),
                *(*[each for each in ABOUT if each.flag != "--liner"], FILTERS, *REFERENCE),
            ],
            ("bursts/ --frequency 1400 --liner onera -o line_z.h5",),
            [*STATION, *CHOICES],
        ),
    }
}
