"""Impedance maps as netCDF-4 and as CSV. Complex values are stored as two real variables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import torch
from torch import Tensor

from torchliner.io.axes import read_coordinate, write_coordinates
from torchliner.io.csv_rows import Rows, parts_of, rows_of
from torchliner.io.hdf5 import (
    get_group,
    is_there,
    open_file,
    read_references,
    text_attribute,
    write_index,
    write_references,
)
from torchliner.io.holes import stored_holes, write_holes
from torchliner.io.point_file import read_alongside, write_alongside
from torchliner.io.result_file import (
    Sizes,
    read_closure,
    read_uncertainty,
    result_kind,
    write_closure,
    write_uncertainty,
)
from torchliner.io.result_writers import ResultFile
from torchliner.io.tables import (
    cartesian,
    described,
    impedance,
    numbers,
    read_variables,
    real,
    write_variables,
)
from torchliner.records import ImpedanceMap
from torchliner.records.impedance_map import ENDS

KIND = result_kind("torchliner map 2", "impedance map", older=("torchliner map 1",))
AMPLITUDES, INTERVALS, CLOSURE = "amplitudes", "intervals", "closure"  # groups
# "probes" stands for the dimensions of the probes: (z, x), (probe,) or none.
FULL, CELL, LINER = ("probes", "frequency"), ("cell", "frequency"), ("frequency",)
FIRST = {
    "": "from the admittance averaged over probes", "_velocity_first": "velocity averaged first",
    "_coherent_first": "coherent velocity of the cell first",
}  # fmt: skip
TEXTS = {
    "frequency": "frequency of the tone",
    "cell_x": "streamwise coordinate of the centre of a cell",
    "cell_z": "spanwise coordinate of the centre of a cell",
    "impedance": "normalised {part} at each probe",
    "impedance_coherent_first": f"normalised {{part}} at each probe, {FIRST['_coherent_first']}",
    **{f"{place}_impedance{end}": f"normalised {{part}} of {words}, {text}"
       for place, words in (("cell", "each cell"), ("liner", "the whole liner"))
       for end, text in FIRST.items()},
    "answer": "normalised {part} of the whole liner in the order of averaging that was chosen",
    "liner_spread": "standard deviation of {part} over the probes: spread over positions, "
                    "no uncertainty",
    "goodrich": "normalised {part} of the liner without sound under the flow, by Goodrich",
    **{f"{place}reflection{end}": f"{{part}} part of the reflection coefficient {words}, {text}"
       for place, words in (("", "at each probe"), ("cell_", "of each cell"),
                            ("liner_", "of the whole liner"))
       for end, text in FIRST.items()},
    "reflection": "{part} part of the reflection coefficient at each probe",
    "admittance": "{part} part of the normalised admittance at each probe",
    "velocity_amplitude": "{part} part of the peak amplitude of the velocity into the liner",
    "absorption": "absorption coefficient",
    "coherence": "squared coherence of the velocity with the tone",
    "inferred_incident_level": "level of the incident wave that gives the coherent velocity, "
                               "re 20 uPa rms",
    "phase_rule": "1 where the phase rule was used, 0 where it fell back to averaged",
    "wall": "1 where a probe counts as wall in averages over probes",
    "cell_weight": "share of its probes that a cell has",
    "mean_velocity": "time mean of the velocity away from the liner",
    "velocity_rms": "rms of the velocity about its mean",
    "height": "distance of the plane from the liner",
    "mach": "bulk Mach number",
    "incident_level": "stated level of the incident wave, re 20 uPa rms",
}  # fmt: skip
FREQUENCY = described((real("frequency", "Hz", LINER),), TEXTS)
CELLS = described((real("cell_x", "m", ("cell",)), real("cell_z", "m", ("cell",))), TEXTS)
FIELDS = described((
    impedance("impedance", "", FULL, derived=True),
    impedance("cell_impedance", "cell_", CELL, derived=True),
    impedance("cell_impedance_velocity_first", "cell_velocity_first_", CELL, derived=True),
    impedance("liner_impedance", "liner_", LINER, derived=True),
    impedance("liner_impedance_velocity_first", "liner_velocity_first_", LINER, derived=True),
    impedance("impedance_coherent_first", "coherent_first_", FULL, derived=True, optional=True),
    impedance("cell_impedance_coherent_first", "cell_coherent_first_", CELL, derived=True,
              optional=True),
    impedance("liner_impedance_coherent_first", "liner_coherent_first_", LINER, derived=True,
              optional=True),
    impedance("answer", "answer_", LINER, derived=True),
    impedance("liner_spread", "liner_spread_", LINER, derived=True),
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
), TEXTS)  # fmt: skip
COMPLEX = described((
    cartesian("reflection", "reflection", FULL),
    cartesian("admittance", "admittance", FULL, derived=True),
    cartesian("velocity_amplitude", "velocity_amplitude", FULL, unit="m/s"),
    cartesian("cell_reflection", "cell_reflection", CELL),
    cartesian("cell_reflection_velocity_first", "cell_velocity_first_reflection", CELL),
    cartesian("reflection_coherent_first", "coherent_first_reflection", FULL, optional=True),
    cartesian("cell_reflection_coherent_first", "cell_coherent_first_reflection", CELL,
              optional=True),
    cartesian("liner_reflection_coherent_first", "liner_coherent_first_reflection", LINER,
              optional=True),
), TEXTS)  # fmt: skip


def write_map(result: ImpedanceMap, path: str | Path) -> None:
    """Write a map by the ending of ``path``, as ``ImpedanceMap.write``."""
    FILE.write(result, path)


def _fill(file: h5py.File, result: ImpedanceMap) -> None:
    """What one looks at first in the file itself, the rest in groups with the same coordinates."""

    def within(name: str) -> tuple[h5py.Group, tuple[str, ...]]:
        group = file.create_group(name) if name else file
        write_variables(group, result, FREQUENCY)
        shape = tuple(result.mean_velocity.shape)
        dims = write_coordinates(group, shape, result.x, result.z, line=False)
        write_index(group, "cell", len(result.cell_x))
        write_variables(group, result, CELLS)
        return group, dims

    group, dims = within("")
    write_variables(group, result, FIELDS, {"probes": dims})
    write_references(file, result.reference)
    write_holes(file, result.holes)
    group, dims = within(AMPLITUDES)
    write_variables(group, result, COMPLEX, {"probes": dims})
    if result.uncertainty is not None:
        group, dims = within(INTERVALS)
        write_uncertainty(group, result.uncertainty, dims)
    if result.closure is not None:
        write_closure(within(CLOSURE)[0], result.closure)
    write_alongside(file, result.alongside)


def read_map(path: str | Path) -> ImpedanceMap:
    """Read a map written by ``ImpedanceMap.write`` as netCDF-4, of this version or an older one.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: not a map of this schema.
    """
    path = Path(path)
    with open_file(path) as file:
        KIND.require(file, path)
        if text_attribute(file, "schema") == KIND.schema and not is_there(file, AMPLITUDES, path):
            raise ValueError(
                f"{path} lacks the group {AMPLITUDES!r} of a map, as what xarray writes of one "
                "does; read the file that ImpedanceMap.write or educe --output wrote"
            )

        def part(name: str) -> h5py.Group:
            """Files of schema 1 have no groups: all their variables are in the file itself."""
            return get_group(file, name, path) if is_there(file, name, path) else file

        sizes: Sizes = {}
        fields = read_variables(file, FREQUENCY + CELLS + FIELDS, path, sizes=sizes)
        fields |= read_variables(part(AMPLITUDES), COMPLEX, path, sizes=sizes)
        shape = tuple(fields["mean_velocity"].shape)
        sizes["along"] = shape[-1:]
        for key in ("x", "z"):
            values = read_coordinate(file, key, shape, path)
            fields[key] = None if values is None else torch.from_numpy(values)
        return ImpedanceMap(
            **fields,
            **KIND.read_head(file, path),
            reference=read_references(file, path),
            uncertainty=read_uncertainty(part(INTERVALS), path, sizes=sizes),
            alongside=read_alongside(file, path),
            closure=read_closure(part(CLOSURE), path, sizes),
            holes=stored_holes(file, path),
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


def _cell_rows(result: ImpedanceMap) -> Rows:
    """One row a cell and frequency, in all orders of averaging."""
    columns: dict[str, Any] = {
        "x (m)": result.cell_x[:, None], "z (m)": result.cell_z[:, None],
        "frequency (Hz)": result.frequency,
    }  # fmt: skip
    for order in result.orders:
        columns |= parts_of(result.of_cells(order), f"resistance, {order}", f"reactance, {order}")
        if result.uncertainty is not None:
            found = getattr(result.uncertainty, f"cells{ENDS[order]}")
            for end in ("low", "high"):
                columns |= parts_of(getattr(found, end), f"resistance, {order}, {end}",
                                    f"reactance, {order}, {end}")  # fmt: skip
    return rows_of(columns, (len(result.cell_x), len(result.frequency)))


FILE = ResultFile(KIND, _fill, {"probes": _rows, "cells": _cell_rows}, {"number": ".9g"})
