"""torchliner ldv."""

from __future__ import annotations

import argparse
from pathlib import Path

from torchliner.cli import ldv_educe
from torchliner.cli.ldv_options import (
    add_filters,
    add_reading,
    files_in,
    filters_from,
    stations_from,
)
from torchliner.cli.options import add_output_options, print_json, refuse_inputs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """One parser a task; each is a word after ``ldv``."""
    tasks = parser.add_subparsers(
        dest="task", metavar="TASK", required=True, parser_class=type(parser)
    )
    info = tasks.add_parser(
        "info", help="describe and check stations", allow_abbrev=False,
        description="Table of stations; exit code 1 if one is flagged.",
    )  # fmt: skip
    add_reading(info)
    _add_liner(info)
    add_filters(info)
    info.add_argument("-o", "--output", type=Path, help="the table as CSV, SI units")
    info.add_argument("--intervals", type=Path, help="histograms of the intervals as CSV")
    info.add_argument("--figure", type=Path, help="draw moments, rates and intervals there")
    add_output_options(info)
    convert = tasks.add_parser(
        "convert", help="write stations as one HDF5 file, or one as CSV", allow_abbrev=False,
        description="Bursts as read, nothing dropped that can be read.",
    )  # fmt: skip
    add_reading(convert)
    _add_liner(convert)
    convert.add_argument("-o", "--output", type=Path, required=True, help=".h5, .nc or .csv")
    add_output_options(convert)
    educe = tasks.add_parser(
        "educe", help="impedance along a line of stations", allow_abbrev=False,
        description="Impedance of every station, segment by segment, and its averages; broken off "
        "and called again with the same -o, it takes up the stations that are done.",
    )  # fmt: skip
    ldv_educe.add_arguments(educe)


def _add_liner(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--liner", help="name of the liner below, not for HDF5 files")


def run(options: argparse.Namespace) -> int:
    """The task named after ``ldv``."""
    return {"info": _info, "convert": _convert, "educe": ldv_educe.run}[options.task](options)


def _info(options: argparse.Namespace) -> int:
    from torchliner.report.station_report import (
        draw_stations,
        format_stations,
        intervals_of,
        plain_station,
        station_table,
    )
    from torchliner.signals.inspected_station import inspect_stations

    refuse_inputs((options.output, options.intervals, options.figure), files_in(options.source))
    records = [source.read() for source in stations_from(options)]
    stations = inspect_stations(records, filters_from(options))
    if options.json:
        print_json([plain_station(station) for station in stations])
    else:
        print(format_stations(stations))
    if options.output is not None:
        station_table(stations).write_csv(options.output)
    if options.intervals is not None:
        intervals_of(stations).write_csv(options.intervals)
    if options.figure is not None:
        draw_stations(stations, options.figure)
    return 1 if any(station.flags for station in stations) else 0


def _convert(options: argparse.Namespace) -> int:
    from torchliner.io.burst_file import write_bursts

    refuse_inputs((options.output,), files_in(options.source))
    records = [source.read() for source in stations_from(options)]
    write_bursts(records, options.output)
    counts = {"stations": len(records), "bursts": sum(record.bursts for record in records)}
    if options.json:
        print_json({"output": str(options.output), **counts})
    else:
        print(f"{options.output}: {counts['stations']} stations, {counts['bursts']} bursts")
    return 0
