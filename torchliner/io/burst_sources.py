"""Stations of a file or folder, read one by one, so that a line need not fit into memory."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py

from torchliner.io.burst_csv import is_burst_csv, read_burst_csv, stated_place
from torchliner.io.burst_file import read_burst_file, station_places
from torchliner.io.burst_text import read_burst_columns
from torchliner.io.dantec import HEADER_LINES, is_dantec, read_dantec, read_header
from torchliner.records import BurstRecord
from torchliner.text_columns import read_lines

SUFFIXES = (".txt", ".csv", ".dat", ".asc", ".tsv", ".h5", ".nc", "")
SAME_PLACE = 1e-7  # m: traverses are set to micrometres
HEAD = 1 << 16  # bytes of a text file that hold all that stands before the bursts

Place = tuple[float | None, float | None, float | None]


@dataclass(frozen=True)
class StationSource:
    """One station that is still in its file.

    Args:
        path: file.
        number: of the station in an HDF5 file; None for a text file.
        place: (x, y, z), m; None where unknown.
        options: how the file is read.
        about: further fields of the record.
    """

    path: Path
    number: int | None
    place: Place
    options: Mapping[str, Any] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """How messages call it."""
        return str(self.path) if self.number is None else f"{self.path}, station {self.number}"

    def read(self) -> BurstRecord:
        """The bursts.

        Raises:
            FileNotFoundError, OSError, ValueError: as the readers of the formats.
        """
        if self.number is not None:
            return read_burst_file(self.path, self.number)[0]
        if is_dantec(self.path):
            chosen = {key: self.options.get(key) for key in ("components", "coincidence_window")}
            return read_dantec(self.path, **chosen, **self.about)
        if self.options.get("columns") is not None and not is_burst_csv(_head(self.path)):
            return read_burst_columns(
                self.path, self.options["columns"], self.options["separator"], **self.about
            )
        return read_burst_csv(self.path, **self.about)

    def digest(self) -> str:
        """SHA-256 of the file and of how it is read."""
        said = f"{self.number} {sorted(self.options.items())} {sorted(self.about.items())}"
        status = self.path.stat()
        content = _content(self.path, status.st_size, status.st_mtime_ns)
        return hashlib.sha256(f"{content} {said}".encode()).hexdigest()


@functools.lru_cache(maxsize=4)
def _content(path: Path, size: int, changed: int) -> str:
    """Of a file as it is at present: many stations of one file are hashed once."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def list_stations(
    path: str | Path,
    columns: str | Sequence[str] | None = None,
    separator: str = "blank",
    components: Sequence[str] | None = None,
    coincidence_window: float | None = None,
    **about: Any,
) -> list[StationSource]:
    """Stations of a file or folder in the order of x, y, z; by name without positions.

    Args:
        path: a file of our HDF5 or CSV, a DXEX export, columns without a header; or a folder of
            files of one station each.
        columns, separator: of files without a header, as in ``read_burst_columns``.
        components, coincidence_window: of DXEX files, as in ``read_dantec``.
        about: further fields of each record, e.g. ``frequency``; not for HDF5, which states its
            own.
    Raises:
        FileNotFoundError, OSError: no such file or folder, or it cannot be read.
        ValueError: a folder without files of bursts, two stations at the same position, a file of
            no known layout.
    """
    path = Path(path)
    options = {"columns": columns, "separator": separator, "components": components,
               "coincidence_window": coincidence_window}  # fmt: skip
    files = _files(path) if path.is_dir() else [path]
    return sort_stations([each for file in files for each in _sources(file, options, about)])


def _files(folder: Path) -> list[Path]:
    files = sorted(
        file for file in folder.iterdir()
        if file.is_file() and not file.name.startswith(".") and file.suffix.lower() in SUFFIXES
    )  # fmt: skip
    if not files:
        raise ValueError(
            f"{folder} holds no files of bursts ({', '.join(s for s in SUFFIXES if s)}); name the "
            "folder that does"
        )
    return files


def _sources(path: Path, options: dict[str, Any], about: dict[str, Any]) -> list[StationSource]:
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    if h5py.is_hdf5(path):
        if about:
            raise ValueError(
                f"{path} states its own {', '.join(about)}; change them there, or leave them out"
            )
        return [StationSource(path, i, place) for i, place in enumerate(station_places(path))]
    return [StationSource(path, None, _place(path, options, about), options, about)]


def _head(path: Path) -> list[str]:
    """Lines before the bursts, and some of them."""
    return read_lines(path, HEAD)


def _place(path: Path, options: dict[str, Any], about: dict[str, Any]) -> Place:
    """Where a text file says it was measured; its bursts are not read."""
    lines = _head(path)
    stated: dict[str, float] = {}
    if is_dantec(path):
        position = read_header(lines[: HEADER_LINES + 1], path).position
        stated = dict(zip("xyz", position, strict=True))
    elif is_burst_csv(lines):
        stated = stated_place(lines, path)
    elif options["columns"] is None:
        raise ValueError(
            f"{path} begins with {lines[0].strip()[:40]!r}: neither 'DXEX v3' or 'DXEX v5' nor a "
            "header with 'arrival_time [ms]'. If it is columns without a header, state them, e.g. "
            "--columns 'row, arrival_time [ms], transit_time [us], streamwise [m/s], "
            "wall_normal [m/s]'"
        )
    return tuple(about.get(key, stated.get(key)) for key in "xyz")  # type: ignore[return-value]


def sort_stations(sources: Sequence[StationSource]) -> list[StationSource]:
    """In the order of x, y, z where all are known, else as they come.

    Raises:
        ValueError: two have the same position; some state one, others none.
    """
    known = [each for each in sources if None not in each.place]
    if not known:
        return list(sources)
    if len(known) < len(sources):
        without = next(each for each in sources if None in each.place)
        raise ValueError(
            f"{without.name} states no position (x, y, z), {known[0].name} does; stations are "
            "placed all or none"
        )
    order = order_of([each.place for each in sources], [each.name for each in sources])
    return [sources[i] for i in order]


def order_of(places: Sequence[Place], names: Sequence[str]) -> list[int]:
    """Numbers of stations in the order of x, y, z.

    Args:
        places: (x, y, z), m, all known.
        names: of the stations, for the message.
    Raises:
        ValueError: two have the same position.
    """
    order = sorted(range(len(places)), key=lambda i: places[i])  # type: ignore[arg-type, return-value]
    for i, j in pairwise(order):
        both = list(zip(places[i], places[j], strict=True))
        if all(abs(a - b) <= SAME_PLACE for a, b in both):  # type: ignore[operator]
            said = ", ".join(f"{1e3 * value:.4g}" for value, _ in both)  # type: ignore[operator]
            raise ValueError(
                f"{names[i]} and {names[j]} have the same position, ({said}) mm; take one away, or "
                "put repeated measurements into folders of their own"
            )
    return order


def read_bursts(
    path: str | Path,
    columns: str | Sequence[str] | None = None,
    separator: str = "blank",
    components: Sequence[str] | None = None,
    coincidence_window: float | None = None,
    **about: Any,
) -> list[BurstRecord]:
    """Stations of a file or folder, in the order of x, then y, z; by name without positions.

    Arguments and errors are those of ``list_stations``, which names the stations without reading
    their bursts; and a file with faults is a ValueError.
    """
    stations = list_stations(path, columns, separator, components, coincidence_window, **about)
    return [station.read() for station in stations]
