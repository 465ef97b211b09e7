"""Impedance maps as netCDF-4 and as CSV: the fields of ``ImpedanceMap`` name the variables.

Cells and the whole liner have a dimension ``averaging``. Probes are known in two averagings alone, so that these have
names of their own: ``resistance`` as measured, ``phase_locked_resistance``.
"""

from __future__ import annotations

from pathlib import Path

import torch

from torchliner.io.axes import read_coordinate
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


def _axes(result: ImpedanceMap) -> dict[str, tuple[str, ...]]:
    return probe_axes(tuple(result.mean_velocity.shape))


FILE = OwnFile(
    "torchliner map 1",
    "impedance map",
    record=ImpedanceMap,
    axes=_axes,
    others=RESULT_ENDINGS,
    places={"probes": ("probes",), "cells": ("cell",)},
    csv={"number": ".9g"},
)
write_map = FILE.write
