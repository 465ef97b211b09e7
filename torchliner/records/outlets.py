"""Where the records lead: the one declared way up, taken when a record is written or drawn.

Readers and figures know the records, so the records cannot know them: their homes stand here as
text and are imported when they are called. ``tests/test_architecture.py`` resolves every row.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torch import Tensor

from torchliner.checks import index_of_frequency
from torchliner.names import resolve

OUTLETS = {
    "BurstRecord": {"write": "torchliner.io.burst_file:write_bursts"},
    "ImpedanceLine": {
        "write": "torchliner.io.line_file:write_line",
        "file": "torchliner.io.line_file:FILE",
        "plot": "torchliner.report.line_figures:draw_lines",
        "report": "torchliner.report.page.opening:write_report",
    },
    "ImpedanceMap": {
        "write": "torchliner.io.map_file:write_map",
        "file": "torchliner.io.map_file:FILE",
        "plot": "torchliner.report.figures:draw_map",
        "report": "torchliner.report.page.opening:write_report",
    },
    "DuctField": {"report": "torchliner.report.page.opening:write_report"},
    "FieldFit": {
        "write": "torchliner.io.wall_file:write_wall",
        "report": "torchliner.report.page.opening:write_report",
    },
    "MicrophoneLine": {"write": "torchliner.io.microphone_file:write_microphones"},
    "PointImpedances": {
        "write": "torchliner.io.point_file:write_points",
        "file": "torchliner.io.point_file:FILE",
        "report": "torchliner.report.page.opening:write_report",
    },
    "PressureRecord": {"write": "torchliner.io.pressure_file:write_pressure"},
    "VelocityPlane": {
        "write": "torchliner.io.plane_writer:write_plane",
        "from_xarray": "torchliner.io.foreign:from_xarray",
        "plot": "torchliner.report.figures:draw_velocity",
    },
    "WallEduction": {
        "write": "torchliner.io.wall_file:write_wall",
        "report": "torchliner.report.page.opening:write_report",
    },
}


def outlet(record: type, way: str) -> Any:
    """The function that ``write``, ``plot`` ... of a record of this kind leads to."""
    kind = next(each.__name__ for each in record.__mro__ if each.__name__ in OUTLETS)
    return resolve(OUTLETS[kind][way])


class Written:
    """A record with a file of its own."""

    def write(self, path: str | Path) -> None:
        """Write one netCDF-4 file (.h5, .hdf5, .nc), or CSV if the kind has one (.csv).

        A result also as .vtkhdf, .mat, .bdf, .dat or .txt; docs/results.md says what stands in
        which.

        Raises:
            ValueError: another ending; what the format cannot hold.
        """
        outlet(type(self), "write")(self, path)


class Reported:
    """What has a page."""

    def report(self, path: str | Path) -> None:
        """Write one self-contained HTML page: answer, warnings, figures, provenance.

        Args:
            path: of the page, .html; one that is there is replaced.
        Raises:
            ImportError: jinja2 or matplotlib is not installed (extra ``report``).
            ValueError: another ending; leading axes, which a page has no place for.
        """
        outlet(type(self), "report")(self, path)


class Result(Written, Reported):
    """A result, which leaves as labelled arrays and as rows too."""

    def to_xarray(self, group: str | None = None) -> Any:
        """``xarray.Dataset`` with coordinates, units and long names; Z complex and in two parts.

        Without the complex variables it is what ``xarray.open_dataset`` shows of the file that
        ``write`` makes.

        Args:
            group: of that file: a map has ``amplitudes``, ``intervals``, ``closure``; None: the
                main part.
        Raises:
            ImportError: xarray or h5netcdf is not installed (extra ``xarray``).
            ValueError: there is no such group.
        """
        return outlet(type(self), "file").to_xarray(self, group)

    def to_dataframe(self, of: str | None = None) -> Any:
        """``pandas.DataFrame`` with one row a place and frequency; headings as in CSV.

        Args:
            of: ``probes`` (default) or ``cells`` of a map; ``stations`` of a line; ``points``,
                ``cells`` or ``liners`` of ``PointImpedances`` (default: all).
        Raises:
            ImportError: pandas is not installed (extra ``xarray``).
            ValueError: there are no such rows.
        """
        return outlet(type(self), "file").to_dataframe(self, of)


class Drawn(Written):
    """A record with a figure of its own as well."""

    def plot(self, path: str | Path | None = None, *, ax: Any = None) -> Any:
        """Draw the record along or over the liner.

        Args:
            path: picture to write.
            ax: axes to draw into, one for each panel, or one for the first panel alone; default a
                new figure.
        Returns:
            The matplotlib figure, which a notebook shows; the axes, where they were given.
        Raises:
            ImportError: matplotlib is not installed (extra ``report``).
            ValueError: a path and axes.
        """
        return self._draw({"path": path, "axes": ax})

    def _draw(self, settings: dict[str, Any]) -> Any:
        path, axes = settings["path"], settings["axes"]
        if axes is not None and path is not None:
            raise ValueError(f"{path}: give a path or axes; a figure of axes is yours to save")
        return outlet(type(self), "plot")(self, **settings)


class DrawnAtFrequency(Drawn):
    """A record with one picture a frequency: panels of resistance and reactance."""

    frequency: Tensor

    def plot(self, path: str | Path | None = None, *, frequency: float | None = None, ax: Any = None) -> Any:
        """Draw resistance and reactance along or over the liner.

        Args:
            path, ax: as for ``Drawn.plot``.
            frequency: Hz; default the first.
        Returns:
            As ``Drawn.plot``.
        Raises:
            ValueError: the frequency is not among those of the record; as ``Drawn.plot``.
        """
        index = 0 if frequency is None else index_of_frequency(self.frequency, frequency)
        if index is None:
            there = ", ".join(f"{f:g}" for f in self.frequency.tolist())
            raise ValueError(f"frequency is {frequency:g} Hz; the record has {there} Hz")
        return self._draw({"path": path, "axes": ax, "frequency_index": index})
