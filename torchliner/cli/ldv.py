"""torchliner ldv."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from torchliner.cli.options import add_output_options, print_json, refuse_inputs

if TYPE_CHECKING:
    from torchliner.records import BurstRecord
    from torchliner.signals.burst_validation import BurstFilters

ABOUT = (
    "frequency incident_level mach displacement_thickness source_side liner x y z title"
).split()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """One parser a task; each is a word after ``ldv``."""
    tasks = parser.add_subparsers(
        dest="task", metavar="TASK", required=True, parser_class=type(parser)
    )
    info = tasks.add_parser(
        "info", help="describe and check stations", allow_abbrev=False,
        description="Table of stations; exit code 1 if one is flagged.",
    )  # fmt: skip
    _add_reading(info)
    _add_filters(info)
    info.add_argument("-o", "--output", type=Path, help="the table as CSV, SI units")
    info.add_argument("--intervals", type=Path, help="histograms of the intervals as CSV")
    info.add_argument("--figure", type=Path, help="draw moments, rates and intervals there")
    add_output_options(info)
    convert = tasks.add_parser(
        "convert", help="write stations as one HDF5 file, or one as CSV", allow_abbrev=False,
        description="Bursts as read, nothing dropped that can be read.",
    )  # fmt: skip
    _add_reading(convert)
    convert.add_argument("-o", "--output", type=Path, required=True, help=".h5, .nc or .csv")
    add_output_options(convert)


def _add_reading(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", type=Path, help="file of bursts, or folder of stations")
    parser.add_argument("--columns", help="of files without a header: 'row, arrival_time [ms], "
                        "transit_time [us], streamwise [m/s], wall_normal [m/s]'")  # fmt: skip
    parser.add_argument("--separator", choices=["blank", "tab", "comma", "semicolon"],
                        default="blank", help="of files without a header")  # fmt: skip
    parser.add_argument("--components", metavar="LIST", help="what LDA1, LDA2, ... of DXEX files "
                        "hold: streamwise,wall_normal,skip; a minus turns one (write "
                        "--components=-wall_normal)")  # fmt: skip
    parser.add_argument("--coincidence-window", type=float, metavar="S",
                        help="pair the channels of non-coincidence files")  # fmt: skip
    about = parser.add_argument_group("about the case (SI; not for HDF5 files)")
    units = {"frequency": "HZ", "incident-level": "DB", "mach": "M", "displacement-thickness": "M",
             "x": "M", "y": "M", "z": "M"}  # fmt: skip
    for name, unit in units.items():
        about.add_argument(f"--{name}", type=float, metavar=unit)
    about.add_argument("--source-side", choices=["upstream", "downstream", "normal", "none"])
    about.add_argument("--liner", help="name of the liner below")
    about.add_argument("--title")


def _add_filters(parser: argparse.ArgumentParser) -> None:
    """Defaults are those of ``BurstFilters``."""
    parser.add_argument("--without", nargs="+", default=[], metavar="FILTER",
                        choices=["times", "zero-runs", "outliers"],
                        help="switch off: times, zero-runs, outliers")  # fmt: skip
    parser.add_argument("--zero-runs", type=int, metavar="N",
                        help="shortest run of exact zeros that is dropped (10)")  # fmt: skip
    parser.add_argument("--outliers", type=float, metavar="K",
                        help="limit in standard deviations, by the medians (6)")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """The task named after ``ldv``."""
    return {"info": _info, "convert": _convert}[options.task](options)


def _stations(options: argparse.Namespace) -> list[BurstRecord]:
    from torchliner.io.burst_folder import read_bursts

    about = {key: getattr(options, key) for key in ABOUT if getattr(options, key) is not None}
    components = None if options.components is None else options.components.split(",")
    return read_bursts(
        options.source, options.columns, options.separator, components,
        options.coincidence_window, **about,
    )  # fmt: skip


def _filters(options: argparse.Namespace) -> BurstFilters:
    from torchliner.signals.burst_validation import BurstFilters

    chosen = {key: getattr(options, key) for key in ("zero_runs", "outliers")
              if getattr(options, key) is not None}  # fmt: skip
    for name in options.without:
        key = name.replace("-", "_")
        if key in chosen:
            raise ValueError(f"--{name} is given and switched off by --without; take one away")
        chosen[key] = False if key == "times" else None
    return BurstFilters(**chosen)


def _info(options: argparse.Namespace) -> int:
    from torchliner.report.bursts import (
        draw_stations,
        format_stations,
        inspect_stations,
        intervals_of,
    )
    from torchliner.report.numbers import write_rows

    inputs = [options.source, *_files(options.source)]
    refuse_inputs((options.output, options.intervals, options.figure), inputs)
    stations = inspect_stations(_stations(options), _filters(options))
    if options.json:
        print_json([station.plain() for station in stations])
    else:
        print(format_stations(stations))
    if options.output is not None:
        write_rows([station.row() for station in stations], options.output)
    if options.intervals is not None:
        intervals_of(stations).write_csv(options.intervals)
    if options.figure is not None:
        draw_stations(stations, options.figure)
    return 1 if any(station.flags for station in stations) else 0


def _convert(options: argparse.Namespace) -> int:
    from torchliner.io.burst_file import write_bursts

    refuse_inputs((options.output,), [options.source, *_files(options.source)])
    records = _stations(options)
    write_bursts(records, options.output)
    counts = {"stations": len(records), "bursts": sum(record.bursts for record in records)}
    if options.json:
        print_json({"output": str(options.output), **counts})
    else:
        print(f"{options.output}: {counts['stations']} stations, {counts['bursts']} bursts")
    return 0


def _files(source: Path) -> list[Path]:
    return list(source.iterdir()) if source.is_dir() else []
