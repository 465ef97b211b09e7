"""What our HDF5 files share: opening, datasets in SI units, JSON, reference impedances."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.units import SI_QUANTITY, si_factor

CHUNK_CACHE = 64 << 20  # bytes; the default of 1 MiB decompresses every tile many times


def open_file(path: str | Path) -> h5py.File:
    """An HDF5 file for reading; a solver may still hold it, so it is not locked.

    Raises:
        FileNotFoundError: no such file.
        OSError: a directory, not HDF5, or truncated.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    if path.is_dir():
        raise OSError(f"{path} is a folder, not a file")
    try:
        try:
            return h5py.File(path, "r", locking=False, rdcc_nbytes=CHUNK_CACHE)
        except OSError as error:
            if "locking" not in str(error):
                raise
            # The same process holds it open with locking; HDF5 wants the flags to agree.
            return h5py.File(path, "r", rdcc_nbytes=CHUNK_CACHE)
    except OSError as error:
        kind = "is truncated" if "truncated" in str(error) else "is not an HDF5 (netCDF-4) file"
        if isinstance(error, PermissionError):
            kind = "cannot be read"
        raise OSError(f"{path} {kind}: {error}") from error


def get_dataset(group: h5py.Group, key: str, path: str | Path) -> h5py.Dataset:
    """A dataset by name.

    Raises:
        ValueError: it is missing; what is there is listed.
    """
    if key not in group or not isinstance(group[key], h5py.Dataset):
        there = ", ".join(sorted(group)) or "nothing"
        where = "the file" if group.name == "/" else "the group"
        raise ValueError(f"{place(group, key, path)} is missing; {where} holds: {there}")
    return group[key]


def place(group: h5py.Group, key: str, path: str | Path) -> str:
    """FILE:/group/dataset, for messages."""
    return f"{path}:{group.name.rstrip('/')}/{key}"


def text_attribute(dataset: Any, key: str) -> str | None:
    """A string attribute or None."""
    value = dataset.attrs.get(key)
    if value is None:
        return None
    return value.decode() if isinstance(value, bytes) else str(value)


def factor_to(unit: str, group: h5py.Group, key: str, path: str | Path) -> float:
    """Factor from the units of a dataset to an SI unit of the same quantity.

    Raises:
        ValueError: the dataset is missing, or has no unit of this quantity.
    """
    dataset = get_dataset(group, key, path)
    return si_factor(SI_QUANTITY[unit], text_attribute(dataset, "units"), place(group, key, path))


def read_si(
    group: h5py.Group, key: str, unit: str, path: str | Path, part: slice | None = None
) -> np.ndarray:
    """A dataset in an SI unit, or a part of it along its first axis; real numbers as stored.

    float64 where the file has another unit than ``unit``.

    Raises:
        ValueError: it is missing, has no unit of this quantity, or holds no real numbers.
    """
    factor = factor_to(unit, group, key, path)
    dataset = group[key]
    if dataset.dtype.kind not in "fiu":
        raise ValueError(f"{place(group, key, path)} is {dataset.dtype}; numbers are needed")
    values = np.asarray(dataset[() if part is None else part])
    return values if factor == 1 else values.astype(np.float64) * factor


def read_number(group: h5py.Group, key: str, unit: str, path: str | Path) -> float:
    """One number in an SI unit; an array of one counts."""
    values = read_si(group, key, unit, path)
    if values.size != 1:
        raise ValueError(
            f"{place(group, key, path)} has shape {values.shape}; one number is needed"
        )
    return float(values.reshape(()))


def write_variable(
    group: h5py.Group, name: str, values: Any, units: str, dims: Sequence[str] = (), **storage: Any
) -> h5py.Dataset:
    """A netCDF-4 variable: data, units, and its dimension scales, which must exist.

    A variable whose dimension bears its own name is that dimension's scale.
    """
    dataset = group.create_dataset(name, data=values, **storage)
    if name in dims:
        dataset.make_scale(name)
    dataset.attrs["units"] = units
    attach_scales(dataset, group, dims)
    return dataset


def attach_scales(dataset: h5py.Dataset, group: h5py.Group, dims: Sequence[str]) -> None:
    """Name the axes of a dataset by dimension scales of its group."""
    for axis, dim in enumerate(dims):
        if group[dim] != dataset:
            dataset.dims[axis].attach_scale(group[dim])


def write_index(group: h5py.Group, name: str, count: int) -> None:
    """A dimension without coordinates: 0, 1, ..."""
    write_variable(group, name, np.arange(count), "1", (name,))


def write_texts(group: h5py.Group, name: str, texts: Sequence[str], dim: str) -> None:
    """A list of texts along a dimension."""
    attach_scales(
        group.create_dataset(name, data=list(texts), dtype=h5py.string_dtype()), group, (dim,)
    )


def tiles(shape: Sequence[int], rows: int, columns: int = 64) -> dict[str, Any]:
    """Storage of a compressed variable: gzip in tiles of at most ``rows`` along the first axis."""
    chunks = tuple(min(n, columns if axis else rows) for axis, n in enumerate(shape))
    return {"compression": "gzip", "compression_opts": 9, "shuffle": True, "chunks": chunks}


def to_json(value: Any) -> str:
    """JSON text; arrays and tensors become lists, what JSON does not know becomes text."""
    return json.dumps(
        value, default=lambda item: item.tolist() if hasattr(item, "tolist") else str(item)
    )


def read_json(file: h5py.Group, key: str, path: str | Path, default: Any) -> Any:
    """A JSON attribute, or ``default`` if there is none."""
    text = text_attribute(file, key)
    try:
        return json.loads(text) if text else default
    except json.JSONDecodeError as error:
        raise ValueError(
            f"{path}: attribute {key!r} is not JSON ({error}); repair or remove it"
        ) from error


def write_references(file: h5py.File, reference: Mapping[str, complex]) -> None:
    """Impedances by name, each as two scalars whose attribute ``label`` holds the name."""
    for number, (label, value) in enumerate(reference.items()):
        stem = "reference_" + re.sub(r"\W+", "_", label)
        if f"{stem}_resistance" in file:
            stem = f"{stem}_{number}"
        parts = {"resistance": complex(value).real, "reactance": complex(value).imag}
        for part, amount in parts.items():
            write_variable(file, f"{stem}_{part}", amount, "1").attrs["label"] = label


def read_references(file: h5py.File, path: str | Path) -> dict[str, complex]:
    """What ``write_references`` wrote."""
    found = {}
    for key in file:
        if key.startswith("reference_") and key.endswith("_resistance"):
            stem = key.removesuffix("resistance")
            label = text_attribute(file[key], "label") or stem[10:-1].replace("_", " ")
            parts = (read_number(file, stem + part, "1", path)
                     for part in ("resistance", "reactance"))  # fmt: skip
            found[label] = complex(*parts)
    return found
