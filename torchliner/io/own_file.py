"""Files of our own records: how one kind of record goes to a file and comes back."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.io.csv_rows import Rows, write_rows
from torchliner.io.fields import attach_places, fill, take
from torchliner.io.hdf5 import open_file, set_texts, text_attribute
from torchliner.io.tables import Axes, FileKind
from torchliner.names import RESULT_WRITERS, resolve
from torchliner.records.declared import PARTS

RESULT_ENDINGS = (".csv", *RESULT_WRITERS)


@dataclass(frozen=True)
class OwnFile(FileKind):
    """How one kind of record goes to a file and comes back.

    Args:
        record: its class, whose fields say what stands in the file.
        axes: of a record: dimensions that stand behind names of its variables.
        unsaid: fields that are not in the file.
        places: what a row of a CSV stands for, and its dimensions beside the frequency; the first is the usual one.
        csv: settings of ``write_rows``.
    """

    record: Any = None
    axes: Callable[[Any], Axes] = lambda _: {}
    unsaid: Sequence[str] = ()
    places: Mapping[str, Sequence[str]] = field(default_factory=dict)
    csv: Mapping[str, str] = field(default_factory=dict)

    def write(self, record: Any, path: str | Path) -> None:
        """One file, by its ending; the old one, if any, is replaced when the new one is whole.

        Raises:
            ValueError: no writer has this ending; what the format cannot hold.
        """
        ending = Path(path).suffix.lower()
        if self.places and ending in RESULT_WRITERS:
            resolve(RESULT_WRITERS[ending])(self, record, path)
        elif self.places and ending == ".csv":
            write_rows(self.rows(record), path, **self.csv)
        else:
            with self.created(path, record) as file:
                self.fill(file, record)

    def write_head(self, group: h5py.Group, record: Any) -> None:
        """Schema alone: ``fill`` writes the attributes."""
        set_texts(group, schema=self.schema)

    def fill(self, group: h5py.Group, record: Any) -> None:
        """Into an open file, or a group of one."""
        self.write_head(group, record)
        fill(group, record, axes=self.axes(record), unsaid=self.unsaid)
        attach_places(group)

    def read(self, path: str | Path) -> Any:
        """A record of this kind.

        Args:
            path: .h5, .hdf5 or .nc, as ``write`` of the record made it.
        Raises:
            FileNotFoundError, OSError: missing, truncated, not HDF5.
            ValueError: not of this schema; a variable is missing, has another shape, unit or size than it can have, or
                is not what follows from the others. The message names FILE:/variable.
        """
        with open_file(path) as file:
            return self.taken(file, path)

    def taken(self, group: h5py.Group, path: str | Path, **known: Any) -> Any:
        """From an open file, or a group of one; ``known``: fields that were read already."""
        self.require(group, path)
        return take(group, self.record, path, {}, dict.fromkeys(self.unsaid) | known)

    def rows(self, record: Any, of: str | None = None) -> Rows:
        """One row a place and frequency, with all that stands along them.

        Raises:
            ValueError: there are no such places.
        """
        of = next(iter(self.places)) if of is None else of
        if of not in self.places:
            raise ValueError(f"no rows of {of!r}; there are those of {', '.join(self.places)}")
        axes = self.axes(record)
        dims = [dim for name in self.places[of] for dim in axes.get(name, (name,))]
        with self.in_memory(record) as (_, file):
            return rows_along(file, dims, of.removesuffix("s"))

    @contextmanager
    def in_memory(self, record: Any) -> Iterator[tuple[io.BytesIO, h5py.File]]:
        """The netCDF-4 file without a disk: what it would be as bytes, and open."""
        buffer = io.BytesIO()
        with h5py.File(buffer, "w") as file:
            self.fill(file, record)
            file.flush()
            yield buffer, file

    def to_xarray(self, record: Any) -> Any:
        """What ``xarray.open_dataset`` shows of the file, and the complex values.

        Raises:
            ImportError: xarray or h5netcdf is not installed.
        """
        try:
            import h5netcdf  # noqa: F401
            import xarray
        except ImportError as error:
            raise ImportError('labelled arrays need pip install "torchliner[xarray]"') from error
        with self.in_memory(record) as (buffer, _):
            found = xarray.load_dataset(buffer, engine="h5netcdf")
        for name, (real, imaginary) in complex_names(map(str, found)).items():
            text = found[real].attrs.get("long_name", name)
            text = text.replace("real part of the ", "").replace("resistance", "impedance")
            found[name] = (found[real] + 1j * found[imaginary]).assign_attrs(found[real].attrs | {"long_name": text})
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
        return pandas.DataFrame(self.rows(record, of))


def rows_along(file: h5py.File, places: Sequence[str], noun: str) -> Rows:
    """A row for each element of some dimensions and of the frequency: coordinates, then what stands along them.

    Names without the ``noun`` that they begin with; with several averagings a column each.
    """
    wanted, found = (*places, "frequency"), dict[str, list[Any]]()
    sizes = [len(file[dim]) for dim in wanted]
    averagings = file["averaging"].asstr()[()] if "averaging" in file else []
    for name, each in file.items():
        if isinstance(each, h5py.Group) or each.dtype.kind not in "fiu" or not each.shape:
            continue
        dims = [str(dim[0].name)[1:] for dim in each.dims if len(dim)] or [name]
        own = [dim for dim in dims if dim != "averaging"]
        index = each.is_scale and text_attribute(each, "units") == "1"
        if index or not {*own} <= {*wanted} or not ({*own} & {*places} or name.startswith((f"{noun}_", "frequency"))):
            continue
        unit = text_attribute(each, "units")
        label = name.removeprefix(f"{noun}_") + ("" if unit == "1" else f" ({unit})")
        shape = [size if dim in own else 1 for dim, size in zip(wanted, sizes, strict=True)]
        parts = (
            {label: each[()]}
            if own == dims
            else {f"{label}, {a}": part for a, part in zip(averagings, each[()], strict=True)}
        )
        found |= {key: np.broadcast_to(part.reshape(shape), sizes).reshape(-1).tolist() for key, part in parts.items()}
    bounds = (f"{part}_{end}" for part in ("resistance", "reactance") for end in ("low", "high"))
    leading = ("x (m)", "y (m)", "z (m)", "frequency (Hz)", "resistance", "reactance", *bounds)
    first = [key for key in leading if key in found]
    columns = {key: found[key] for key in (*first, *(key for key in found if key not in first))}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def complex_names(names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """The two real variables of each complex one, by what they are together."""
    there, found = list(names), {}
    for real in there:
        for whole, (first, second) in {"impedance": PARTS["impedance"], "": ("_real", "_imaginary")}.items():
            if first in real and (other := real.replace(first, second)) in there:
                found[real.replace(first, whole)] = real, other
    return found
