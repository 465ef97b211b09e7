"""What the tasks of ``torchliner ldv`` share: how bursts are read, and which of them count."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from torchliner import names
from torchliner.cli.options import CASE, dest, stated

if TYPE_CHECKING:
    from torchliner.bursts.filters import BurstFilters
    from torchliner.io.burst_sources import StationSource

READING: dict[str, Any] = {
    "source SOURCE": "file of bursts, or folder of stations",
    "--columns LIST": "of files without a header: 'row, arrival_time [ms], transit_time [us], "
                      "streamwise [m/s], wall_normal [m/s]'; default: those of the header",
    "--separator": {"choices": names.SEPARATORS, "default": "blank", "help": "of files without a "
                    "header; default blank"},
    "--components LIST": "what LDA1, LDA2, ... of DXEX files hold: streamwise,wall_normal,skip; a "
                         "minus turns one (write --components=-wall_normal); default: not stated",
    "--coincidence-window S": "pair the channels of non-coincidence files within so many s; "
                              "default: do not pair",
}  # fmt: skip
STATIONS = CASE | {
    "--x M": "of the station, along the duct, m",
    "--y M": "of the station, above the liner, m",
    "--z M": "of the station, across the duct, m",
}
UNSTATED = "about the case (not for HDF5 files; default: not stated)"
VALID = "which bursts count"
FILTERS = {
    "--without FILTER ...": {"choices": names.FILTERS, "default": [], "help": "switch off "
                             f"{', '.join(names.FILTERS)}; default: none is off"},
    "--zero-runs N": "shortest run of exact zeros that is dropped; default 10",
    "--outliers FACTOR": "limit in standard deviations, by the medians; default 6",
}  # fmt: skip


def stations_from(options: argparse.Namespace, *left_out: str) -> list[StationSource]:
    """The stations, still in their files; ``left_out`` means something else in this task."""
    from torchliner.io.burst_sources import list_stations

    components = None if options.components is None else options.components.split(",")
    return list_stations(
        options.source, options.columns, options.separator, components, options.coincidence_window,
        **stated(options, (key for key in map(dest, STATIONS) if key not in left_out)),
    )  # fmt: skip


def filters_from(options: argparse.Namespace) -> BurstFilters:
    """Which bursts count."""
    from torchliner.bursts.filters import BurstFilters

    chosen = stated(options, ("zero_runs", "outliers"))
    for name in options.without:
        key = name.replace("-", "_")
        if key in chosen:
            raise ValueError(f"--{name} is given and switched off by --without; take one away")
        chosen[key] = False if key == "times" else None
    return BurstFilters(**chosen)
