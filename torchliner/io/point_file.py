"""Point impedances as netCDF-4, as CSV, and as groups of a map file."""

from __future__ import annotations

import csv
from pathlib import Path

import h5py
import numpy as np
import torch

from torchliner.io.hdf5 import (
    open_file,
    read_json,
    require_schema,
    text_attribute,
    to_json,
    write_dimension,
    write_variable,
    written_whole,
)
from torchliner.io.result_file import IMPEDANCE, Variables, plain, write_pair
from torchliner.records import PointImpedances

SCHEMA = "torchliner points 1"
GROUP = "alongside_"  # of a map file
DIMENSIONS = {"cell": "cell_x", "point": "point_x"}
IMPEDANCES = {
    "cell_impedance": ("cell", "frequency"),
    "cell_impedance_pressure_first": ("cell", "frequency"),
    "liner_impedance": ("frequency",),
    "liner_impedance_pressure_first": ("frequency",),
    "point_impedance": ("point", "frequency"),
}
PLACES = ("cell_x", "cell_z", "point_x", "point_z")
CSV_COLUMNS = (
    "place", "x (m)", "z (m)", "frequency (Hz)", "resistance (rho c)", "reactance (rho c)",
    "resistance, pressure first", "reactance, pressure first", "coherence",
)  # fmt: skip


def write_points(result: PointImpedances, path: str | Path) -> None:
    """Write netCDF-4, or CSV (one row a point, cell or liner, and frequency) for .csv.

    The old file, if any, is replaced only when the new one is whole.
    """
    if Path(path).suffix.lower() == ".csv":
        _write_csv(result, path)
        return
    with written_whole(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["Conventions"] = "CF-1.8"
        write_points_group(file, result)


def write_points_group(group: h5py.Group, result: PointImpedances) -> None:
    """The record into a file, or into a group of one."""
    group.attrs["schema"] = SCHEMA
    group.attrs["name"] = result.name
    group.attrs["choices"] = to_json(dict(result.choices))
    group.attrs["notes"] = to_json(list(result.notes))
    write_dimension(group, "frequency", plain(result.frequency), "Hz")
    for name, counted in DIMENSIONS.items():
        write_dimension(group, name, np.arange(len(getattr(result, counted))), "1")
    for name in PLACES:
        write_variable(group, name, plain(getattr(result, name)), "m", (name.split("_")[0],))
    for name, dims in IMPEDANCES.items():
        write_pair(group, "", getattr(result, name), dims, _parts(name))
    write_variable(group, "coherence", plain(result.coherence), "1", ("cell", "frequency"))


def read_points(path: str | Path) -> PointImpedances:
    """Read what ``PointImpedances.write`` wrote as netCDF-4.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: not of this schema, or a dataset is missing.
    """
    with open_file(path) as file:
        return read_points_group(file, path)


def read_points_group(group: h5py.Group, path: str | Path) -> PointImpedances:
    """What ``write_points_group`` wrote."""
    require_schema(group, SCHEMA, "set of point impedances", path)
    variables = Variables(group, path)
    real = variables.real
    return PointImpedances(
        name=text_attribute(group, "name") or "points",
        frequency=real("frequency"),
        coherence=real("coherence"),
        **{name: real(name) for name in PLACES},
        **{name: variables.both("", _parts(name)) for name in IMPEDANCES},
        choices=read_json(group, "choices", path, {}),
        notes=tuple(read_json(group, "notes", path, [])),
    )


def _parts(name: str) -> tuple[str, str]:
    """Names of the variables of an impedance: cell_resistance and cell_reactance, ..."""
    return name.replace("impedance", IMPEDANCE[0]), name.replace("impedance", IMPEDANCE[1])


def write_alongside(file: h5py.File, results: tuple[PointImpedances, ...]) -> None:
    """The results of other methods as groups of a map file."""
    for i, result in enumerate(results):
        write_points_group(file.create_group(f"{GROUP}{i}"), result)


def read_alongside(file: h5py.File, path: str | Path) -> tuple[PointImpedances, ...]:
    """What ``write_alongside`` wrote, in order; empty for a file without."""
    found: list[PointImpedances] = []
    while f"{GROUP}{len(found)}" in file:
        found.append(read_points_group(file[f"{GROUP}{len(found)}"], path))
    return tuple(found)


def _write_csv(result: PointImpedances, path: str | Path) -> None:
    nowhere = torch.full((1,), torch.nan)
    unknown = torch.full((len(result.point_x), len(result.frequency)), torch.nan)
    blocks = (
        ("point", result.point_x, result.point_z, result.point_impedance,
         torch.complex(unknown, unknown), unknown),
        ("cell", result.cell_x, result.cell_z, result.cell_impedance,
         result.cell_impedance_pressure_first, result.coherence),
        ("liner", nowhere, nowhere, result.liner_impedance[None],
         result.liner_impedance_pressure_first[None], result.coherence.mean(0, keepdim=True)),
    )  # fmt: skip
    with written_whole(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(CSV_COLUMNS)
        for place, x, z, probes, first, coherence in blocks:
            for i in range(len(x)):
                for f, frequency in enumerate(result.frequency.tolist()):
                    one, two = complex(probes[i, f]), complex(first[i, f])
                    row = (x[i], z[i], frequency, one.real, one.imag, two.real, two.imag,
                           coherence[i, f])  # fmt: skip
                    writer.writerow([place, *(f"{float(number):.9g}" for number in row)])
