"""Point impedances as netCDF-4, as CSV, and as groups of a map file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import torch

from torchliner.io.csv_rows import Rows, parts_of, rows_of
from torchliner.io.hdf5 import get_group, is_there, open_file, read_json, to_json, write_index
from torchliner.io.result_file import OTHERS, interval_table, words_of_interval
from torchliner.io.result_writers import ResultFile
from torchliner.io.tables import (
    FileKind,
    Sizes,
    described,
    impedance,
    read_variables,
    real,
    write_variables,
)
from torchliner.records import Interval, PointImpedances, PointUncertainty

KIND = FileKind(
    "torchliner points 1", "set of point impedances",
    {"name": "points", "choices": {}, "notes": ()}, others=OTHERS,
)  # fmt: skip
GROUP = "alongside_"  # of a map file
TEXTS = {
    "frequency": "frequency of the tone",
    **{f"{place}_{axis}": f"{words} coordinate of each {place}" for place in ("cell", "point")
       for axis, words in (("x", "streamwise"), ("z", "spanwise"))},
    **{f"{place}_impedance{end}": f"normalised {{part}} of {words}, {text}"
       for place, words in (("cell", "each cell"), ("liner", "the whole surface"))
       for end, text in (("", "from the admittance averaged over points"),
                         ("_pressure_first", "pressure averaged first"))},
    "point_impedance": "normalised {part} at each point",
    "coherence": "squared coherence of the two pressures, mean over the points of a cell",
}  # fmt: skip
FREQUENCY = described((real("frequency", "Hz", ("frequency",)),), TEXTS)
CELL, POINT = ("cell", "frequency"), ("point", "frequency")
TABLE = described((
    *(real(f"{place}_{axis}", "m", (place,)) for place in ("cell", "point") for axis in "xz"),
    impedance("cell_impedance", "cell_", CELL),
    impedance("cell_impedance_pressure_first", "cell_{}_pressure_first", CELL),
    impedance("liner_impedance", "liner_", ("frequency",)),
    impedance("liner_impedance_pressure_first", "liner_{}_pressure_first", ("frequency",)),
    impedance("point_impedance", "point_", POINT),
    real("coherence", "1", CELL),
), TEXTS)  # fmt: skip
UNCERTAINTY = {
    name: interval_table(name.replace("cells", "cell") + "_", dims)
    for name, dims in (
        ("cells", CELL), ("cells_pressure_first", CELL),
        ("liner", ("frequency",)), ("liner_pressure_first", ("frequency",)),
    )
}  # fmt: skip


def write_points(result: PointImpedances, path: str | Path) -> None:
    """Write points by the ending of ``path``, as ``PointImpedances.write``."""
    FILE.write(result, path)


def _write_variables(group: h5py.Group, result: PointImpedances) -> None:
    write_variables(group, result, FREQUENCY)
    for name in ("cell", "point"):
        write_index(group, name, len(getattr(result, f"{name}_x")))
    write_variables(group, result, TABLE)
    if result.uncertainty is not None:
        settings = dict(result.uncertainty.settings)
        group.attrs["uncertainty"] = to_json(settings)
        words = words_of_interval(float(settings["level"]))
        for name, table in UNCERTAINTY.items():
            write_variables(group, getattr(result.uncertainty, name), table, words=words)


def read_points(path: str | Path) -> PointImpedances:
    """Read what ``PointImpedances.write`` wrote as netCDF-4.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: not of this schema, or a dataset is missing.
    """
    with open_file(path) as file:
        return _read_group(file, path)


def _read_group(group: h5py.Group, path: str | Path) -> PointImpedances:
    KIND.require(group, path)
    sizes: Sizes = {}
    fields = read_variables(group, FREQUENCY + TABLE, path, sizes=sizes)
    known = None
    if settings := read_json(group, "uncertainty", path, {}):
        found = {
            name: Interval(**read_variables(group, table, path, sizes=sizes)) for name, table in UNCERTAINTY.items()
        }
        known = PointUncertainty(**found, settings=settings)
    return PointImpedances(**KIND.read_head(group, path), **fields, uncertainty=known)


def write_alongside(file: h5py.File, results: tuple[PointImpedances, ...]) -> None:
    """The results of other methods as groups of a map file."""
    for i, result in enumerate(results):
        group = file.create_group(f"{GROUP}{i}")
        KIND.write_head(group, result)
        _write_variables(group, result)


def read_alongside(file: h5py.File, path: str | Path) -> tuple[PointImpedances, ...]:
    """What ``write_alongside`` wrote, in order; empty for a file without."""
    found: list[PointImpedances] = []
    while is_there(file, name := f"{GROUP}{len(found)}", path):
        found.append(_read_group(get_group(file, name, path), path))
    return tuple(found)


def _rows(result: PointImpedances) -> Rows:
    """One row a place and frequency: points, cells, and the liner."""
    nowhere, unknown = torch.full((1,), torch.nan), torch.full((1, 1), torch.nan)
    blocks = (
        ("point", result.point_x, result.point_z, result.point_impedance,
         torch.complex(unknown, unknown), unknown),
        ("cell", result.cell_x, result.cell_z, result.cell_impedance,
         result.cell_impedance_pressure_first, result.coherence),
        ("liner", nowhere, nowhere, result.liner_impedance[None],
         result.liner_impedance_pressure_first[None], result.coherence.mean(0, keepdim=True)),
    )  # fmt: skip
    rows: Rows = []
    for place, x, z, value, first, coherence in blocks:
        columns = {
            "place": place, "x (m)": x[:, None], "z (m)": z[:, None],
            "frequency (Hz)": result.frequency,
            **parts_of(value, "resistance (rho c)", "reactance (rho c)"),
            **parts_of(first, "resistance, pressure first", "reactance, pressure first"),
            "coherence": coherence,
        }  # fmt: skip
        for order in ("", "_pressure_first") if result.uncertainty is not None else ():
            name = {"cell": "cells"}.get(place, "liner") + order
            found = getattr(result.uncertainty, name)
            for end in ("low", "high"):
                words = f"{order.replace('_', ', ', 1).replace('_', ' ')}, statistical {end}"
                # Points have none.
                bound = getattr(found, end) if place != "point" else torch.complex(unknown, unknown)
                columns |= parts_of(bound, f"resistance{words}", f"reactance{words}")
        rows += rows_of(columns, (len(x), len(result.frequency)))
    return rows


def _rows_of(place: str) -> Callable[[PointImpedances], Rows]:
    return lambda result: [row for row in _rows(result) if row["place"] == place]


PLACES = {f"{place}s": _rows_of(place) for place in ("point", "cell", "liner")}
FILE = ResultFile(KIND, _write_variables, {"all": _rows, **PLACES}, {"number": ".9g"})
