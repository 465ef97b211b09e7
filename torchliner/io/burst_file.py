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

from torchliner.io.axes import read_case, write_case
from torchliner.io.burst_csv import write_burst_csv
from torchliner.io.burst_format import BurstFormat, Place
from torchliner.io.hdf5 import (
    get_dataset,
    is_there,
    open_file,
    parse_json,
    place,
    read_si,
    read_texts,
    to_json,
    write_index,
    write_texts,
    write_variable,
)
from torchliner.io.plane_file import UNITS as PLANE_UNITS
from torchliner.io.tables import FileKind, numbers, plain, read_variables, real, write_variables
from torchliner.records import BurstRecord

KIND = FileKind(
    "torchliner bursts 1", "file of bursts", {"source_side": "unknown", "liner": ""},
    (("Conventions", "CF-1.8"), ("featureType", "timeSeries")),
    others=(".csv",),
)  # fmt: skip
ARRAYS = (
    real("arrival_time", "s", ("burst",), optional=True),
    real("transit_time", "s", ("burst",), optional=True),
    real("wall_normal_velocity", "m/s", ("burst",), field="wall_normal", optional=True,
         attributes={"positive": "away from the liner"}),
    real("streamwise_velocity", "m/s", ("burst",), field="streamwise", optional=True),
)  # fmt: skip
PLACES = ("x", "y", "z")
UNITS = {name: unit for name, unit in PLANE_UNITS.items() if name != "height"}
NUMBERS = numbers(UNITS)
SHARED = (*UNITS, *KIND.attributes, "fluid", "reference")  # one value for the whole file
LISTS: dict[str, Any] = {"dropped": {}, "provenance": {}, "notes": []}  # per station, as JSON


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
        _write_stations(file, records)
        _write_arrays(file, records)
        write_case(file, records[0], NUMBERS)


def _require_one_case(records: Sequence[BurstRecord]) -> None:
    for record in records[1:]:
        for label in SHARED:
            mine, first = getattr(record, label), getattr(records[0], label)
            if mine != first:
                raise ValueError(
                    f"{record.name} has {label} {mine}, {records[0].name} {first}; the stations of "
                    "one file share it: write two files"
                )


def _write_stations(file: h5py.File, records: Sequence[BurstRecord]) -> None:
    write_index(file, "station", len(records))
    counts = np.array([record.bursts for record in records])
    write_variable(file, "burst_count", counts, "1", ("station",))
    file["burst_count"].attrs["sample_dimension"] = "burst"
    for key in PLACES:
        values = [getattr(record, key) for record in records]
        if any(value is not None for value in values):
            known = np.array([np.nan if value is None else value for value in values])
            write_variable(file, key, known, "m", ("station",))
    write_texts(file, "station_name", [each.title or each.name for each in records], "station")
    for key in LISTS:
        texts = [to_json(getattr(record, key)) for record in records]
        write_texts(file, f"station_{key}", texts, "station")


def _write_arrays(file: h5py.File, records: Sequence[BurstRecord]) -> None:
    """The bursts of all stations, nan where a station lacks what another has."""
    write_index(file, "burst", sum(record.bursts for record in records))
    joined = SimpleNamespace()
    for row in ARRAYS:
        parts = [getattr(record, row.field) for record in records]
        filled = [np.full(record.bursts, np.nan) if part is None else plain(part)
                  for record, part in zip(records, parts, strict=True)]  # fmt: skip
        there = any(part is not None for part in parts)
        setattr(joined, row.field, np.concatenate(filled) if there else None)
    storage: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    write_variables(file, joined, ARRAYS, **storage)


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
        ends, places = _layout(file, path)
        counts = np.diff(ends, prepend=0)
        get_dataset(file, "arrival_time", path)
        for row in ARRAYS:
            if is_there(file, row.names[0], path):
                _require_length(file, row.names[0], int(ends[-1]), path)
        common = read_case(file, KIND, NUMBERS, path)
        texts = _texts(file, len(counts), path)
        records = []
        for i in range(len(counts)) if only is None else [only]:
            part = slice(int(ends[i] - counts[i]), int(ends[i]))
            # A quantity that a station lacks is nan throughout.
            own = read_variables(file, ARRAYS, path, part)
            own = {key: None if bool(v.isnan().all()) else v for key, v in own.items()}
            own |= {k: None if np.isnan(v[i]) else float(v[i]) for k, v in places.items()}
            own |= {key: lines[i] for key, lines in texts.items()}
            records.append(BurstRecord(**own, **common, name=f"{path}, station {i}"))
    return records


def station_places(path: str | Path) -> list[Place]:
    """(x, y, z) of each station of a file, m; None where unknown. Bursts are not read.

    Raises:
        As ``read_burst_file``.
    """
    path = Path(path)
    with open_file(path) as file:
        ends, places = _layout(file, path)
    columns = [places.get(key, np.full(len(ends), np.nan)) for key in PLACES]
    known = [[None if np.isnan(v) else float(v) for v in row] for row in zip(*columns, strict=True)]
    return [(x, y, z) for x, y, z in known]


def _layout(file: h5py.File, path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Where the bursts of each station end, and the stations' coordinates that are stated."""
    KIND.require(file, path)
    stated = read_si(file, "burst_count", "1", path).reshape(-1)
    if len(stated) == 0 or not (np.isfinite(stated) & (stated >= 1) & (stated % 1 == 0)).all():
        raise ValueError(f"{path}:/burst_count holds {stated.tolist()}; whole numbers, at least 1 a station")
    counts = stated.astype(np.int64)
    places = {}
    for key in PLACES:
        if is_there(file, key, path):
            _require_length(file, key, len(counts), path)
            places[key] = read_si(file, key, "m", path).reshape(-1)
    return np.cumsum(counts), places


def _require_length(file: h5py.File, name: str, count: int, path: Path) -> None:
    found = get_dataset(file, name, path).size
    if found != count:
        raise ValueError(f"{place(file, name, path)} has {found} values; /burst_count says {count}")


def _texts(file: h5py.File, count: int, path: Path) -> dict[str, list[Any]]:
    """Title, dropped, provenance and notes of each station."""
    found: dict[str, list[Any]] = {}
    for key, empty in LISTS.items():
        there = is_there(file, f"station_{key}", path)
        lines = read_texts(file, f"station_{key}", path) if there else [""] * count
        label = f"{path}:/station_{key}"
        values = [parse_json(line, label) if line else empty for line in lines]
        if any(type(value) is not type(empty) for value in values):
            raise ValueError(f"{label} holds other JSON than {type(empty).__name__}s; repair it")
        found[key] = [tuple(v) for v in values] if key == "notes" else values
    if is_there(file, "station_name", path):
        found["title"] = read_texts(file, "station_name", path)
    for key, values in found.items():
        if len(values) != count:
            raise ValueError(f"{path}: {len(values)} stations have a {key}, /burst_count says {count}")
    return found


FORMAT = BurstFormat(
    recognises=lambda path, _: bool(h5py.is_hdf5(path)),
    places=station_places,
    read=lambda path, number, *_: read_burst_file(path, number)[0],
    own_fields=True,
)
