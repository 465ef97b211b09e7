"""Stations of a file or folder, read one by one, so that a line need not fit into memory; and files of our own.

Our HDF5 is a record, or several in groups ``station_0``, ``station_1`` ... (docs/ldv.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, cast

import h5py

from torchliner.file_checks import require_regular
from torchliner.io.burst_text import STATED, position_of, read_burst_columns, read_dantec
from torchliner.io.hdf5 import open_file
from torchliner.io.own_file import groups_of, read_row, require_schema, taken
from torchliner.records import BurstRecord
from torchliner.records.declared import table_of
from torchliner.records.origin import input_file
from torchliner.text_columns import header_line, read_lines, read_stated

SUFFIXES = (".txt", ".csv", ".dat", ".asc", ".tsv", ".h5", ".nc", "")
SAME_PLACE = 1e-7  # m: traverses are set to micrometres
HEAD = 1 << 16  # bytes of a text file that hold all that stands before the bursts
PLACE = table_of(BurstRecord, "x", "y", "z")


class StationSource(NamedTuple):
    """One station that is still in its file."""

    path: Path
    number: int | None  # in a file that holds several
    place: tuple[Any, ...]  # (x, y, z), m; None where unknown
    reader: partial[BurstRecord]

    @property
    def name(self) -> str:
        """How messages call it."""
        return str(self.path) if self.number is None else f"{self.path}, station {self.number}"

    def digest(self) -> tuple[Any, ...]:
        """Hash of the file, and how it is read."""
        return (input_file("", self.path)["hash"], self.number, self.reader.args[1:], self.reader.keywords)

    def read(self) -> BurstRecord:
        """The bursts; errors are those of the readers of the formats."""
        found = self.reader()
        title = self.path.stem if self.number is None else f"{self.path.stem} {self.number}"
        return replace(found, name=self.name, title=found.title or title)


def list_stations(
    path: str | Path,
    columns: str | Sequence[str] | None = None,
    separator: str | None = None,
    components: Sequence[str] | None = None,
    **about: Any,
) -> list[StationSource]:
    """Stations of a file or folder in the order of x, y, z; by name without positions.

    Args:
        path: a file of our HDF5 or CSV, a DXEX export, columns without a header; or a folder of files of one station.
        columns, separator: of files without a header, as in ``read_burst_columns``.
        components: of DXEX files, as in ``read_dantec``.
        about: further fields of each record, e.g. ``frequency``; not for HDF5, which states its own.
    Raises:
        FileNotFoundError, OSError: no such file or folder, or it cannot be read.
        ValueError: a folder without files of bursts, two stations at the same position, a file of no known layout, or
            one that takes no such option.
    """
    path, files = Path(path), [Path(path)]
    options = {"columns": columns, "separator": separator, "components": components}
    options = {key: value for key, value in options.items() if value is not None}
    if path.is_dir():
        files = [each for each in sorted(path.iterdir()) if each.is_file() and not each.name.startswith(".")]
        files = [each for each in files if each.suffix.lower() in SUFFIXES]
    if not files:
        raise ValueError(f"{path} holds no files of bursts ({', '.join(filter(None, SUFFIXES))}); name another folder")
    sources = [each for file in files for each in _sources(file, options, about)]
    without = [each.name for each in sources if None in each.place]
    if without and len(without) < len(sources):
        raise ValueError(f"{without[0]} states no position (x, y, z), others do; place all or none")
    if without:
        return sources
    sources.sort(key=lambda each: each.place)
    for one, other in pairwise(sources):
        if all(abs(a - b) <= SAME_PLACE for a, b in zip(one.place, other.place, strict=True)):
            where = ", ".join(f"{1e3 * value:.4g}" for value in one.place)
            raise ValueError(f"{one.name} and {other.name} have the same position, ({where}) mm; take one away")
    return sources


def _sources(path: Path, options: dict[str, Any], about: dict[str, Any]) -> list[StationSource]:
    """Stations of a file, told by its content; what no header tells is columns, where these are stated."""
    require_regular(path)
    if h5py.is_hdf5(path):
        if stated := options | about:
            raise ValueError(f"{path} has places of its own for {', '.join(stated)}; state or leave them out there")
        with open_file(path) as file:
            require_schema(file, path, BurstRecord.SCHEMA)
            groups = {
                str(each.name): tuple(read_row(each, row, path) if row.field in each else None for row in PLACE)
                for each in groups_of(file, "station", path) or [file]
            }
        numbers = range(len(groups)) if len(groups) > 1 else [None]
        rows = zip(numbers, groups.items(), strict=True)
        return [StationSource(path, number, place, partial(_read, path, name)) for number, (name, place) in rows]
    lines, own, takes = read_lines(path, HEAD), dict[str, Any](), {"columns", "separator"}
    start, reader = header_line(lines, path), cast(Callable[..., BurstRecord], read_burst_columns)
    if lines[0].lstrip().startswith("DXEX"):
        own, reader, takes = dict(zip("xyz", position_of(lines, path), strict=True)), read_dantec, {"components"}
    elif "arrival_time" in lines[start]:
        own, takes = read_stated(lines[:start], STATED, path), set()
    elif "columns" not in options:
        raise ValueError(
            f"{path} begins with {lines[0].strip()[:40]!r}: neither 'DXEX v3' or 'DXEX v5' nor a header with "
            "'arrival_time [ms]'. State columns without a header, e.g. --columns 'row, arrival_time [ms], "
            "wall_normal [m/s]'"
        )
    if foreign := options.keys() - takes:
        raise ValueError(f"{path} takes no {', '.join(foreign)}; leave it out")
    place = tuple(about.get(name, own.get(name)) for name in "xyz")
    return [StationSource(path, None, place, partial(reader, path, **options, **about))]


def read_bursts(path: str | Path, **options: Any) -> list[BurstRecord]:
    """Stations of a file or folder, in the order of x, then y, z; by name without positions.

    Arguments and errors are those of ``list_stations``, which names the stations without reading their bursts; and a
    file with faults is a ValueError.
    """
    return [station.read() for station in list_stations(path, **options)]


def _read(path: Path, group: str) -> BurstRecord:
    with open_file(path) as file:
        found: BurstRecord = taken(file[group], path, BurstRecord)
    return found
