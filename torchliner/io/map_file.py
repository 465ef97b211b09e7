"""Impedance maps as netCDF-4 and as CSV. Complex values are stored as two real variables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.io.axes import read_coordinate, write_coordinates
from torchliner.io.csv_rows import Rows, parts_of, rows_of, write_rows
from torchliner.io.hdf5 import open_file, read_references, write_index, write_references
from torchliner.io.point_file import read_alongside, write_alongside
from torchliner.io.result_file import (
    Sizes,
    read_closure,
    read_uncertainty,
    result_kind,
    write_closure,
    write_uncertainty,
)
from torchliner.io.tables import (
    cartesian,
    impedance,
    numbers,
    read_variables,
    real,
    write_variables,
)
from torchliner.records import ImpedanceMap

KIND = result_kind("torchliner map 1", "impedance map")
# "probes" stands for the dimensions of the probes: (z, x), (probe,) or none.
FULL, CELL, LINER = ("probes", "frequency"), ("cell", "frequency"), ("frequency",)
SPREAD = "standard deviation of {part} over the probes: spread over positions, no uncertainty"
ANSWER = "{part} of the whole liner in the order of averaging that was chosen"
FREQUENCY = (real("frequency", "Hz", LINER),)
CELLS = (real("cell_x", "m", ("cell",)), real("cell_z", "m", ("cell",)))
FIELDS = (
    impedance("impedance", "", FULL, derived=True),
    cartesian("reflection", "reflection", FULL),
    cartesian("admittance", "admittance", FULL, derived=True),
    cartesian("velocity_amplitude", "velocity_amplitude", FULL, unit="m/s"),
    impedance("cell_impedance", "cell_", CELL, derived=True),
    cartesian("cell_reflection", "cell_reflection", CELL),
    impedance("cell_impedance_velocity_first", "cell_velocity_first_", CELL, derived=True),
    cartesian("cell_reflection_velocity_first", "cell_velocity_first_reflection", CELL),
    impedance("liner_impedance", "liner_", LINER, derived=True),
    impedance("liner_impedance_velocity_first", "liner_velocity_first_", LINER, derived=True),
    impedance("impedance_coherent_first", "coherent_first_", FULL, derived=True, optional=True),
    cartesian("reflection_coherent_first", "coherent_first_reflection", FULL, optional=True),
    impedance("cell_impedance_coherent_first", "cell_coherent_first_", CELL, derived=True,
              optional=True),
    cartesian("cell_reflection_coherent_first", "cell_coherent_first_reflection", CELL,
              optional=True),
    impedance("liner_impedance_coherent_first", "liner_coherent_first_", LINER, derived=True,
              optional=True),
    cartesian("liner_reflection_coherent_first", "liner_coherent_first_reflection", LINER,
              optional=True),
    impedance("answer", "answer_", LINER, derived=True, attributes={"long_name": ANSWER}),
    impedance("liner_spread", "liner_spread_", LINER, derived=True,
              attributes={"long_name": SPREAD}),
)  # fmt: skip
FURTHER = (
    impedance("goodrich", "goodrich_", LINER, optional=True),
    real("absorption", "1", FULL, derived=True),
    real("coherence", "1", FULL),
    real("inferred_incident_level", "dB", FULL, derived=True),
    real("phase_rule_used", "1", FULL, field="phase_rule", flag=True),
    real("wall", "1", FULL, flag=True, optional=True),
    real("cell_weight", "1", ("cell",), optional=True),
    real("mean_velocity", "m/s", ("probes",)),
    real("velocity_rms", "m/s", ("probes",)),
    *numbers({"height": "m", "mach": "1", "incident_level": "dB"}),
)


def write_map(result: ImpedanceMap, path: str | Path) -> None:
    """Write a map to ``path``: netCDF-4, or CSV (one row a probe and frequency) for .csv.

    The old file, if any, is replaced only when the new one is whole.
    """
    if Path(path).suffix.lower() == ".csv":
        write_rows(_rows(result), path, ".9g")
        return
    with KIND.created(path, result) as file:
        write_variables(file, result, FREQUENCY)
        shape = tuple(result.mean_velocity.shape)
        dims = write_coordinates(file, shape, result.x, result.z, line=False)
        write_index(file, "cell", len(result.cell_x))
        write_variables(file, result, CELLS)
        write_variables(file, result, FIELDS, {"probes": dims}, attributes_last=True)
        write_variables(file, result, FURTHER, {"probes": dims})
        write_references(file, result.reference)
        if result.uncertainty is not None:
            write_uncertainty(file, result.uncertainty, dims)
        if result.closure is not None:
            write_closure(file, result.closure)
        write_alongside(file, result.alongside)


def read_map(path: str | Path) -> ImpedanceMap:
    """Read a map written by ``ImpedanceMap.write`` as netCDF-4.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: not a map of this schema.
    """
    path = Path(path)
    with open_file(path) as file:
        KIND.require(file, path)
        sizes: Sizes = {}
        fields = read_variables(file, FREQUENCY + CELLS + FIELDS + FURTHER, path, sizes=sizes)
        shape = tuple(fields["mean_velocity"].shape)
        sizes["along"] = shape[-1:]
        for key in ("x", "z"):
            values = read_coordinate(file, key, shape, path)
            fields[key] = None if values is None else torch.from_numpy(values)
        return ImpedanceMap(
            **fields,
            **KIND.read_head(file, path),
            reference=read_references(file, path),
            uncertainty=read_uncertainty(file, path, sizes=sizes),
            alongside=read_alongside(file, path),
            closure=read_closure(file, path, sizes),
        )


def _rows(result: ImpedanceMap) -> Rows:
    """One row a probe and frequency."""
    shape, probes = tuple(result.mean_velocity.shape), result.mean_velocity.numel()
    x, z = result.x, result.z
    if len(shape) == 2:
        x = None if x is None else x.repeat(shape[0])
        z = None if z is None else z.repeat_interleave(shape[1])

    def flat(values: Tensor) -> Tensor:
        return values.reshape(probes, -1)

    columns: dict[str, Any] = {
        "x (m)": torch.nan if x is None else flat(x),
        "z (m)": torch.nan if z is None else flat(z),
        "frequency (Hz)": result.frequency,
        **parts_of(flat(result.impedance), "resistance (rho c)", "reactance (rho c)"),
        **parts_of(flat(result.admittance), "conductance (1/rho c)", "susceptance (1/rho c)"),
        "absorption": flat(result.absorption),
        "coherence": flat(result.coherence),
        "inferred incident level (dB)": flat(result.inferred_incident_level),
    }
    if result.uncertainty is not None:
        for name in ("low", "high", "standard error"):
            bound = flat(getattr(result.uncertainty.probes, name.replace(" ", "_")))
            columns |= parts_of(bound, f"resistance {name} (rho c)", f"reactance {name} (rho c)")
    columns |= {"mean velocity (m/s)": flat(result.mean_velocity),
                "velocity rms (m/s)": flat(result.velocity_rms)}  # fmt: skip
    return rows_of(columns, (probes, len(result.frequency)))
