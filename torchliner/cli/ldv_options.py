"""What the tasks of ``torchliner ldv`` share: how bursts are read, and which of them count."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torchliner.io.burst_sources import StationSource
    from torchliner.signals.burst_validation import BurstFilters

ABOUT = (
    "frequency incident_level mach displacement_thickness source_side liner x y z title"
).split()


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Where the bursts are and what their files leave unsaid."""
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
    about.add_argument("--title")


def add_filters(parser: argparse.ArgumentParser) -> None:
    """Defaults are those of ``BurstFilters``."""
    parser.add_argument("--without", nargs="+", default=[], metavar="FILTER",
                        choices=["times", "zero-runs", "outliers"],
                        help="switch off: times, zero-runs, outliers")  # fmt: skip
    parser.add_argument("--zero-runs", type=int, metavar="N",
                        help="shortest run of exact zeros that is dropped (10)")  # fmt: skip
    parser.add_argument("--outliers", type=float, metavar="K",
                        help="limit in standard deviations, by the medians (6)")  # fmt: skip


def stations_from(options: argparse.Namespace, *left_out: str) -> list[StationSource]:
    """The stations, still in their files; ``left_out`` of ``ABOUT`` means something else here."""
    from torchliner.io.burst_sources import list_stations

    stated = {key: getattr(options, key) for key in ABOUT if key not in left_out}
    about = {key: value for key, value in stated.items() if value is not None}
    components = None if options.components is None else options.components.split(",")
    return list_stations(
        options.source, options.columns, options.separator, components,
        options.coincidence_window, **about,
    )  # fmt: skip


def filters_from(options: argparse.Namespace) -> BurstFilters:
    """Which bursts count."""
    from torchliner.signals.burst_validation import BurstFilters

    chosen = {key: getattr(options, key) for key in ("zero_runs", "outliers")
              if getattr(options, key) is not None}  # fmt: skip
    for name in options.without:
        key = name.replace("-", "_")
        if key in chosen:
            raise ValueError(f"--{name} is given and switched off by --without; take one away")
        chosen[key] = False if key == "times" else None
    return BurstFilters(**chosen)


def files_in(source: Path) -> list[Path]:
    """The inputs, none of which may be an output."""
    return [source, *source.iterdir()] if source.is_dir() else [source]
