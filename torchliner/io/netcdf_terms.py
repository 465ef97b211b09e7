"""Files that are like netCDF put into the terms of HDF5, so that one reader serves them all.

What a reader asks of a file before it reads velocity (names, dimensions, attributes, coordinates)
is copied into an HDF5 file in memory; large variables have their shape there and no values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from torchliner.io.axes import NO_VARIABLE

MOST = 1 << 20  # values of a variable of several dimensions that are copied


@dataclass(frozen=True)
class NamedArray:
    """A variable: dimensions, attributes, and its values when they are asked for."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    attributes: Mapping[str, Any]
    values: Callable[[], np.ndarray]


@contextmanager
def in_terms_of_hdf5(variables: Mapping[str, NamedArray], attributes: Mapping[str, Any]) -> Iterator[h5py.File]:
    """An HDF5 file in memory with what is said of the variables, and the values of small ones."""
    with h5py.File.in_memory() as file:
        for name, each in variables.items():
            _copy(file, name, each)
        scales = {dim: _scale(file, dim, n) for each in variables.values()
                  for dim, n in zip(each.dims, each.shape, strict=True)}  # fmt: skip
        for name, each in variables.items():
            for axis, dim in enumerate(each.dims if name in file else ()):
                if scales[dim].name != f"/{name}":
                    file[name].dims[axis].attach_scale(scales[dim])
        _say(file, attributes)
        yield file


def _scale(file: h5py.File, dim: str, size: int) -> h5py.Dataset:
    """The variable named as its dimension, or a scale that has no values."""
    own = file.get(dim)
    if own is not None and own.shape == (size,):
        if not own.is_scale:
            own.make_scale(dim)
        return own
    key = dim if own is None else f"{dim} (dimension)"
    if key not in file:
        file.create_dataset(key, (size,), "i4", chunks=(max(1, size),)).make_scale(NO_VARIABLE)
    return file[key]


def _copy(file: h5py.File, name: str, each: NamedArray) -> None:
    """One variable; times as numbers with a unit."""
    kind, unit = each.dtype, None
    if kind.kind in "mM":
        kind, unit = np.dtype("i8"), "ns" if kind.kind == "m" else "ns since 1970-01-01"
    if kind.kind not in "fiu":
        return
    if len(each.shape) < 2 or int(np.prod(each.shape)) <= MOST:
        values = each.values()
        if unit is not None:
            values = values.astype(f"{each.dtype.kind}8[ns]").astype("i8")
        file.create_dataset(name, data=values.astype(kind.newbyteorder("=")))
    else:
        file.create_dataset(name, each.shape, kind.newbyteorder("="), chunks=True)
    _say(file[name], each.attributes)
    if unit is not None:
        file[name].attrs["units"] = unit


def _say(owner: Any, attributes: Mapping[str, Any]) -> None:
    for key, value in attributes.items():
        text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
        with suppress(TypeError, ValueError, OSError):  # what HDF5 has no type for says nothing
            owner.attrs[key] = text
