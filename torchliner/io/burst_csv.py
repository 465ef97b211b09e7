"""Bursts of one station as CSV: '# key = value unit' lines, a header with units, the bursts."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

from torchliner.io.burst_text import named_columns, read_columns, read_lines, record_of
from torchliner.io.hdf5 import written_whole
from torchliner.io.plane_file import SCALARS as PLANE_SCALARS
from torchliner.io.units import si_factor
from torchliner.records import BurstRecord
from torchliner.records.burst_record import UNITS
from torchliner.words import did_you_mean

NUMBERS = {
    **dict.fromkeys("xyz", ("length", "m")),
    **{key: kind for key, kind in PLANE_SCALARS.items() if key != "height"},
}
TEXTS = ("title", "source_side", "liner")
SEPARATORS = (";", "\t", ",")


def write_burst_csv(record: BurstRecord, path: str | Path) -> None:
    """Write one station. Fluid, references, provenance and notes need the HDF5 file."""
    with written_whole(path) as temporary, temporary.open("w", newline="") as file:
        for key, (_, unit) in NUMBERS.items():
            value = getattr(record, key)
            if value is not None:
                file.write(f"# {key} = {float(value)!r} {unit}\n")
        for key in TEXTS:
            if getattr(record, key):
                file.write(f"# {key} = {getattr(record, key)}\n")
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
    start = _header_line(lines, path)
    stated = _stated(lines[:start], path)
    separator = next((s for s in SEPARATORS if s in lines[start]), ",")
    columns = named_columns(lines[start].split(separator), path)
    found = read_columns(lines[start + 1 :], start + 2, columns, path, separator)
    return record_of(found, path, provenance={"format": "csv"}, **{**stated, **about})


def stated_place(lines: list[str], path: str | Path) -> dict[str, float]:
    """x, y, z, m, as far as the lines before the header state them."""
    said = _stated(lines[: _header_line(lines, path)], path)
    return {key: said[key] for key in "xyz" if key in said}


def _header_line(lines: list[str], path: str | Path) -> int:
    start = next((i for i, line in enumerate(lines) if line.strip() and line[0] != "#"), None)
    if start is None:
        raise ValueError(f"{path} has no header line with the names of the columns")
    return start


def _stated(lines: list[str], path: str | Path) -> dict[str, Any]:
    """What the lines before the header say."""
    said: dict[str, Any] = {}
    known = [*NUMBERS, *TEXTS, "dropped"]
    for number, line in enumerate(lines, 1):
        found = re.fullmatch(r"#\s*(\w+)\s*=\s*(.*?)\s*", line)
        if found is None:
            continue  # a remark
        key, value = found.groups()
        if key not in known:
            raise ValueError(
                f"{path}: line {number} states {key!r}{did_you_mean(key, known)}; known are "
                f"{', '.join(known)}"
            )
        said[key] = value if key in TEXTS else _value(key, value, f"{path}: line {number}, {key}")
    return said


def _value(key: str, text: str, label: str) -> Any:
    try:
        if key == "dropped":
            return json.loads(text)
        number, _, unit = text.partition(" ")
        amount = float(number)
    except ValueError as error:
        raise ValueError(f"{label} is {text!r}; it cannot be read") from error
    return amount * si_factor(NUMBERS[key][0], unit, label)
