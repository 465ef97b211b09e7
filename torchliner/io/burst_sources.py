"""Stations of a file or folder, read one by one, so that a line need not fit into memory; files of our own.

Our HDF5 is a record, or several in groups ``station_0``, ``station_1`` ... (docs/ldv.md).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py

from torchliner.file_checks import require_regular
from torchliner.io.burst_text import HEAD, BurstFormat, Options, Place
from torchliner.io.hdf5 import open_file
from torchliner.io.own_file import groups_of, read_row, require_schema, taken
from torchliner.io.own_writer import write_record, write_several
from torchliner.names import BURST_FORMATS, resolve
from torchliner.records import BurstRecord
from torchliner.records.declared import table_of
from torchliner.records.origin import input_file
from torchliner.text_columns import read_lines

SUFFIXES = (".txt", ".csv", ".dat", ".asc", ".tsv", ".h5", ".nc", "")
SAME_PLACE = 1e-7  # m: traverses are set to micrometres
PLACE = table_of(BurstRecord, "x", "y", "z")


@dataclass(frozen=True)
class StationSource:
    """One station that is still in its file.

    Args:
        path: file.
        number: of the station in a file that holds several; None elsewhere.
        place: (x, y, z), m; None where unknown.
        format: of the file, a key of ``names.BURST_FORMATS``.
        options: how the file is read.  about: further fields of the record.
    """

    path: Path
    number: int | None
    place: Place
    format: str
    options: Mapping[str, Any] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """How messages call it."""
        return str(self.path) if self.number is None else f"{self.path}, station {self.number}"

    def read(self) -> BurstRecord:
        """The bursts; errors are those of the readers of the formats."""
        found = _format(self.format).read(self.path, self.number or 0, self.options, self.about)
        title = self.path.stem if self.number is None else f"{self.path.stem} {self.number}"
        return replace(found, name=self.name, title=found.title or title)

    def digest(self) -> str:
        """Hash of the file and of how it is read."""
        how = (self.number, sorted(self.options.items()), sorted(self.about.items()))
        return hashlib.sha256(f"{input_file('', self.path)['hash']} {how}".encode()).hexdigest()


def _format(name: str) -> BurstFormat:
    found: BurstFormat = resolve(BURST_FORMATS[name])
    return found


def list_stations(
    path: str | Path,
    columns: str | Sequence[str] | None = None,
    separator: str = "blank",
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
            none of which an option says how it is read.
    """
    path, files = Path(path), [Path(path)]
    options: dict[str, Any] = {"columns": columns, "separator": separator, "components": components}
    if path.is_dir():
        files = [each for each in sorted(path.iterdir()) if each.is_file() and not each.name.startswith(".")]
        files = [each for each in files if each.suffix.lower() in SUFFIXES]
    if not files:
        raise ValueError(f"{path} holds no files of bursts ({', '.join(filter(None, SUFFIXES))}); name another folder")
    sources = [each for file in files for each in _sources(file, options, about)]
    takes = {key for each in sources for key in _format(each.format).takes}
    for key, value in options.items():
        if value not in (None, "blank") and key not in takes:
            raise ValueError(f"{path} is of format {sources[0].format} and takes no {key}=...; leave it out")
    places = [each.place for each in sources]
    without = [each.name for each in sources if None in each.place]
    if without and len(without) < len(sources):
        raise ValueError(f"{without[0]} states no position (x, y, z), others do; place all or none")
    order = range(len(sources)) if without else order_of(places, [each.name for each in sources])
    return [sources[i] for i in order]


def _sources(path: Path, options: Options, about: Options) -> list[StationSource]:
    """Stations of a file, of the first format that recognises it."""
    require_regular(path)
    name = next((name for name in BURST_FORMATS if _format(name).recognises(path, options)), None)
    if name is None:
        raise ValueError(
            f"{path} begins with {read_lines(path, HEAD)[0].strip()[:40]!r}: neither 'DXEX v3' or 'DXEX v5' nor a "
            "header with 'arrival_time [ms]'. State columns without a header, e.g. --columns 'row, arrival_time [ms], "
            "wall_normal [m/s]'"
        )
    places = _format(name).places(path)
    if not _format(name).own_fields:
        x, y, z = (about.get(key, value) for key, value in zip("xyz", places[0], strict=True))
        return [StationSource(path, None, (x, y, z), name, options, about)]
    if about:
        raise ValueError(f"{path} has places of its own for {', '.join(about)}; state them there, or leave them out")
    return [StationSource(path, i if len(places) > 1 else None, place, name) for i, place in enumerate(places)]


def order_of(places: Sequence[Place], names: Sequence[str]) -> list[int]:
    """Numbers of stations in the order of x, y, z, (m, all known), by whose ``names`` the message calls them.

    Raises:
        ValueError: two have the same position.
    """
    known: list[Any] = list(places)
    order = sorted(range(len(known)), key=lambda i: known[i])
    for i, j in pairwise(order):
        if all(abs(a - b) <= SAME_PLACE for a, b in zip(known[i], known[j], strict=True)):
            where = ", ".join(f"{1e3 * value:.4g}" for value in known[i])
            raise ValueError(f"{names[i]} and {names[j]} have the same position, ({where}) mm; take one away")
    return order


def read_bursts(path: str | Path, **options: Any) -> list[BurstRecord]:
    """Stations of a file or folder, in the order of x, then y, z; by name without positions.

    Arguments and errors are those of ``list_stations``, which names the stations without reading their bursts; and a
    file with faults is a ValueError.
    """
    return [station.read() for station in list_stations(path, **options)]


def write_bursts(records: Sequence[BurstRecord], path: str | Path) -> None:
    """Write stations to one HDF5 file; the old one, if any, is replaced only when the new is whole.

    Raises:
        ValueError: no station.
    """
    if not records:
        raise ValueError(f"{path}: no station to write")
    if len(records) == 1:
        write_record(records[0], path)
    else:
        write_several(records, path)


def _groups(file: h5py.File, path: Path) -> list[h5py.Group]:
    """Of the stations of an open file."""
    require_schema(file, path, BurstRecord.SCHEMA)
    return groups_of(file, "station", path) or [file]


def _places(path: Path) -> list[Place]:
    with open_file(path) as file:
        groups = _groups(file, path)
        read = [[read_row(each, row, path) if row.field in each else None for row in PLACE] for each in groups]
    return [(x, y, z) for x, y, z in read]


def _read(path: Path, number: int, *_: Any) -> BurstRecord:
    with open_file(path) as file:
        found: BurstRecord = taken(_groups(file, path)[number], path, BurstRecord)
    return found


FORMAT = BurstFormat(lambda path, _: bool(h5py.is_hdf5(path)), _places, _read, own_fields=True)
