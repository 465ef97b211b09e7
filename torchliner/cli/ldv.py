"""torchliner ldv."""

from __future__ import annotations

import argparse

from torchliner.cli import ldv_educe
from torchliner.cli import ldv_options as ldv
from torchliner.cli.files import show_results
from torchliner.cli.options import shared

INFO = {
    "--output FILE": "write the table as .csv, SI units",
    "--intervals FILE": "write histograms of the intervals as .csv",
    "--figure PICTURE": "draw moments, rates and intervals there",
} | shared("--json", "--quiet")
CONVERT = {"--output FILE": {"required": True, "help": "write the stations as .h5/.nc, or one as .csv"}} | shared(
    "--json", "--quiet"
)
TASKS = {
    "info": (
        "describe and check stations",
        "Table of stations; exit code 1 if one is flagged.",
        {"": ldv.READING | INFO, ldv.UNSTATED: ldv.STATIONS, ldv.VALID: ldv.FILTERS},
    ),
    "convert": (
        "write stations as one HDF5 file, or one as CSV",
        "Bursts as read, nothing dropped that can be read.",
        {"": ldv.READING | CONVERT, ldv.UNSTATED: ldv.STATIONS},
    ),
    "educe": (
        "impedance along a line of stations",
        "Impedance of every station, segment by segment, and its averages; broken off and called "
        "again with the same -o, it takes up the stations that are done.",
        ldv_educe.OPTIONS,
    ),
}


def run(options: argparse.Namespace) -> int:
    """The task named after ``ldv``."""
    return {"info": _info, "convert": _convert, "educe": ldv_educe.run}[options.task](options)


def _info(options: argparse.Namespace) -> int:
    from torchliner.bursts.stations import Station
    from torchliner.report.station_report import (
        draw_stations,
        format_stations,
        intervals_of,
        plain_station,
        station_table,
    )

    records = [source.read() for source in ldv.stations_from(options)]
    filters = ldv.filters_from(options)
    stations = [Station.of(record, filters) for record in records]
    if options.intervals is not None:
        intervals_of(stations).write_csv(options.intervals)
    show_results(
        options, lambda: format_stations(stations), lambda: [*map(plain_station, stations)],
        output=station_table(stations).write_csv,
        figure=lambda path: draw_stations(stations, path),
    )  # fmt: skip
    return 1 if any(station.flags for station in stations) else 0


def _convert(options: argparse.Namespace) -> int:
    from torchliner.io.burst_file import write_bursts

    records = [source.read() for source in ldv.stations_from(options)]
    found = {"output": str(options.output), "stations": len(records),
             "bursts": sum(record.bursts for record in records)}  # fmt: skip
    show_results(
        options, lambda: "{output}: {stations} stations, {bursts} bursts".format_map(found),
        lambda: found, output=lambda path: write_bursts(records, path),
    )  # fmt: skip
    return 0
