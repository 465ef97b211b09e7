"""Statistical intervals inside a map file: two bounds, a standard error, the number of runs."""

from __future__ import annotations

from pathlib import Path

import h5py

from torchliner.io.hdf5 import read_json, to_json, write_variable
from torchliner.io.result_file import Variables
from torchliner.records import Interval, Uncertainty

# Name of a field in the record: stem of its variables. Dimensions are those of the values.
STEMS = {
    "probes": "",
    "along_x": "along_x_",
    "cells": "cell_",
    "cells_velocity_first": "cell_velocity_first_",
    "liner": "liner_",
    "liner_velocity_first": "liner_velocity_first_",
}
BOUNDS = {
    "low": "lower bound",
    "high": "upper bound",
    "standard_error": "standard error",
    "bias": "bias (taken off the bounds, not off the value)",
}


def write_uncertainty(file: h5py.File, found: Uncertainty, dims: tuple[str, ...]) -> None:
    """Into an open map file.

    Args:
        file: with its dimensions.
        found: intervals.
        dims: names of the probe axes.
    """
    file.attrs["uncertainty"] = to_json(dict(found.settings))
    level = 100 * float(found.settings["level"])
    axes: dict[str, tuple[str, ...]] = {"probes": dims, "along_x": dims[-1:]}
    for name, stem in STEMS.items():
        interval = getattr(found, name)
        if interval is None:
            continue
        cells = ("cell",) if name.startswith("cells") else ()
        where = (*axes.get(name, cells), "frequency")
        words = f"{level:g} %, statistical (moving blocks over time), not the spread over positions"
        write_interval(file, interval, stem, where, words)


def write_interval(
    file: h5py.File, interval: Interval, stem: str, where: tuple[str, ...], words: str
) -> None:
    """One interval as variables ``<stem>resistance_low`` and so on.

    Args:
        file: with its dimensions.
        interval: values on the dimensions ``where``.
        stem: before each name.
        where: dimensions.
        words: what kind of interval it is, for the long names.
    """
    for bound, said in BOUNDS.items():
        values = getattr(interval, bound).detach().cpu()
        for part, numbers in (("resistance", values.real), ("reactance", values.imag)):
            key = f"{stem}{part}_{bound}"
            variable = write_variable(file, key, numbers.numpy(), "1", where)
            variable.attrs["long_name"] = f"{said} of {part}; {words}"
    runs = interval.runs.detach().cpu().numpy()
    write_variable(file, f"{stem}interval_runs", runs, "1", where)


def read_uncertainty(file: h5py.File, path: str | Path) -> Uncertainty | None:
    """What ``write_uncertainty`` wrote; None if there is none."""
    if "uncertainty" not in file.attrs:
        return None

    found = {name: read_interval(file, stem, path) for name, stem in STEMS.items()}
    settings = read_json(file, "uncertainty", path, {})
    return Uncertainty(**{n: v for n, v in found.items() if v is not None}, settings=settings)


def read_interval(file: h5py.File, stem: str, path: str | Path) -> Interval | None:
    """What ``write_interval`` wrote; None if there is none."""
    if f"{stem}resistance_low" not in file:
        return None

    variables = Variables(file, path)
    low, high, error, bias = (
        variables.both(stem, (f"resistance_{bound}", f"reactance_{bound}")) for bound in BOUNDS
    )
    return Interval(low, high, error, variables.real(f"{stem}interval_runs"), bias)
