"""What files of results share: a heading, and statistical intervals of impedances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from torchliner.fluid import Fluid
from torchliner.io.hdf5 import is_there, read_json, to_json
from torchliner.io.tables import FileKind, Table, impedance, read_variables, real, write_variables
from torchliner.records import Interval, Uncertainty

Sizes = dict[str, tuple[int, ...]]  # of dimensions by name
HEADING: dict[str, Any] = {
    "title": "", "source_side": "unknown", "choices": {}, "notes": (), "fluid": Fluid(),
}  # fmt: skip
BOUNDS = {
    "low": "lower bound",
    "high": "upper bound",
    "standard_error": "standard error",
    "bias": "bias (taken off the bounds, not off the value)",
}


def result_kind(schema: str, noun: str, **attributes: Any) -> FileKind:
    """A kind of file with title, side of the source, choices, notes and gas among attributes."""
    return FileKind(schema, noun, {**HEADING, **attributes}, others=(".csv",))


def interval_table(stem: str, dims: tuple[str, ...]) -> Table:
    """Variables ``<stem>resistance_low`` and so on, of one ``Interval`` over ``dims``."""
    return (
        *(impedance(bound, f"{stem}{{}}_{bound}", dims,
                    attributes={"long_name": f"{text} of {{part}}; {{words}}"})
          for bound, text in BOUNDS.items()),
        real(f"{stem}interval_runs", "1", dims, field="runs"),
    )  # fmt: skip


def read_interval(
    file: h5py.File, table: Table, path: str | Path, sizes: Sizes | None = None
) -> Interval | None:
    """What is there of an ``interval_table``; None if nothing is."""
    if not is_there(file, table[0].names[0], path):
        return None
    return Interval(**read_variables(file, table, path, sizes=sizes))


# Intervals of a map; "probes" are the dimensions of its probes, "along" the last of them.
UNCERTAINTY = {
    "probes": interval_table("", ("probes", "frequency")),
    "along_x": interval_table("along_x_", ("along", "frequency")),
    "cells": interval_table("cell_", ("cell", "frequency")),
    "cells_velocity_first": interval_table("cell_velocity_first_", ("cell", "frequency")),
    "liner": interval_table("liner_", ("frequency",)),
    "liner_velocity_first": interval_table("liner_velocity_first_", ("frequency",)),
    "cells_coherent_first": interval_table("cell_coherent_first_", ("cell", "frequency")),
    "liner_coherent_first": interval_table("liner_coherent_first_", ("frequency",)),
}


def write_uncertainty(file: h5py.File, found: Uncertainty, dims: tuple[str, ...]) -> None:
    """Into an open map file whose probes have the dimensions ``dims``."""
    file.attrs["uncertainty"] = to_json(dict(found.settings))
    level = 100 * float(found.settings["level"])
    words = f"{level:g} %, statistical (moving blocks over time), not the spread over positions"
    axes = {"probes": dims, "along": dims[-1:]}
    for name, table in UNCERTAINTY.items():
        if getattr(found, name) is not None:
            write_variables(file, getattr(found, name), table, axes, words)


def read_uncertainty(
    file: h5py.File, path: str | Path, sizes: Sizes | None = None
) -> Uncertainty | None:
    """What ``write_uncertainty`` wrote; None if there is none."""
    if "uncertainty" not in file.attrs:
        return None
    found = {name: read_interval(file, table, path, sizes) for name, table in UNCERTAINTY.items()}
    settings = read_json(file, "uncertainty", path, {})
    return Uncertainty(**{n: v for n, v in found.items() if v is not None}, settings=settings)
