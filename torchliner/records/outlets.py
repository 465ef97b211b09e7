"""Where the records lead: the one declared way up, taken when a record is written or drawn.

Readers and figures know the records, so the records cannot know them: their homes stand here as
text and are imported when they are called. ``tests/test_architecture.py`` resolves every row.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchliner.names import resolve

OUTLETS = {
    "BurstRecord": {"write": "torchliner.io.burst_file:write_bursts"},
    "ImpedanceLine": {
        "write": "torchliner.io.line_file:write_line",
        "plot": "torchliner.report.line_figures:draw_lines",
    },
    "ImpedanceMap": {
        "write": "torchliner.io.map_file:write_map",
        "plot": "torchliner.report.figures:draw_map",
    },
    "MicrophoneLine": {"write": "torchliner.io.microphone_file:write_microphones"},
    "PointImpedances": {"write": "torchliner.io.point_file:write_points"},
    "PressureRecord": {"write": "torchliner.io.pressure_file:write_pressure"},
    "VelocityPlane": {
        "write": "torchliner.io.plane_writer:write_plane",
        "from_xarray": "torchliner.io.xarray_plane:from_xarray",
    },
}


def outlet(record: type, way: str) -> Any:
    """The function that ``write``, ``plot`` ... of a record of this kind leads to."""
    kind = next(each.__name__ for each in record.__mro__ if each.__name__ in OUTLETS)
    return resolve(OUTLETS[kind][way])


class Written:
    """A record with a file of its own."""

    def write(self, path: str | Path) -> None:
        """Write one netCDF-4 file, or CSV if the kind has one and the name ends in .csv.

        docs/formats.md says what stands in which.
        """
        outlet(type(self), "write")(self, path)


class Drawn(Written):
    """A record with a figure of its own as well."""

    def plot(self, path: str | Path | None = None) -> Any:
        """Draw the record along or over the liner; the matplotlib figure, saved if ``path``."""
        return outlet(type(self), "plot")(self, path)
