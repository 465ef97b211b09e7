"""Results out by the ending of the name; as labelled arrays and as tables in memory."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py

from torchliner.io.csv_rows import Rows, write_rows
from torchliner.io.tables import FileKind
from torchliner.names import RESULT_WRITERS, resolve


@dataclass(frozen=True)
class ResultFile:
    """How one kind of result leaves the program.

    Args:
        kind: of its netCDF-4 file.
        fill: writes a record into an open one.
        rows: of its CSV: functions of a record by what a row stands for, the usual one first.
        csv: settings of ``write_rows``.
    """

    kind: FileKind
    fill: Callable[[h5py.File, Any], None]
    rows: Mapping[str, Callable[[Any], Rows]]
    csv: Mapping[str, str] = field(default_factory=dict)

    def write(self, record: Any, path: str | Path) -> None:
        """One file, by its ending; the old one, if any, is replaced when the new one is whole.

        Raises:
            ValueError: no writer has this ending; what the format cannot hold.
        """
        ending = Path(path).suffix.lower()
        if ending in RESULT_WRITERS:
            resolve(RESULT_WRITERS[ending]).write(self, record, path)
        elif ending == ".csv":
            write_rows(self.default_rows(record), path, **self.csv)
        else:
            with self.kind.created(path, record) as file:
                self.fill(file, record)

    def default_rows(self, record: Any) -> Rows:
        """Those of the CSV."""
        return next(iter(self.rows.values()))(record)

    @contextmanager
    def in_memory(self, record: Any) -> Iterator[tuple[io.BytesIO, h5py.File]]:
        """The netCDF-4 file without a disk: what it would be as bytes, and open."""
        buffer = io.BytesIO()
        with h5py.File(buffer, "w") as file:
            self.kind.write_head(file, record)
            self.fill(file, record)
            file.flush()
            yield buffer, file

    def to_xarray(self, record: Any, group: str | None = None) -> Any:
        """What ``xarray.open_dataset`` shows of the file, and the complex values.

        Raises:
            ImportError: xarray or h5netcdf is not installed.
            ValueError: the result has no such group.
        """
        try:
            import h5netcdf  # noqa: F401
            import xarray
        except ImportError as error:
            raise ImportError('labelled arrays need pip install "torchliner[xarray]"') from error
        with self.in_memory(record) as (buffer, file):
            groups = [name for name, each in file.items() if isinstance(each, h5py.Group)]
        if group not in (None, *groups):
            raise ValueError(f"no group {group!r}; there are: {', '.join(groups) or 'none'}")
        found = xarray.load_dataset(buffer, engine="h5netcdf", group=group)
        for name, real, imaginary in complex_names(found):
            value = found[real] + 1j * found[imaginary]
            text = found[real].attrs.get("long_name", name)
            text = text.replace("real part of the ", "").replace("resistance", "impedance")
            found[name] = value.assign_attrs(units=found[real].attrs["units"], long_name=text)
        return found

    def to_dataframe(self, record: Any, of: str | None = None) -> Any:
        """The rows of the CSV, or those of another place.

        Raises:
            ImportError: pandas is not installed.
            ValueError: there are no such rows.
        """
        try:
            import pandas
        except ImportError as error:
            raise ImportError('data frames need pip install "torchliner[xarray]"') from error
        if of not in (None, *self.rows):
            raise ValueError(f"no rows of {of!r}; there are those of {', '.join(self.rows)}")
        return pandas.DataFrame(self.default_rows(record) if of is None else self.rows[of](record))


@dataclass(frozen=True)
class ResultWriter:
    """One format beside netCDF-4 and CSV, and what a result needs to be written in it.

    Args:
        write: a record of a ``ResultFile`` to a path.
        frequencies: at least so many.
        places: x or z of its probes.
    """

    write: Callable[[ResultFile, Any, str | Path], None]
    frequencies: int = 1
    places: bool = False

    def require(self, path: str | Path, frequencies: float, places: bool = True) -> None:
        """Refuse what the format cannot hold.

        Raises:
            ValueError: fewer frequencies than it needs; no places.
        """
        ending = Path(path).suffix
        if frequencies < self.frequencies:
            raise ValueError(
                f"{path}: a {ending} needs {self.frequencies} frequencies at least and the result "
                f"has {frequencies:g}; educe with several, or write .txt"
            )
        if self.places and not places:
            raise ValueError(
                f"{path}: a {ending} needs places and the result has no x or z; state them in the data, or write .csv"
            )


def require_result(path: str | Path, frequencies: float, places: bool = True) -> None:
    """Before the work: refuse a name in whose format the result could not be written.

    Args:
        path: whose ending names the format.
        frequencies, places: of the result, as for ``ResultWriter.require``.
    """
    home = RESULT_WRITERS.get(Path(path).suffix.lower())
    if home is not None:
        resolve(home).require(path, frequencies, places)


def complex_names(names: Iterable[Any]) -> list[tuple[str, str, str]]:
    """What two real variables are together, and their names, for every such pair."""
    there, found = list(map(str, names)), []
    for real in there:
        imaginary = real.replace("resistance", "reactance")
        whole = real.replace("resistance", "impedance")
        if real.endswith("_real"):
            whole = real.removesuffix("_real")
            imaginary = f"{whole}_imaginary"
        if imaginary != real and imaginary in there:
            found.append((whole, real, imaginary))
    return found
