"""What a format of bursts offers: the rows of ``names.BURST_FORMATS`` lead to objects of this."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchliner.file_checks import require_regular
from torchliner.names import BURST_FORMATS, resolve
from torchliner.records import BurstRecord
from torchliner.text_columns import read_lines

HEAD = 1 << 16  # bytes of a text file that hold all that stands before the bursts

Place = tuple[float | None, float | None, float | None]
Options = Mapping[str, Any]


@dataclass(frozen=True)
class BurstFormat:
    """How a file of bursts is recognised and read.

    Args:
        recognises: whether a file, read with these options, is of the format.
        places: (x, y, z), m, of its stations, None where unknown; bursts are not read.
        read: one station: path, its number, options, further fields of the record.
        own_fields: whether the file states all of them, so that none may be added.
        takes: options of ``list_stations`` that say how such a file is read.
    """

    recognises: Callable[[Path, Options], bool]
    places: Callable[[Path], list[Place]]
    read: Callable[[Path, int, Options, Options], BurstRecord]
    own_fields: bool = False
    takes: tuple[str, ...] = ()


def read_head(path: str | Path) -> list[str]:
    """Lines before the bursts, and some of them."""
    return read_lines(path, HEAD)


def burst_format(name: str) -> BurstFormat:
    """A row of ``names.BURST_FORMATS``."""
    found: BurstFormat = resolve(BURST_FORMATS[name])
    return found


def format_of(path: Path, options: Options) -> str:
    """Name of the first format that recognises a file.

    Raises:
        FileNotFoundError, OSError: no such file, a folder.
        ValueError: none does.
    """
    require_regular(path)
    for name in BURST_FORMATS:
        if burst_format(name).recognises(path, options):
            return name
    raise ValueError(
        f"{path} begins with {read_head(path)[0].strip()[:40]!r}: neither 'DXEX v3' or 'DXEX v5' "
        "nor a header with 'arrival_time [ms]'. If it is columns without a header, state them, "
        "e.g. --columns 'row, arrival_time [ms], transit_time [us], streamwise [m/s], "
        "wall_normal [m/s]'"
    )
