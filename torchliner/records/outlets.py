"""How records show themselves, and where they lead: the one way up, taken when a record is written or drawn.

Readers and figures know the records, so the records cannot know them: their homes stand here as text and are imported
when they are called.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.checks import index_of_frequency
from torchliner.names import resolve
from torchliner.records.declared import variables_of

MOST = 12  # frequencies that are shown
UNSAID = ("frequency", "columns", "rows")  # dimensions


class Summarised:
    """A record that shows what it is and not its tensors."""

    def _answer(self) -> tuple[Tensor, Any, float | None] | None:
        """Its impedance, (F,), with a statistical interval and the level of that; None without."""
        return None

    def _heading(self) -> str:
        """'ImpedanceMap 'title': 2 x 3 probes, 1 cell, 1400 Hz'."""
        of: Any = getattr(self, "plane", self)
        fields = {row.dims[0]: getattr(of, row.field) for row in variables_of(type(of)) if len(row.dims) == 1}
        sizes = {dim: each.shape for dim, each in fields.items() if isinstance(each, Tensor) and dim not in UNSAID}
        words = []
        if hasattr(of, "sampling_rate"):
            sizes, words = {"probes": of.probe_shape}, [f"{of.samples} samples at {of.sampling_rate:g} Hz"]
        words += [f"{' x '.join(map(str, shape)) or '1'} {dim}" for dim, shape in sizes.items()]
        if of.frequency is not None:
            words.append(f"{', '.join(f'{f:g}' for f in torch.as_tensor(of.frequency).reshape(-1)[:MOST].tolist())} Hz")
        title = f" {of.title!r}" if getattr(of, "title", "") else ""
        return f"{type(self).__name__}{title}: {', '.join(words)}"

    def _facts(self) -> list[str]:
        """Z at each frequency, with the bounds of its interval, or what is stated."""
        of: Any = getattr(self, "plane", self)
        if (known := self._answer()) is None:
            rows = [row for row in variables_of(type(of)) if not row.dims and getattr(of, row.field) is not None]
            numbers = [f"{row.field}: {float(getattr(of, row.field)):g} {row.unit.removeprefix('1')}" for row in rows]
            return [f"{name}: {text}" for name in ("liner", "source_side") if (text := getattr(of, name, ""))] + numbers
        impedance, interval, level = known
        facts = []
        for i, (f, z) in enumerate(zip(of.frequency.tolist(), impedance.tolist(), strict=True)):
            text = f"Z = {z:.3f}"
            if interval is not None and level is not None:
                low, high = interval.bounds(i)
                text += f", {100 * level:g} %: R {low.real:.3f} to {high.real:.3f}, X {low.imag:.3f} to {high.imag:.3f}"
            facts.append(f"{f:g} Hz: {text}")
        return facts

    def __repr__(self) -> str:
        return "\n  ".join([self._heading(), *self._facts()[:MOST]])


class Written(Summarised):
    """A record with a file of its own: ``SCHEMA`` names its kind; ``axes``, where it has them, say what names of its
    dimensions stand for."""

    SCHEMA: ClassVar[str]
    FILE: ClassVar = "torchliner.io.own_writer:write_record"

    def write(self, path: str | Path) -> None:
        """Write one netCDF-4 file (.h5, .hdf5, .nc); a result also as .csv, .vtp, .vtkhdf or .txt
        (docs/results.md). A ValueError for another ending, and for what the format cannot hold."""
        resolve(self.FILE)(self, path)


class Reported:
    """What has a page."""

    PAGE: ClassVar = "torchliner.report.page:write_report"

    def report(self, path: str | Path) -> None:
        """Write one self-contained HTML page (.html; extra ``report``): answer, warnings, figures, provenance. A
        ValueError for another ending."""
        resolve(self.PAGE)(self, path)

    def _repr_html_(self) -> str:
        """For notebooks: the answer and a table."""
        return str(resolve("torchliner.report.answer:answer_of")(self).html())


class Result(Written, Reported):
    """A result, which leaves as labelled arrays and as rows too: ``PLACES`` are what a row stands for, by name, with
    its dimensions beside the frequency, the usual ones first; with ``TOGETHER`` a table holds all of them."""

    PLACES: ClassVar[Mapping[str, tuple[str, ...]]]
    TOGETHER: ClassVar = False

    def to_xarray(self) -> Any:
        """``xarray.Dataset`` with coordinates, units and long names: what ``xarray.open_dataset`` shows of the file,
        and the complex values."""
        return resolve("torchliner.io.own_writer:to_xarray")(self)

    def to_dataframe(self, of: str | None = None) -> Any:
        """``pandas.DataFrame`` with one row a place and frequency; headings as in CSV. ``of``: ``probes`` (default) or
        ``cells`` of a map; ``stations`` of a line; ``points``, ``cells`` or ``liners`` of ``PointImpedances`` (default:
        all); a ValueError for others."""
        return resolve("torchliner.io.result_writers:to_dataframe")(self, of)


class Drawn:
    """A record with a figure of its own as well, ``PLOT``."""

    PLOT: ClassVar[str]
    frequency: Any

    def plot(self, path: str | Path | None = None, *, frequency: float | None = None, ax: Any = None) -> Any:
        """Draw the record along or over the liner.

        Args:
            path: picture to write.
            frequency: Hz, of a result: resistance and reactance there; default of several: over frequency.
            ax: axes to draw into, one for each panel, or one for the first panel alone, and returned; default a new
                matplotlib figure (extra ``report``).
        """
        if ax is not None and path is not None:
            raise ValueError(f"{path}: give a path or axes; a figure of axes is yours to save")
        chosen = {}
        if frequency is not None:
            known = torch.as_tensor(self.frequency).reshape(-1)
            chosen["frequency_index"] = index_of_frequency(known, frequency)
            if chosen["frequency_index"] is None:
                raise ValueError(f"frequency is {frequency:g} Hz; the record has {known.tolist()} Hz")
        return resolve(self.PLOT)(self, path=path, axes=ax, **chosen)
