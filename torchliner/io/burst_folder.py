"""Bursts from a file of any known layout, or from a folder of stations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py

from torchliner.io.burst_columns import read_burst_columns
from torchliner.io.burst_csv import is_burst_csv, read_burst_csv
from torchliner.io.burst_file import read_burst_file
from torchliner.io.burst_text import read_lines
from torchliner.io.dantec import is_dantec, read_dantec
from torchliner.records import BurstRecord

SUFFIXES = (".txt", ".csv", ".dat", ".asc", ".tsv", ".h5", ".nc", "")
SAME_PLACE = 1e-7  # m: traverses are set to micrometres


def read_bursts(
    path: str | Path,
    columns: str | Sequence[str] | None = None,
    separator: str = "blank",
    components: Sequence[str] | None = None,
    coincidence_window: float | None = None,
    **about: Any,
) -> list[BurstRecord]:
    """Stations of a file or folder, in the order of x, then y, z; by name without positions.

    Args:
        path: a file of our HDF5 or CSV, a DXEX export, columns without a header; or a folder of
            files of one station each.
        columns, separator: of files without a header, as in ``read_burst_columns``.
        components, coincidence_window: of DXEX files, as in ``read_dantec``.
        about: further fields of each record, e.g. ``frequency``; not for HDF5, which states its
            own.
    Raises:
        FileNotFoundError, OSError: no such file or folder, or it cannot be read.
        ValueError: a folder without files of bursts, two files with the same position, a file of
            no known layout or with faults.
    """
    path = Path(path)
    options = {"columns": columns, "separator": separator, "components": components,
               "coincidence_window": coincidence_window}  # fmt: skip
    if not path.is_dir():
        return sort_stations(_read_file(path, options, about))
    files = sorted(
        file for file in path.iterdir()
        if file.is_file() and not file.name.startswith(".") and file.suffix.lower() in SUFFIXES
    )  # fmt: skip
    if not files:
        raise ValueError(
            f"{path} holds no files of bursts ({', '.join(s for s in SUFFIXES if s)}); name the "
            "folder that does"
        )
    return sort_stations([record for file in files for record in _read_file(file, options, about)])


def _read_file(path: Path, options: dict[str, Any], about: dict[str, Any]) -> list[BurstRecord]:
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    if h5py.is_hdf5(path):
        if about:
            raise ValueError(
                f"{path} states its own {', '.join(about)}; change them there, or leave them out"
            )
        return read_burst_file(path)
    if is_dantec(path):
        chosen = {key: options[key] for key in ("components", "coincidence_window")}
        return [read_dantec(path, **chosen, **about)]
    lines = read_lines(path)
    if is_burst_csv(lines):
        return [read_burst_csv(path, **about)]
    if options["columns"] is not None:
        return [read_burst_columns(path, options["columns"], options["separator"], **about)]
    raise ValueError(
        f"{path} begins with {lines[0].strip()[:40]!r}: neither 'DXEX v3' or 'DXEX v5' nor a "
        "header with 'arrival_time [ms]'. If it is columns without a header, state them, e.g. "
        "--columns 'row, arrival_time [ms], transit_time [us], streamwise [m/s], wall_normal [m/s]'"
    )


def sort_stations(records: Sequence[BurstRecord]) -> list[BurstRecord]:
    """In the order of x, y, z where all are known, else as they come.

    Raises:
        ValueError: two have the same position; some state one, others none.
    """
    known = [record for record in records if record.position is not None]
    if not known:
        return list(records)
    if len(known) < len(records):
        without = next(record for record in records if record.position is None)
        raise ValueError(
            f"{without.name} states no position (x, y, z), {known[0].name} does; stations are "
            "placed all or none"
        )
    ordered = sorted(records, key=lambda record: record.position or ())
    for first, second in pairwise(ordered):
        a, b = first.position, second.position
        assert a is not None
        assert b is not None
        if max(abs(u - v) for u, v in zip(a, b, strict=True)) <= SAME_PLACE:
            said = ", ".join(f"{1e3 * value:.4g}" for value in a)
            raise ValueError(
                f"{first.name} and {second.name} have the same position, ({said}) mm; take one "
                "away, or put repeated measurements into folders of their own"
            )
    return ordered
