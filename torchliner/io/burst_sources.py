"""Stations of a file or folder, read one by one, so that a line need not fit into memory; files of our own; and the
finished stations of a line on disk, so that a run that was broken off can go on.

Our HDF5 is a record, or several in groups ``station_0``, ``station_1`` ... (docs/ldv.md).
"""

import contextlib
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py

from torchliner.file_checks import require_regular
from torchliner.io.burst_text import STATED, position_of, read_burst_columns, read_burst_csv, read_dantec
from torchliner.io.hdf5 import open_file
from torchliner.io.own_file import groups_of, read_line, read_row, require_schema, taken
from torchliner.io.own_writer import write_record, write_several
from torchliner.records import BurstRecord, ImpedanceLine
from torchliner.records.declared import table_of
from torchliner.records.origin import input_file
from torchliner.text_columns import read_lines, read_stated

SUFFIXES = (".txt", ".csv", ".dat", ".asc", ".tsv", ".h5", ".nc", "")
SAME_PLACE = 1e-7  # m: traverses are set to micrometres
HEAD = 1 << 16  # bytes of a text file that hold all that stands before the bursts
TAKES = {"HDF5": (), "DXEX": ("components",), "CSV": (), "columns": ("columns", "separator")}  # options by format
PLACE = table_of(BurstRecord, "x", "y", "z")
Place = tuple[float | None, float | None, float | None]


@dataclass(frozen=True)
class StationSource:
    """One station that is still in its file.

    Args:
        path: file.
        number: of the station in a file that holds several; None elsewhere.
        place: (x, y, z), m; None where unknown.
        format: of the file, a key of ``TAKES``.
        reader: reads the bursts; its arguments behind the path say how.
    """

    path: Path
    number: int | None
    place: Place
    format: str
    reader: partial[BurstRecord]

    @property
    def name(self) -> str:
        """How messages call it."""
        return str(self.path) if self.number is None else f"{self.path}, station {self.number}"

    def read(self) -> BurstRecord:
        """The bursts; errors are those of the readers of the formats."""
        found = self.reader()
        title = self.path.stem if self.number is None else f"{self.path.stem} {self.number}"
        return replace(found, name=self.name, title=found.title or title)

    def digest(self) -> str:
        """Hash of the file and of how it is read."""
        how = (self.number, self.format, self.reader.args[1:], sorted(self.reader.keywords.items()))
        return hashlib.sha256(f"{input_file('', self.path)['hash']} {how}".encode()).hexdigest()


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
    takes = {key for each in sources for key in TAKES[each.format]}
    for key, value in options.items():
        if value not in (None, "blank") and key not in takes:
            raise ValueError(f"{path} is of format {sources[0].format} and takes no {key}=...; leave it out")
    without = [each.name for each in sources if None in each.place]
    if without and len(without) < len(sources):
        raise ValueError(f"{without[0]} states no position (x, y, z), others do; place all or none")
    if without:
        return sources
    return [sources[i] for i in order_of([each.place for each in sources], [each.name for each in sources])]


def _sources(path: Path, options: Mapping[str, Any], about: Mapping[str, Any]) -> list[StationSource]:
    """Stations of a file, told by its content; what no header tells is columns, where these are stated."""
    require_regular(path)
    if h5py.is_hdf5(path):
        if about:
            raise ValueError(f"{path} has places of its own for {', '.join(about)}; state or leave them out there")
        with open_file(path) as file:
            groups = _groups(file, path)
            found = [[read_row(each, row, path) if row.field in each else None for row in PLACE] for each in groups]
        places = [(x, y, z) for x, y, z in found]
        numbers = range(len(places)) if len(places) > 1 else [None]
        reads = [partial(_read, path, i) for i in range(len(places))]
        rows = zip(numbers, places, reads, strict=True)
        return [StationSource(path, number, place, "HDF5", reader) for number, place, reader in rows]
    lines = read_lines(path, HEAD)
    first = next((line for line in lines if line.strip() and line[0] != "#"), "")
    own: dict[str, Any] = {}
    if lines[0].lstrip().startswith("DXEX"):
        own = dict(zip("xyz", position_of(lines, path), strict=True))
        kind, reader = "DXEX", partial(read_dantec, path, options["components"], **about)
    elif "arrival_time" in first:
        own = read_stated(lines[: lines.index(first)], STATED, path)
        kind, reader = "CSV", partial(read_burst_csv, path, **about)
    elif options["columns"] is not None:
        kind, reader = "columns", partial(read_burst_columns, path, options["columns"], options["separator"], **about)
    else:
        raise ValueError(
            f"{path} begins with {lines[0].strip()[:40]!r}: neither 'DXEX v3' or 'DXEX v5' nor a header with "
            "'arrival_time [ms]'. State columns without a header, e.g. --columns 'row, arrival_time [ms], "
            "wall_normal [m/s]'"
        )
    x, y, z = (about.get(name, own.get(name)) for name in "xyz")
    return [StationSource(path, None, (x, y, z), kind, reader)]


def order_of(places: Sequence[Any], names: Sequence[str]) -> list[int]:
    """Numbers of stations in the order of x, y, z, (m, all known); a ValueError, which calls them by their ``names``,
    where two have the same position."""
    order = sorted(range(len(places)), key=lambda i: places[i])
    for i, j in pairwise(order):
        if all(abs(a - b) <= SAME_PLACE for a, b in zip(places[i], places[j], strict=True)):
            where = ", ".join(f"{1e3 * value:.4g}" for value in places[i])
            raise ValueError(f"{names[i]} and {names[j]} have the same position, ({where}) mm; take one away")
    return order


def read_bursts(path: str | Path, **options: Any) -> list[BurstRecord]:
    """Stations of a file or folder, in the order of x, then y, z; by name without positions.

    Arguments and errors are those of ``list_stations``, which names the stations without reading their bursts; and a
    file with faults is a ValueError.
    """
    return [station.read() for station in list_stations(path, **options)]


def write_bursts(records: Sequence[BurstRecord], path: str | Path) -> None:
    """Write stations, one at least, to an HDF5 file; an old one is replaced only when the new is whole."""
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


def _read(path: Path, number: int) -> BurstRecord:
    with open_file(path) as file:
        found: BurstRecord = taken(_groups(file, path)[number], path, BurstRecord)
    return found


@dataclass(frozen=True)
class LineParts:
    """Finished stations of a line: a folder of lines of one station each, named by what each follows from; it is made
    when the first of them is written."""

    folder: Path
    mine: list[Path] = field(default_factory=list, init=False)  # of this run

    @property
    def there(self) -> int:
        """Parts on disk, of this run or another."""
        return len([*self.folder.glob("*.h5")])

    def load(self, key: str) -> ImpedanceLine | None:
        """The station of a key; None where it is not there, or a file is damaged or not the part that its name says."""
        with contextlib.suppress(ValueError, OSError):
            line = read_line(self._path(key))
            if line.stations == 1 and line.choices.get("part") == key:
                return line
        return None

    def keep(self, key: str, line: ImpedanceLine) -> ImpedanceLine:
        """Write a finished station."""
        self.folder.mkdir(exist_ok=True)
        line = replace(line, choices={**line.choices, "part": key})
        write_record(line, self._path(key))
        return line

    def clear(self) -> None:
        """Delete the parts of this run, and the folder if nothing else is in it."""
        for path in self.mine:
            path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # not empty, not there, a link
            self.folder.rmdir()

    def _path(self, key: str) -> Path:
        path = self.folder / f"{key}.h5"
        self.mine.append(path)
        return path
