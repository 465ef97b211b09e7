"""Bursts of one station as CSV: '# key = value unit' lines, a header with units, the bursts."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from torchliner.io.burst_format import BurstFormat, Place, read_head
from torchliner.io.burst_text import burst_columns, read_bursts_of, record_of
from torchliner.io.plane_file import UNITS as PLANE_UNITS
from torchliner.io.stated_lines import read_stated, write_stated
from torchliner.io.whole_file import written_whole
from torchliner.records import BurstRecord
from torchliner.records.burst_record import UNITS
from torchliner.text_columns import cells_of, header_line, read_lines, separator_of

STATED = {
    **dict.fromkeys("xyz", "m"),
    **{key: unit for key, unit in PLANE_UNITS.items() if key != "height"},
    **dict.fromkeys(("title", "source_side", "liner"), "text"),
    "dropped": "json",
}


def write_burst_csv(record: BurstRecord, path: str | Path) -> None:
    """Write one station. Fluid, references, provenance and notes need the HDF5 file."""
    with written_whole(path, ".csv") as temporary, temporary.open("w", newline="") as file:
        write_stated(file, record, STATED, path)
        columns = {n: v.tolist() for n in UNITS if (v := getattr(record, n)) is not None}
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([f"{name} [{UNITS[name]}]" for name in columns])
        writer.writerows([repr(v) for v in row] for row in zip(*columns.values(), strict=True))


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
    stated = read_stated(lines[:start], STATED, path)
    separator = separator_of(lines[start])
    labels = cells_of(lines[start], separator)
    columns = burst_columns(labels, path)
    found = read_bursts_of(lines, start + 2, columns, path, len(labels), separator)
    return record_of(found, path, provenance={"format": "csv"}, **{**stated, **about})


def is_burst_csv(path: Path) -> bool:
    """Whether the first line that is no remark names an arrival time."""
    lines = read_head(path)
    header = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    return "arrival_time" in header


def _places(path: Path) -> list[Place]:
    lines = read_head(path)
    stated = read_stated(lines[: header_line(lines, path)], STATED, path)
    return [(stated.get("x"), stated.get("y"), stated.get("z"))]


FORMAT = BurstFormat(
    recognises=lambda path, _: is_burst_csv(path),
    places=_places,
    read=lambda path, _, options, about: read_burst_csv(path, **about),
)
