"""Where the records lead: the one way up, taken when a record is written or drawn.

Readers and figures know the records, so the records cannot know them: their homes stand here as text and are imported
when they are called.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from torch import Tensor

from torchliner.checks import index_of_frequency
from torchliner.names import resolve


class Written:
    """A record with a file of its own: ``SCHEMA`` names its kind; ``axes``, where it has them, say what names of its
    dimensions stand for."""

    SCHEMA: ClassVar[str]
    FILE: ClassVar = "torchliner.io.own_writer:write_record"

    def write(self, path: str | Path) -> None:
        """Write one netCDF-4 file (.h5, .hdf5, .nc); a result also as .csv, .vtp, .vtkhdf, .mat, .bdf, .dat or .txt
        (docs/results.md).

        Raises:
            ValueError: another ending; what the format cannot hold.
        """
        resolve(self.FILE)(self, path)


class Reported:
    """What has a page."""

    PAGE: ClassVar = "torchliner.report.page:write_report"

    def report(self, path: str | Path) -> None:
        """Write one self-contained HTML page (.html; extra ``report``): answer, warnings, figures, provenance.

        Raises:
            ValueError: another ending; leading axes, which a page has no place for.
        """
        resolve(self.PAGE)(self, path)


class Result(Written, Reported):
    """A result, which leaves as labelled arrays and as rows too: ``PLACES`` are what a row stands for, by name, with
    its dimensions beside the frequency, the usual ones first; with ``TOGETHER`` a table holds all of them."""

    PLACES: ClassVar[Mapping[str, tuple[str, ...]]]
    TOGETHER: ClassVar = False

    def to_xarray(self) -> Any:
        """``xarray.Dataset`` (extra ``xarray``) with coordinates, units and long names: what ``xarray.open_dataset``
        shows of the file, and the complex values."""
        return resolve("torchliner.io.own_writer:to_xarray")(self)

    def to_dataframe(self, of: str | None = None) -> Any:
        """``pandas.DataFrame`` (extra ``xarray``) with one row a place and frequency; headings as in CSV.

        Args:
            of: ``probes`` (default) or ``cells`` of a map; ``stations`` of a line; ``points``, ``cells`` or
                ``liners`` of ``PointImpedances`` (default: all); a ValueError for others.
        """
        return resolve("torchliner.io.csv_rows:to_dataframe")(self, of)


class Drawn(Written):
    """A record with a figure of its own as well, ``PLOT``."""

    PLOT: ClassVar[str]

    def plot(self, path: str | Path | None = None, *, ax: Any = None) -> Any:
        """Draw the record along or over the liner.

        Args:
            path: picture to write.
            ax: axes to draw into, one for each panel, or one for the first panel alone; default a
                new figure.
        Returns:
            The matplotlib figure (extra ``report``), which a notebook shows; the axes, where they were given.
        """
        return self._draw(path, ax)

    def _draw(self, path: Any, axes: Any, **settings: Any) -> Any:
        if axes is not None and path is not None:
            raise ValueError(f"{path}: give a path or axes; a figure of axes is yours to save")
        return resolve(self.PLOT)(self, path=path, axes=axes, **settings)


class DrawnAtFrequency(Drawn):
    """A record with one picture a frequency: panels of resistance and reactance."""

    frequency: Tensor

    def plot(self, path: str | Path | None = None, *, frequency: float | None = None, ax: Any = None) -> Any:
        """Draw resistance and reactance, as ``Drawn.plot``, at a frequency (Hz); of a map of several, by default, over
        frequency. A ValueError where the frequency is not among those of the record."""
        index = None if frequency is None else index_of_frequency(self.frequency, frequency)
        if frequency is not None and index is None:
            known = ", ".join(f"{each:g}" for each in self.frequency.tolist())
            raise ValueError(f"frequency is {frequency:g} Hz; the record has {known} Hz")
        return self._draw(path, ax, frequency_index=index)
