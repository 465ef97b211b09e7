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

    Arguments and errors are those of ``list_stations``, which names the stations without reading
    their bursts; and a file with faults is a ValueError.
    """
    stations = list_stations(path, columns, separator, components, coincidence_window, **about)
    return [station.read() for station in stations]
