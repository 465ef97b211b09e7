"""Results as rows of a table: one a place and frequency, with all that stands along them."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from torchliner.io.own_writer import dims_of, to_xarray
from torchliner.io.whole_file import printable, written_whole
from torchliner.records.outlets import Result

Rows = list[dict[str, Any]]
DIGITS = ".9g"  # of numbers in the CSV of a result
BOUNDS = [f"{part}_{end}" for part in ("resistance", "reactance") for end in ("low", "high")]
LEADING = ("name", "x (m)", "y (m)", "z (m)", "frequency (Hz)", "resistance", "reactance", *BOUNDS)


def write_result_csv(record: Result, path: str | Path) -> None:
    """The rows of the usual place."""
    write_rows(result_rows(record), path, DIGITS)


def to_dataframe(record: Result, of: str | None = None) -> Any:
    """The rows of the CSV, or those of another place; a ValueError where there are no such rows."""
    import pandas

    return pandas.DataFrame(result_rows(record, of))


def result_rows(record: Result, of: str | None = None) -> Rows:
    """One row a place and frequency: coordinates, then what stands along them; ``of``: a key of its ``PLACES``, default
    the first, or all of them; a ValueError for others.

    Names without the noun that they begin with; with several averagings a column each.
    """
    if of not in (None, *record.PLACES):
        raise ValueError(f"no rows of {of!r}; there are those of {', '.join(record.PLACES)}")
    data = to_xarray(record)
    if not record.TOGETHER:
        return _rows_of(data, record, of or next(iter(record.PLACES)))
    several = {each: _rows_of(data, record, each) for each in record.PLACES if of in (None, each)}
    return [{"place": each.removesuffix("s"), **row} for each, rows in several.items() for row in rows]


def _rows_of(data: Any, record: Result, of: str) -> Rows:
    noun, places = of.removesuffix("s"), dims_of(record.PLACES[of], getattr(record, "axes", {}))
    sizes = {dim: data.sizes.get(dim, 1) for dim in (*places, "frequency")}
    columns: dict[str, list[Any]] = {}
    for name, each in data.variables.items():
        own = {*each.dims} - {"averaging"}
        of_all = own == {"frequency"} and not name.startswith((f"{noun}_", "frequency"))  # not of these places
        if not own or not own <= {*sizes} or of_all or np.iscomplexobj(each):
            continue
        label = name.removeprefix(f"{noun}_") + ("" if (unit := each.attrs.get("units", "1")) == "1" else f" ({unit})")
        several = {label: each}
        if "averaging" in each.dims:
            several = {f"{label}, {one}": each[{"averaging": i}] for i, one in enumerate(data["averaging"].values)}
        columns |= {key: one.set_dims(sizes).values.ravel().tolist() for key, one in several.items()}
    order = [*(key for key in LEADING if key in columns), *(key for key in columns if key not in LEADING)]
    return [dict(zip(order, row, strict=True)) for row in zip(*(columns[key] for key in order), strict=True)]


def write_rows(rows: Sequence[Mapping[str, Any]], path: str | Path, number: str = "") -> None:
    """A CSV file with the headings of all rows, at least one, whole or not at all; ``number``: format, as ".9g",
    default as many digits as they have."""
    with written_whole(path, ".csv") as temporary, temporary.open("w", newline="") as file:
        fill_csv(file, rows, number)


def fill_csv(file: TextIO, rows: Sequence[Mapping[str, Any]], number: str = "") -> None:
    """Into what is open, in memory too; arguments as for ``write_rows``."""

    def cell(value: Any) -> Any:
        if isinstance(value, str):
            return printable(value)
        return value if value is None or not number else f"{value:{number}}"

    writer = csv.writer(file)
    headings = dict.fromkeys(key for row in rows for key in row)
    writer.writerow(map(cell, headings))
    writer.writerows([cell(row.get(key)) for key in headings] for row in rows)
