"""What our HDF5 files share: opening, units, dimension scales, atomic writing."""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.units import si_factor

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


def require_schema(group: h5py.Group, schema: str, what: str, path: str | Path) -> None:
    """Refuse a file, or a group of one, that holds something else.

    Raises:
        ValueError: it does.
    """
    found = text_attribute(group, "schema")
    if found != schema:
        where = f"{path}" if group.name == "/" else f"{path}:{group.name}"
        raise ValueError(f"{where} is no {what}: its schema is {found!r}, not {schema!r}")


def read_si(
    group: h5py.Group, key: str, quantity: str, path: str | Path, part: slice | None = None
) -> np.ndarray:
    """A small dataset, or a part of one along its only axis, in SI units, float64."""
    dataset = get_dataset(group, key, path)
    name = place(group, key, path)
    factor = si_factor(quantity, text_attribute(dataset, "units"), name)
    if dataset.dtype.kind not in "fiu":
        raise ValueError(f"{name} is {dataset.dtype}; numbers are needed")
    return np.asarray(dataset[() if part is None else part], dtype=np.float64) * factor


def read_number(group: h5py.Group, key: str, quantity: str, path: str | Path) -> float:
    """One number in SI units; an array of one counts."""
    values = read_si(group, key, quantity, path)
    if values.size != 1:
        raise ValueError(
            f"{place(group, key, path)} has shape {values.shape}; one number is needed"
        )
    return float(values.reshape(()))


Scalars = Mapping[str, tuple[str, str]]  # name in file and record: quantity, unit


def write_scalars(file: h5py.File, record: Any, scalars: Scalars) -> None:
    """Numbers of a record that are not None, as variables with units."""
    for key, (_, unit) in scalars.items():
        if getattr(record, key) is not None:
            write_variable(file, key, float(getattr(record, key)), unit)


def read_scalars(file: h5py.File, scalars: Scalars, path: str | Path) -> dict[str, Any]:
    """Those that the file states, in SI units."""
    return {k: read_number(file, k, q, path) for k, (q, _) in scalars.items() if k in file}


def to_json(value: Any) -> str:
    """JSON text; arrays and tensors become lists, what JSON does not know becomes text."""
    return json.dumps(
        value, default=lambda item: item.tolist() if hasattr(item, "tolist") else str(item)
    )


def read_json(file: h5py.File, key: str, path: str | Path, default: Any) -> Any:
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
        for part, amount in (
            ("resistance", complex(value).real),
            ("reactance", complex(value).imag),
        ):
            write_variable(file, f"{stem}_{part}", amount, "1").attrs["label"] = label


def read_references(file: h5py.File, path: str | Path) -> dict[str, complex]:
    """What ``write_references`` wrote."""
    found = {}
    for key in file:
        if key.startswith("reference_") and key.endswith("_resistance"):
            stem = key.removesuffix("resistance")
            label = text_attribute(file[key], "label") or stem[10:-1].replace("_", " ")
            found[label] = complex(
                read_number(file, key, "number", path),
                read_number(file, stem + "reactance", "number", path),
            )
    return found


@contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """A temporary path beside ``path``, renamed onto it when the block ends well.

    A crash or an interrupt leaves the old file as it was.

    Raises:
        OSError: the folder is missing or cannot be written to.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise OSError(f"{path}: the folder {path.parent} does not exist")
    if path.is_dir():
        raise OSError(f"{path} is a folder; name a file")
    try:
        handle, temporary = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.name}.", suffix=".part"
        )
    except OSError as error:
        raise OSError(f"{path} cannot be written: {error.strerror}") from error
    os.close(handle)
    try:
        yield Path(temporary)
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def write_variable(
    file: h5py.File, name: str, values: Any, units: str, dims: tuple[str, ...] = (), **extra: Any
) -> h5py.Dataset:
    """A netCDF-4 variable: data, units, and its dimension scales, which must exist."""
    dataset = file.create_dataset(name, data=values, **extra)
    dataset.attrs["units"] = units
    for axis, dim in enumerate(dims):
        if dim != name:
            dataset.dims[axis].attach_scale(file[dim])
    return dataset


def write_dimension(file: h5py.File, name: str, values: Any, units: str) -> None:
    """A coordinate variable that is its own dimension scale."""
    file.create_dataset(name, data=values).make_scale(name)
    file[name].attrs["units"] = units
