"""Point impedances as netCDF-4, as CSV, and as groups of a map file."""

from __future__ import annotations

from pathlib import Path

import h5py
import torch

from torchliner.io.csv_rows import Rows, parts_of, rows_of, write_rows
from torchliner.io.hdf5 import get_group, is_there, open_file, write_index
from torchliner.io.result_file import Sizes, interval_table, read_uncertainty, write_uncertainty
from torchliner.io.tables import FileKind, impedance, read_variables, real, write_variables
from torchliner.records import PointImpedances, PointUncertainty

KIND = FileKind(
    "torchliner points 1", "set of point impedances",
    {"name": "points", "choices": {}, "notes": ()}, others=(".csv",),
)  # fmt: skip
GROUP = "alongside_"  # of a map file
FREQUENCY = (real("frequency", "Hz", ("frequency",)),)
CELL, POINT = ("cell", "frequency"), ("point", "frequency")
TABLE = (
    *(real(f"{place}_{axis}", "m", (place,)) for place in ("cell", "point") for axis in "xz"),
    impedance("cell_impedance", "cell_", CELL),
    impedance("cell_impedance_pressure_first", "cell_{}_pressure_first", CELL),
    impedance("liner_impedance", "liner_", ("frequency",)),
    impedance("liner_impedance_pressure_first", "liner_{}_pressure_first", ("frequency",)),
    impedance("point_impedance", "point_", POINT),
    real("coherence", "1", CELL),
)
UNCERTAINTY = {
    name: interval_table(name.replace("cells", "cell") + "_", dims)
    for name, dims in (
        ("cells", CELL), ("cells_pressure_first", CELL),
        ("liner", ("frequency",)), ("liner_pressure_first", ("frequency",)),
    )
}  # fmt: skip


def write_points(result: PointImpedances, path: str | Path) -> None:
    """Write netCDF-4, or CSV (one row a point, cell or liner, and frequency) for .csv.

    The old file, if any, is replaced only when the new one is whole.
    """
    if Path(path).suffix.lower() == ".csv":
        write_rows(_rows(result), path, ".9g")
        return
    with KIND.created(path, result) as file:
        _write_variables(file, result)


def _write_variables(group: h5py.Group, result: PointImpedances) -> None:
    write_variables(group, result, FREQUENCY)
    for name in ("cell", "point"):
        write_index(group, name, len(getattr(result, f"{name}_x")))
    write_variables(group, result, TABLE)
    if result.uncertainty is not None:
        write_uncertainty(group, result.uncertainty, tables=UNCERTAINTY)


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
    known = read_uncertainty(group, path, sizes, PointUncertainty, UNCERTAINTY)
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
