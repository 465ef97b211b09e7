"""Impedance maps as netCDF-4 and as CSV. Complex values are stored as two real variables."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from torch import Tensor

from torchliner.io.hdf5 import (
    open_file,
    read_scalars,
    require_schema,
    text_attribute,
    write_dimension,
    write_references,
    write_scalars,
    write_variable,
    written_whole,
)
from torchliner.io.point_file import read_alongside, write_alongside
from torchliner.io.result_file import (
    CARTESIAN,
    IMPEDANCE,
    Variables,
    plain,
    read_heading,
    read_uncertainty,
    write_heading,
    write_pair,
    write_uncertainty,
)
from torchliner.records import ImpedanceMap

SCHEMA = "torchliner map 1"
SCALARS = {
    "height": ("length", "m"),
    "mach": ("number", "1"),
    "incident_level": ("level", "dB"),
}


def write_map(result: ImpedanceMap, path: str | Path) -> None:
    """Write a map to ``path``: netCDF-4, or CSV (one row a probe and frequency) for .csv.

    The old file, if any, is replaced only when the new one is whole.
    """
    if Path(path).suffix.lower() == ".csv":
        _write_csv(result, path)
        return
    with written_whole(path) as temporary, h5py.File(temporary, "w") as file:
        write_heading(file, result, SCHEMA)
        write_dimension(file, "frequency", plain(result.frequency), "Hz")
        dims = _write_axes(file, result)
        _write_fields(file, result, dims)
        write_scalars(file, result, SCALARS)
        write_references(file, result.reference)
        if result.uncertainty is not None:
            write_uncertainty(file, result.uncertainty, dims)
        write_alongside(file, result.alongside)


def _write_axes(file: h5py.File, result: ImpedanceMap) -> tuple[str, ...]:
    shape = tuple(result.mean_velocity.shape)
    names = {0: (), 1: ("probe",), 2: ("z", "x")}[len(shape)]
    for axis, name in enumerate(names):
        values = getattr(result, name, None) if len(shape) == 2 else None
        if values is None:
            write_dimension(file, name, np.arange(shape[axis]), "1")
        else:
            write_dimension(file, name, plain(values), "m")
    if len(shape) < 2:
        for name in ("x", "z"):
            if getattr(result, name) is not None:
                write_variable(file, name, plain(getattr(result, name)), "m", names)
    write_dimension(file, "cell", np.arange(len(result.cell_x)), "1")
    for name in ("cell_x", "cell_z"):
        write_variable(file, name, plain(getattr(result, name)), "m", ("cell",))
    return names


def _write_fields(file: h5py.File, result: ImpedanceMap, dims: tuple[str, ...]) -> None:
    full, cell, liner = (*dims, "frequency"), ("cell", "frequency"), ("frequency",)
    write_pair(file, "", result.impedance, full, IMPEDANCE)
    write_pair(file, "reflection", result.reflection, full, CARTESIAN)
    write_pair(file, "admittance", result.admittance, full, CARTESIAN)
    amplitude = result.velocity_amplitude
    write_pair(file, "velocity_amplitude", amplitude, full, CARTESIAN, unit="m/s")
    write_pair(file, "cell_", result.cell_impedance, cell, IMPEDANCE)
    write_pair(file, "cell_reflection", result.cell_reflection, cell, CARTESIAN)
    first = "cell_velocity_first_"
    write_pair(file, first, result.cell_impedance_velocity_first, cell, IMPEDANCE)
    reflected = result.cell_reflection_velocity_first
    write_pair(file, first + "reflection", reflected, cell, CARTESIAN)
    write_pair(file, "liner_", result.liner_impedance, liner, IMPEDANCE)
    alternative = result.liner_impedance_velocity_first
    write_pair(file, "liner_velocity_first_", alternative, liner, IMPEDANCE)
    write_pair(file, "liner_spread_", result.liner_spread, liner, IMPEDANCE)
    for part in IMPEDANCE:
        file[f"liner_spread_{part}"].attrs["long_name"] = (
            f"standard deviation of {part} over the probes: spread over positions, no uncertainty"
        )
    if result.goodrich is not None:
        write_pair(file, "goodrich_", result.goodrich, liner, IMPEDANCE)
    write_variable(file, "absorption", plain(result.absorption), "1", full)
    write_variable(file, "coherence", plain(result.coherence), "1", full)
    level = plain(result.inferred_incident_level)
    write_variable(file, "inferred_incident_level", level, "dB", full)
    write_variable(file, "phase_rule_used", plain(result.phase_rule), "1", full)
    if result.wall is not None:
        write_variable(file, "wall", plain(result.wall), "1", full)
    write_variable(file, "mean_velocity", plain(result.mean_velocity), "m/s", dims)
    write_variable(file, "velocity_rms", plain(result.velocity_rms), "m/s", dims)


def read_map(path: str | Path) -> ImpedanceMap:
    """Read a map written by ``ImpedanceMap.write`` as netCDF-4.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: not a map of this schema.
    """
    path = Path(path)
    with open_file(path) as file:
        require_schema(file, SCHEMA, "impedance map", path)
        variables = Variables(file, path)
        real, both = variables.real, variables.both

        def coordinate(key: str) -> Tensor | None:
            known = key in file and text_attribute(file[key], "units") == "m"
            return real(key) if known else None

        return ImpedanceMap(
            frequency=real("frequency"),
            reflection=both("reflection", CARTESIAN),
            mean_velocity=real("mean_velocity"),
            velocity_rms=real("velocity_rms"),
            velocity_amplitude=both("velocity_amplitude", CARTESIAN),
            coherence=real("coherence"),
            phase_rule=real("phase_rule_used").to(torch.bool),
            cell_x=real("cell_x"),
            cell_z=real("cell_z"),
            cell_reflection=both("cell_reflection", CARTESIAN),
            cell_reflection_velocity_first=both("cell_velocity_first_reflection", CARTESIAN),
            x=coordinate("x"),
            z=coordinate("z"),
            goodrich=both("goodrich_") if "goodrich_resistance" in file else None,
            uncertainty=read_uncertainty(file, path),
            wall=real("wall").to(torch.bool) if "wall" in file else None,
            alongside=read_alongside(file, path),
            **read_heading(file, path),
            **read_scalars(file, SCALARS, path),
        )


CSV_COLUMNS = (
    "x (m)", "z (m)", "frequency (Hz)", "resistance (rho c)", "reactance (rho c)",
    "conductance (1/rho c)", "susceptance (1/rho c)", "absorption", "coherence",
    "inferred incident level (dB)", "mean velocity (m/s)", "velocity rms (m/s)",
)  # fmt: skip


def _write_csv(result: ImpedanceMap, path: str | Path) -> None:
    probes = result.mean_velocity.numel()
    x, z = _flat_coordinates(result)
    columns: list[Any] = [
        value.detach().cpu().reshape(probes, -1)
        for value in (
            result.resistance, result.reactance, result.admittance.real, result.admittance.imag,
            result.absorption, result.coherence, result.inferred_incident_level,
        )
    ]  # fmt: skip
    heads = list(CSV_COLUMNS)
    if result.uncertainty is not None:
        bounds = result.uncertainty.probes
        ends = {"low": bounds.low, "high": bounds.high, "standard error": bounds.standard_error}
        for name, value in ends.items():
            for part, numbers in (("resistance", value.real), ("reactance", value.imag)):
                heads.insert(-2, f"{part} {name} (rho c)")
                columns.append(numbers.detach().cpu().reshape(probes, -1))
    mean, rms = result.mean_velocity.reshape(-1), result.velocity_rms.reshape(-1)
    with written_whole(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        for p in range(probes):
            for f, frequency in enumerate(result.frequency.tolist()):
                values = [float(column[p, f]) for column in columns]
                row = [x[p], z[p], frequency, *values, float(mean[p]), float(rms[p])]
                writer.writerow([f"{number:.9g}" for number in row])


def _flat_coordinates(result: ImpedanceMap) -> tuple[list[float], list[float]]:
    shape = tuple(result.mean_velocity.shape)
    unknown = torch.full((result.mean_velocity.numel(),), torch.nan)
    x = unknown if result.x is None else result.x
    z = unknown if result.z is None else result.z
    if len(shape) == 2:
        x = x.repeat(shape[0]) if result.x is not None else x
        z = z.repeat_interleave(shape[1]) if result.z is not None else z
    return x.tolist(), z.tolist()
