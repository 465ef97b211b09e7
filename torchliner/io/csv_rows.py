"""Results as rows of a table: one a place and frequency, with all that stands along them."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from torchliner.io.own_writer import dims_of, plain
from torchliner.io.whole_file import printable, written_whole
from torchliner.records.declared import flat
from torchliner.records.outlets import Result

Rows = list[dict[str, Any]]
DIGITS = ".9g"  # of numbers in the CSV of a result
BOUNDS = [f"{part}_{end}" for part in ("resistance", "reactance") for end in ("low", "high")]
LEADING = ("name", "x (m)", "y (m)", "z (m)", "frequency (Hz)", "resistance", "reactance", *BOUNDS)


def write_result_csv(record: Result, path: str | Path) -> None:
    """The rows of the usual place."""
    write_rows(result_rows(record), path, DIGITS)


def to_dataframe(record: Result, of: str | None = None) -> Any:
    """The rows of the CSV, or those of another place.

    Raises:
        ValueError: there are no such rows.
    """
    import pandas

    return pandas.DataFrame(result_rows(record, of))


def result_rows(record: Result, of: str | None = None) -> Rows:
    """One row a place and frequency: coordinates, then what stands along them.

    Names without the noun that they begin with; with several averagings a column each.

    Args:
        record: result.
        of: a key of its ``PLACES``; default the first, or all of them.
    Raises:
        ValueError: there are no such places.
    """
    if of not in (None, *record.PLACES):
        raise ValueError(f"no rows of {of!r}; there are those of {', '.join(record.PLACES)}")
    if record.TOGETHER:
        several = {each: _rows_of(record, each) for each in record.PLACES if of in (None, each)}
        found = [{"place": each.removesuffix("s"), **row} for each, rows in several.items() for row in rows]
    else:
        found = _rows_of(record, of or next(iter(record.PLACES)))
    return found


def _rows_of(record: Result, of: str) -> Rows:
    noun, axes, sizes = of.removesuffix("s"), getattr(record, "axes", {}), dict[str, int]()
    places = dims_of(record.PLACES[of], axes)
    wanted, found = (*places, "frequency"), dict[str, tuple[list[str], np.ndarray]]()
    for row, value in flat(record):
        dims, values = dims_of(row.dims, axes), plain(value)
        own = [dim for dim in dims if dim != "averaging"]
        if not own or not {*own} <= {*wanted}:
            continue
        if not {*own} & {*places} and not row.names[0].startswith((f"{noun}_", "frequency")):
            continue
        sizes |= dict(zip(own, values.shape[len(dims) - len(own) :], strict=True))
        averagings = record.averagings if own != dims else ()  # type: ignore[attr-defined]  # a map has them
        for stem, part in zip(row.names, (values.real, values.imag) if len(row.names) > 1 else (values,), strict=True):
            label = stem.removeprefix(f"{noun}_") + ("" if row.unit == "1" else f" ({row.unit})")
            several = {f"{label}, {name}": each for name, each in zip(averagings, part, strict=False)} or {label: part}
            found |= {key: (own, each) for key, each in several.items()}
    shape = [sizes.get(dim, len(record.frequency) if dim == "frequency" else 1) for dim in wanted]  # type: ignore
    columns = {key: _spread(values, own, wanted, shape) for key, (own, values) in found.items()}
    order = [*(key for key in LEADING if key in columns), *(key for key in columns if key not in LEADING)]
    return [dict(zip(order, row, strict=True)) for row in zip(*(columns[key] for key in order), strict=True)]


def _spread(values: np.ndarray, own: Sequence[str], wanted: Sequence[str], shape: Sequence[int]) -> list[Any]:
    """Values of all rows, of values along some dimensions."""
    own_shape = [size if dim in own else 1 for dim, size in zip(wanted, shape, strict=True)]
    flat_values: list[Any] = np.broadcast_to(values.reshape(own_shape), shape).reshape(-1).tolist()
    return flat_values


def write_rows(rows: Sequence[Mapping[str, Any]], path: str | Path, number: str = "", end: str = "\r\n") -> None:
    """A CSV file with the headings of all rows, whole or not at all.

    Args:
        rows: at least one.
        path: file.
        number: format of numbers, as ".9g"; default: as many digits as they have.
        end: of lines.
    """
    with written_whole(path, ".csv") as temporary, temporary.open("w", newline="") as file:
        fill_csv(file, rows, number, end)


def fill_csv(file: TextIO, rows: Sequence[Mapping[str, Any]], number: str = "", end: str = "\r\n") -> None:
    """Into what is open, in memory too; arguments as for ``write_rows``."""
    writer = csv.writer(file, lineterminator=end)
    headings = dict.fromkeys(key for row in rows for key in row)
    writer.writerow(map(text_cell, headings))
    for row in rows:
        cells = (row.get(key) for key in headings)
        writer.writerow(
            text_cell(each) if isinstance(each, str) else each if each is None or not number else f"{each:{number}}"
            for each in cells
        )


def text_cell(text: str) -> str:
    """A text that a spreadsheet takes as text: a formula gets a quote before it."""
    text = printable(text)
    if not text.startswith(("=", "+", "-", "@", "\t")):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text
