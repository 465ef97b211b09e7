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
