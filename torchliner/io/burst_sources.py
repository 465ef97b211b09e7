"""Stations of a file or folder, read one by one, so that a line need not fit into memory."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from torchliner.io.burst_format import Place, burst_format, format_of
from torchliner.records import BurstRecord

SUFFIXES = (".txt", ".csv", ".dat", ".asc", ".tsv", ".h5", ".nc", "")
UNSAID = {"separator": "blank"}  # defaults of how a file is read that are not None
SAME_PLACE = 1e-7  # m: traverses are set to micrometres


@dataclass(frozen=True)
class StationSource:
    """One station that is still in its file.

    Args:
        path: file.
        number: of the station in a file that can hold several; None elsewhere.
        place: (x, y, z), m; None where unknown.
        format: of the file, a key of ``names.BURST_FORMATS``.
        options: how the file is read.
        about: further fields of the record.
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
        """The bursts.

        Raises:
            FileNotFoundError, OSError, ValueError: as the readers of the formats.
        """
        read = burst_format(self.format).read
        return read(self.path, self.number or 0, self.options, self.about)

    def digest(self) -> str:
        """SHA-256 of the file and of how it is read."""
        how = f"{self.number} {sorted(self.options.items())} {sorted(self.about.items())}"
        status = self.path.stat()
        content = _content(self.path, status.st_size, status.st_mtime_ns)
        return hashlib.sha256(f"{content} {how}".encode()).hexdigest()


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
            no known layout, or none of which an option says how it is read.
    """
    path = Path(path)
    options = {"columns": columns, "separator": separator, "components": components,
               "coincidence_window": coincidence_window}  # fmt: skip
    files = _files(path) if path.is_dir() else [path]
    sources = [each for file in files for each in _sources(file, options, about)]
    taken = {key for each in sources for key in burst_format(each.format).takes}
    for key, value in options.items():
        if value not in (None, UNSAID.get(key)) and key not in taken:
            raise ValueError(
                f"{path} is of format {sources[0].format} and takes no {key}=..., as it says this "
                "itself: leave it out, or correct the file"
            )
    return sort_stations(sources)


def _files(folder: Path) -> list[Path]:
    files = sorted(
        file for file in folder.iterdir()
        if file.is_file() and not file.name.startswith(".") and file.suffix.lower() in SUFFIXES
    )  # fmt: skip
    if not files:
        raise ValueError(
            f"{folder} holds no files of bursts ({', '.join(s for s in SUFFIXES if s)}); name the folder that does"
        )
    return files


def _sources(path: Path, options: dict[str, Any], about: dict[str, Any]) -> list[StationSource]:
    name = format_of(path, options)
    places = burst_format(name).places(path)
    if burst_format(name).own_fields:
        if about:
            raise ValueError(
                f"{path} has places of its own for {', '.join(about)}; state them in the file, or leave them out"
            )
        return [StationSource(path, i, place, name) for i, place in enumerate(places)]
    x, y, z = (about.get(key, value) for key, value in zip("xyz", places[0], strict=True))
    return [StationSource(path, None, (x, y, z), name, options, about)]


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
            f"{without.name} states no position (x, y, z), {known[0].name} does; stations are placed all or none"
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
            where = ", ".join(f"{1e3 * value:.4g}" for value, _ in both)  # type: ignore[operator]
            raise ValueError(
                f"{names[i]} and {names[j]} have the same position, ({where}) mm; take one away, "
                "or put repeated measurements into folders of their own"
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
