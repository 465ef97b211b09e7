"""Bursts of one station as CSV: '# key = value unit' lines, a header with units, the bursts."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from torchliner.io.burst_text import named_columns, read_columns, record_of
from torchliner.io.hdf5 import written_whole
from torchliner.io.plane_file import SCALARS as PLANE_SCALARS
from torchliner.records import BurstRecord
from torchliner.records.burst_record import UNITS
from torchliner.text_columns import (
    header_line,
    read_lines,
    separator_of,
    si_value,
    stated_text,
    stated_values,
)

NUMBERS = {
    **dict.fromkeys("xyz", ("length", "m")),
    **{key: kind for key, kind in PLANE_SCALARS.items() if key != "height"},
}
TEXTS = ("title", "source_side", "liner")


def write_burst_csv(record: BurstRecord, path: str | Path) -> None:
    """Write one station. Fluid, references, provenance and notes need the HDF5 file."""
    with written_whole(path) as temporary, temporary.open("w", newline="") as file:
        for key, (_, unit) in NUMBERS.items():
            value = getattr(record, key)
            if value is not None:
                file.write(f"# {key} = {float(value)!r} {unit}\n")
        for key in TEXTS:
            if getattr(record, key):
                file.write(stated_text(key, getattr(record, key), path))
        if record.dropped:
            file.write(f"# dropped = {json.dumps(dict(record.dropped))}\n")
        columns = {n: v.tolist() for n in UNITS if (v := getattr(record, n)) is not None}
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([f"{name} [{UNITS[name]}]" for name in columns])
        writer.writerows([repr(v) for v in row] for row in zip(*columns.values(), strict=True))


def is_burst_csv(lines: list[str]) -> bool:
    """Whether the first line that is no comment names an arrival time."""
    header = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    return "arrival_time" in header


def read_burst_csv(path: str | Path, **about: Any) -> BurstRecord:
    """Bursts of one station.

    Args:
        path: text; columns as ``read_burst_columns`` names them, in a header line, separated by
            comma, semicolon or tab (a decimal comma needs one of the latter).
        about: further fields of the record, instead of those of the file.
    Raises:
        FileNotFoundError, OSError: no such file, a folder.
        ValueError: empty, header only, a column missing or without a unit, an unknown key, mixed
            decimal marks, an unreadable or missing cell.
    """
    lines = read_lines(path)
    start = header_line(lines, path)
    stated = _stated(lines[:start], path)
    separator = separator_of(lines[start])
    columns = named_columns(lines[start].split(separator), path)
    found = read_columns(lines[start + 1 :], start + 2, columns, path, separator)
    return record_of(found, path, provenance={"format": "csv"}, **{**stated, **about})


def stated_place(lines: list[str], path: str | Path) -> dict[str, float]:
    """x, y, z, m, as far as the lines before the header state them."""
    said = _stated(lines[: header_line(lines, path)], path)
    return {key: said[key] for key in "xyz" if key in said}


def _stated(lines: list[str], path: str | Path) -> dict[str, Any]:
    """What the lines before the header say."""
    said: dict[str, Any] = {}
    for key, value, label in stated_values(lines, [*NUMBERS, *TEXTS, "dropped"], path):
        if key in NUMBERS:
            said[key] = si_value(value, NUMBERS[key][0], label)
        else:
            said[key] = value if key in TEXTS else _counts(value, label)
    return said


def _counts(text: str, label: str) -> Any:
    try:
        found = json.loads(text)
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise ValueError(f"{label} is {text!r}; it cannot be read, counts by reason are needed")
    return found
