"""Impedance maps as netCDF-4 and as CSV: the fields of ``ImpedanceMap`` name the variables.

Cells and the whole liner have a dimension ``averaging``. Probes are known in two averagings alone, so that these have
names of their own: ``resistance`` as measured, ``phase_locked_resistance``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.io.axes import read_coordinate
from torchliner.io.csv_rows import Rows, parts_of, rows_of
from torchliner.io.fields import probe_axes
from torchliner.io.hdf5 import get_dataset, open_file
from torchliner.io.own_file import RESULT_ENDINGS, OwnFile
from torchliner.records import ImpedanceMap


def read_map(path: str | Path) -> ImpedanceMap:
    """Read a map written by ``ImpedanceMap.write`` as netCDF-4; as ``read`` of ``OwnFile``."""
    path = Path(path)
    with open_file(path) as file:
        FILE.require(file, path)
        shape = get_dataset(file, "mean_velocity", path).shape
        places = {key: read_coordinate(file, key, shape, path) for key in "xz"}
        known = {key: None if values is None else torch.from_numpy(values) for key, values in places.items()}
        found: ImpedanceMap = FILE.taken(file, path, **known)
    return found


def _rows(result: ImpedanceMap) -> Rows:
    """One row a probe and frequency, as measured."""
    shape, probes = tuple(result.mean_velocity.shape), result.mean_velocity.numel()
    measured = result.probes["admittance"]
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
        **parts_of(flat(measured.impedance), "resistance (rho c)", "reactance (rho c)"),
        **parts_of(flat(measured.admittance), "conductance (1/rho c)", "susceptance (1/rho c)"),
        "absorption": flat(measured.absorption),
        "coherence": flat(result.coherence),
        "inferred incident level (dB)": flat(result.inferred_incident_level),
    }
    if measured.interval is not None:
        for name in ("low", "high", "standard error"):
            bound = flat(getattr(measured.interval, name.replace(" ", "_")))
            columns |= parts_of(bound, f"resistance {name} (rho c)", f"reactance {name} (rho c)")
    columns |= {"mean velocity (m/s)": flat(result.mean_velocity), "velocity rms (m/s)": flat(result.velocity_rms)}
    return rows_of(columns, (probes, len(result.frequency)))


def _cell_rows(result: ImpedanceMap) -> Rows:
    """One row a cell and frequency, in all averagings."""
    columns: dict[str, Any] = {
        "x (m)": result.cell_x[:, None],
        "z (m)": result.cell_z[:, None],
        "frequency (Hz)": result.frequency,
    }
    for name, educed in result.cells.items():
        columns |= parts_of(educed.impedance, f"resistance, {name}", f"reactance, {name}")
        if educed.interval is not None:
            for end in ("low", "high"):
                bound = getattr(educed.interval, end)
                columns |= parts_of(bound, f"resistance, {name}, {end}", f"reactance, {name}, {end}")
    return rows_of(columns, (len(result.cell_x), len(result.frequency)))


def _axes(result: ImpedanceMap) -> dict[str, tuple[str, ...]]:
    return probe_axes(tuple(result.mean_velocity.shape))


FILE = OwnFile(
    "torchliner map 1", "impedance map", record=ImpedanceMap, axes=_axes, others=RESULT_ENDINGS,
    rows={"probes": _rows, "cells": _cell_rows}, csv={"number": ".9g"},
)  # fmt: skip
write_map = FILE.write
