"""Bursts of one station or many, one file: HDF5 that is valid netCDF-4 (docs/ldv.md).

The bursts of all stations follow one another along ``burst`` and ``burst_count`` says how many
each has: the contiguous ragged array of the CF conventions.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.io.axes import read_fluid, write_fluid
from torchliner.io.burst_csv import write_burst_csv
from torchliner.io.hdf5 import (
    get_dataset,
    open_file,
    place,
    read_references,
    read_scalars,
    read_si,
    text_attribute,
    to_json,
    write_dimension,
    write_references,
    write_scalars,
    write_variable,
    written_whole,
)
from torchliner.io.plane_file import SCALARS as PLANE_SCALARS
from torchliner.records import BurstRecord

SCHEMA = "torchliner bursts 1"
# field of the record -> name in the file, quantity, unit
ARRAYS = {
    "arrival_time": ("arrival_time", "time", "s"),
    "transit_time": ("transit_time", "time", "s"),
    "wall_normal": ("wall_normal_velocity", "velocity", "m/s"),
    "streamwise": ("streamwise_velocity", "velocity", "m/s"),
}
PLACES = ("x", "y", "z")
SCALARS = {name: kind for name, kind in PLANE_SCALARS.items() if name != "height"}
TEXTS = ("source_side", "liner")
SHARED = (*SCALARS, *TEXTS, "fluid", "reference")  # one value for the whole file
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
            raise ValueError(
                f"{path}: a .csv holds one station, not {len(records)}; write .h5 instead"
            )
        write_burst_csv(records[0], path)
        return
    _require_one_case(records)
    with written_whole(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["Conventions"] = "CF-1.8"
        file.attrs["featureType"] = "timeSeries"
        file.attrs["schema"] = SCHEMA
        for key in TEXTS:
            file.attrs[key] = getattr(records[0], key)
        _write_stations(file, records)
        _write_arrays(file, records)
        write_scalars(file, records[0], SCALARS)
        write_fluid(file, records[0].fluid)
        write_references(file, records[0].reference)


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
    write_dimension(file, "station", np.arange(len(records)), "1")
    counts = np.array([record.bursts for record in records])
    write_variable(file, "burst_count", counts, "1", ("station",))
    file["burst_count"].attrs["sample_dimension"] = "burst"
    for key in PLACES:
        values = [getattr(record, key) for record in records]
        if any(value is not None for value in values):
            numbers = np.array([np.nan if value is None else value for value in values])
            write_variable(file, key, numbers, "m", ("station",))
    texts = {"station_name": [record.title or record.name for record in records]}
    texts |= {f"station_{k}": [to_json(getattr(r, k)) for r in records] for k in LISTS}
    for key, lines in texts.items():
        file.create_dataset(key, data=lines, dtype=h5py.string_dtype())
        file[key].dims[0].attach_scale(file["station"])


def _write_arrays(file: h5py.File, records: Sequence[BurstRecord]) -> None:
    total = sum(record.bursts for record in records)
    write_dimension(file, "burst", np.arange(total), "1")
    for field, (name, _, unit) in ARRAYS.items():
        parts = [getattr(record, field) for record in records]
        if any(part is not None for part in parts):
            values = [
                np.full(record.bursts, np.nan) if part is None else part.detach().cpu().numpy()
                for record, part in zip(records, parts, strict=True)
            ]
            write_variable(
                file, name, np.concatenate(values), unit, ("burst",),
                compression="gzip", compression_opts=4, shuffle=True,
            )  # fmt: skip
    if ARRAYS["wall_normal"][0] in file:
        file[ARRAYS["wall_normal"][0]].attrs["positive"] = "away from the liner"


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
        if ARRAYS["arrival_time"][0] not in file:
            get_dataset(file, ARRAYS["arrival_time"][0], path)  # says what is there instead
        for name, _, _ in ARRAYS.values():
            if name in file:
                _require_length(file, name, int(ends[-1]), path)
        common: dict[str, Any] = {
            **read_scalars(file, SCALARS, path),
            "source_side": text_attribute(file, "source_side") or "unknown",
            "liner": text_attribute(file, "liner") or "",
            "fluid": read_fluid(file, path),
            "reference": read_references(file, path),
        }
        texts = _texts(file, len(counts), path)
        records = []
        for i in range(len(counts)) if only is None else [only]:
            own: dict[str, Any] = {k: None if np.isnan(v[i]) else float(v[i])
                                   for k, v in places.items()}  # fmt: skip
            part = slice(int(ends[i] - counts[i]), int(ends[i]))
            own |= {field: _known(read_si(file, name, quantity, path, part))
                    for field, (name, quantity, _) in ARRAYS.items() if name in file}  # fmt: skip
            own |= {key: lines[i] for key, lines in texts.items()}
            records.append(BurstRecord(**own, **common, name=f"{path}, station {i}"))
    return records


def station_places(path: str | Path) -> list[tuple[float | None, float | None, float | None]]:
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
    schema = text_attribute(file, "schema")
    if schema != SCHEMA:
        raise ValueError(f"{path} holds no bursts: its schema is {schema!r}, not {SCHEMA!r}")
    counts = read_si(file, "burst_count", "number", path).astype(np.int64).reshape(-1)
    if len(counts) == 0 or (counts < 1).any():
        raise ValueError(f"{path}:/burst_count holds {counts.tolist()}; at least 1 a station")
    places = {}
    for key in PLACES:
        if key in file:
            _require_length(file, key, len(counts), path)
            places[key] = read_si(file, key, "length", path).reshape(-1)
    return np.cumsum(counts), places


def _require_length(file: h5py.File, name: str, count: int, path: Path) -> None:
    found = get_dataset(file, name, path).size
    if found != count:
        raise ValueError(f"{place(file, name, path)} has {found} values; /burst_count says {count}")


def _known(values: np.ndarray) -> np.ndarray | None:
    """A quantity that a station lacks is nan throughout."""
    return None if np.isnan(values).all() else values


def _texts(file: h5py.File, count: int, path: Path) -> dict[str, list[Any]]:
    """Title, dropped, provenance and notes of each station."""
    found: dict[str, list[Any]] = {}
    for key, empty in LISTS.items():
        lines = file[f"station_{key}"].asstr()[()] if f"station_{key}" in file else [""] * count
        try:
            values = [json.loads(line) if line else empty for line in lines]
        except json.JSONDecodeError as error:
            raise ValueError(f"{path}:/station_{key} is not JSON ({error}); repair it") from error
        found[key] = [tuple(v) for v in values] if key == "notes" else values
    if "station_name" in file:
        found["title"] = list(file["station_name"].asstr()[()])
    for key, values in found.items():
        if len(values) != count:
            raise ValueError(
                f"{path}: {len(values)} stations have a {key}, /burst_count says {count}"
            )
    return found
