"""What files of results share: a heading, tensors as variables, complex ones as two."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.io.hdf5 import (
    get_dataset,
    read_json,
    read_references,
    text_attribute,
    to_json,
    write_variable,
)
from torchliner.records import Interval, Uncertainty

IMPEDANCE = ("resistance", "reactance")
CARTESIAN = ("_real", "_imaginary")


def plain(value: Tensor) -> np.ndarray:
    """A tensor as an array; netCDF has no booleans, they become 0 and 1."""
    values = value.detach().cpu().numpy()
    return values.astype(np.int8) if values.dtype == np.bool_ else values


def write_heading(file: h5py.File, record: Any, schema: str) -> None:
    """Attributes that every result has: schema, title, side of the source, choices, notes, gas."""
    file.attrs["Conventions"] = "CF-1.8"
    file.attrs["schema"] = schema
    file.attrs["title"], file.attrs["source_side"] = record.title, record.source_side
    file.attrs["choices"] = to_json(dict(record.choices))
    file.attrs["notes"] = to_json(list(record.notes))
    file.attrs["fluid"] = to_json(dataclasses.asdict(record.fluid))


def read_heading(file: h5py.File, path: str | Path) -> dict[str, Any]:
    """Fields of a record that ``write_heading`` and ``write_references`` wrote."""
    return {
        "title": text_attribute(file, "title") or "",
        "source_side": text_attribute(file, "source_side") or "unknown",
        "choices": read_json(file, "choices", path, {}),
        "notes": tuple(read_json(file, "notes", path, [])),
        "fluid": Fluid(**read_json(file, "fluid", path, {})),
        "reference": read_references(file, path),
    }


def write_pair(
    file: h5py.Group, stem: str, value: Tensor, dims: tuple[str, ...], parts: tuple[str, str],
    words: str = "", unit: str = "1",
) -> None:  # fmt: skip
    """A complex tensor as the variables ``<stem><part>``, with a long name if there are words."""
    for part, numbers in zip(parts, (value.real, value.imag), strict=True):
        variable = write_variable(file, stem + part, plain(numbers), unit, dims)
        if words:
            variable.attrs["long_name"] = words


@dataclasses.dataclass(frozen=True)
class Variables:
    """Those of an open file, or of a group of one, as tensors."""

    group: h5py.Group
    path: str | Path

    def real(self, key: str) -> Tensor:
        """One.

        Raises:
            ValueError: it is missing.
        """
        return torch.from_numpy(np.asarray(get_dataset(self.group, key, self.path)[()]))

    def both(self, stem: str, parts: tuple[str, str] = IMPEDANCE) -> Tensor:
        """A complex one from its two parts."""
        return torch.complex(self.real(stem + parts[0]), self.real(stem + parts[1]))


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
