"""Bursts from a file of any known layout, or from a folder of stations, all at once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torchliner.io.burst_sources import list_stations
from torchliner.records import BurstRecord


def read_bursts(
    path: str | Path,
    columns: str | Sequence[str] | None = None,
    separator: str = "blank",
    components: Sequence[str] | None = None,
    coincidence_window: float | None = None,
    **about: Any,
) -> list[BurstRecord]:
    """Stations of a file or folder, in the order of x, then y, z; by name without positions.

    Args:
        path: a file of our HDF5 or CSV, a DXEX export, columns without a header; or a folder of
            files of one station each.
        columns, separator: of files without a header, as in ``read_burst_columns``.
        components, coincidence_window: of DXEX files, as in ``read_dantec``.
        about: further fields of each record, e.g. ``frequency``; not for HDF5, which states its
            own.
    Raises:
        FileNotFoundError, OSError: no such file or folder, or it cannot be read.
        ValueError: a folder without files of bursts, two files with the same position, a file of
            no known layout or with faults.
    """
    stations = list_stations(path, columns, separator, components, coincidence_window, **about)
    return [station.read() for station in stations]
