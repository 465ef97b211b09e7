"""Bursts of one station or many, one file: HDF5 that is valid netCDF-4 (docs/ldv.md).

The bursts of all stations follow one another along ``burst`` and ``burst_count`` says how many
each has: the contiguous ragged array of the CF conventions.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np

from torchliner.io.axes import read_case
from torchliner.io.burst_csv import write_burst_csv
from torchliner.io.burst_format import BurstFormat, Place
from torchliner.io.fields import fill
from torchliner.io.hdf5 import get_dataset, is_there, open_file, parse_json, place, to_json
from torchliner.io.tables import FileKind, plain, read_variables, write_variables
from torchliner.records import BurstRecord
from torchliner.records.burst_record import UNITS
from torchliner.records.declared import Variable, table_of, variables_of

KIND = FileKind(
    "torchliner bursts 1",
    "file of bursts",
    {"source_side": "unknown", "liner": ""},
    {"Conventions": "CF-1.8", "featureType": "timeSeries"},
    (".csv",),
)
ARRAYS = table_of(BurstRecord, *UNITS)
NUMBERS = tuple(row for row in variables_of(BurstRecord) if not row.dims)
PLACES = ("x", "y", "z")
LISTS: dict[str, Any] = {"dropped": {}, "provenance": {}, "notes": []}  # per station, as JSON
OF_STATION = (*UNITS, *PLACES, *LISTS, "title", "name")
SHARED = [name for name in BurstRecord.__dataclass_fields__ if name not in OF_STATION]  # one value for the whole file
STATIONS = (
    Variable("burst_count", dims=("station",), attributes={"sample_dimension": "burst"}),
    *(Variable(axis, "m", ("station",), optional=True) for axis in PLACES),
    *(Variable(f"station_{name}", dims=("station",), kind="text", optional=True) for name in ("name", *LISTS)),
)


def write_bursts(records: BurstRecord | Sequence[BurstRecord], path: str | Path) -> None:
    """Write stations to one file; the old one, if any, is replaced only when the new is whole.

    Args:
        records: one station or several; they share fluid, tone, levels, liner and references.
        path: .h5 or .nc; .csv for a single station.
    Raises:
        ValueError: no station, stations of different cases, several stations for a .csv.
    """
    if isinstance(records, BurstRecord):
        records = [records]
    if not records:
        raise ValueError(f"{path}: no station to write")
    if Path(path).suffix.lower() == ".csv":
        if len(records) > 1:
            raise ValueError(f"{path}: a .csv holds one station, not {len(records)}; write .h5 instead")
        write_burst_csv(records[0], path)
        return
    _require_one_case(records)
    with KIND.created(path, records[0]) as file:
        write_variables(file, _stations(records), STATIONS)
        write_variables(file, _joined(records), ARRAYS, compression="gzip", compression_opts=4, shuffle=True)
        fill(file, records[0], unsaid=OF_STATION)


def _require_one_case(records: Sequence[BurstRecord]) -> None:
    for record in records[1:]:
        for label in SHARED:
            mine, first = getattr(record, label), getattr(records[0], label)
            if mine != first:
                raise ValueError(
                    f"{record.name} has {label} {mine}, {records[0].name} {first}; the stations of "
                    "one file share it: write two files"
                )


def _stations(records: Sequence[BurstRecord]) -> SimpleNamespace:
    """What each station has: its number of bursts, place, title and lists."""
    found = SimpleNamespace(
        burst_count=[record.bursts for record in records],
        station_name=[record.title or record.name for record in records],
        **{f"station_{key}": [to_json(getattr(record, key)) for record in records] for key in LISTS},
    )
    for key in PLACES:
        values = [getattr(record, key) for record in records]
        known = np.array([np.nan if value is None else value for value in values])
        setattr(found, key, None if all(value is None for value in values) else known)
    return found


def _joined(records: Sequence[BurstRecord]) -> SimpleNamespace:
    """The bursts of all stations, nan where a station lacks what another has."""
    joined = SimpleNamespace()
    for key in UNITS:
        parts = [getattr(record, key) for record in records]
        filled = [
            np.full(record.bursts, np.nan) if part is None else plain(part)
            for record, part in zip(records, parts, strict=True)
        ]
        setattr(joined, key, None if all(part is None for part in parts) else np.concatenate(filled))
    return joined


def read_burst_file(path: str | Path, only: int | None = None) -> list[BurstRecord]:
    """Stations of a file written by ``write_bursts`` or by anyone who follows the schema.

    Args:
        path: the file.
        only: number of the one station that is read, from 0; None for all.
    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: another schema, a dataset missing, of a wrong length or without units; the
            message names FILE:/dataset.
    """
    path = Path(path)
    with open_file(path) as file:
        counts, about = _layout(file, path)
        ends, common = np.cumsum(counts), read_case(file, KIND, NUMBERS, path)
        for row in ARRAYS:
            if not row.optional or is_there(file, row.names[0], path):
                found = get_dataset(file, row.names[0], path).size
                if found != ends[-1]:
                    raise ValueError(
                        f"{place(file, row.names[0], path)} has {found} values; /burst_count says {ends[-1]}"
                    )
        records = []
        for i in range(len(counts)) if only is None else [only]:
            # A quantity that a station lacks is nan throughout.
            own = read_variables(file, ARRAYS, path, slice(int(ends[i] - counts[i]), int(ends[i])))
            own = {key: None if bool(v.isnan().all()) else v for key, v in own.items()}
            records.append(BurstRecord(**own, **about[i], **common, name=f"{path}, station {i}"))
    return records


def station_places(path: str | Path) -> list[Place]:
    """(x, y, z) of each station of a file, m; None where unknown. Bursts are not read.

    Raises:
        As ``read_burst_file``.
    """
    with open_file(path) as file:
        return [(each["x"], each["y"], each["z"]) for each in _layout(file, Path(path))[1]]


def _layout(file: h5py.File, path: Path) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """How many bursts each station has, and what is said of it."""
    KIND.require(file, path)
    found = read_variables(file, STATIONS, path)
    counts = found["burst_count"].numpy()
    if not (len(counts) and (np.isfinite(counts) & (counts >= 1) & (counts % 1 == 0)).all()):
        raise ValueError(f"{path}:/burst_count holds {counts.tolist()}; whole numbers, at least 1 a station")
    about: list[dict[str, Any]] = []
    for i in range(len(counts)):
        places = {key: float(found[key][i]) if key in found else np.nan for key in PLACES}
        own: dict[str, Any] = {key: None if np.isnan(value) else value for key, value in places.items()}
        for key, empty in LISTS.items():
            text, label = found.get(f"station_{key}", [""] * len(counts))[i], f"{path}:/station_{key}"
            own[key] = parse_json(text, label) if text else empty
            if type(own[key]) is not type(empty):
                raise ValueError(f"{label} holds other JSON than {type(empty).__name__}s; repair it")
        about.append(own | {"notes": tuple(own["notes"]), "title": found.get("station_name", [""] * len(counts))[i]})
    return counts.astype(np.int64), about


FORMAT = BurstFormat(
    recognises=lambda path, _: bool(h5py.is_hdf5(path)),
    places=station_places,
    read=lambda path, number, *_: read_burst_file(path, number)[0],
    own_fields=True,
)
FILE = SimpleNamespace(write=write_bursts)
