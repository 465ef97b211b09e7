"""What our HDF5 files share: opening, datasets in SI units, JSON, reference impedances."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.file_checks import naming, require_regular
from torchliner.io.stored_values import read_values, require_stored
from torchliner.units import SI_QUANTITY, require_plausible, si_factor

LONGEST_TEXT = 60_000  # bytes
CHUNK_CACHE = 64 << 20  # bytes; the default of 1 MiB decompresses every tile many times


@contextmanager
def open_file(path: str | Path) -> Iterator[h5py.File]:
    """An HDF5 file for reading; every error of the block names it."""
    with naming(path), hold_open(path) as file:
        yield file


def hold_open(path: str | Path) -> h5py.File:
    """An HDF5 file that stays open; a solver may still hold it, so it is not locked.

    Raises:
        FileNotFoundError: no such file.
        OSError: a folder or a device, not HDF5, or truncated.
    """
    path = Path(path)
    require_regular(path)
    try:
        return _opened(path, locking=False)
    except OSError as error:
        kind = "is truncated" if "truncated" in str(error) else "is not an HDF5 (netCDF-4) file"
        if isinstance(error, PermissionError):
            kind = "cannot be read"
        remedy = "; copy it again, or write it anew" if kind == "is truncated" else ""
        raise OSError(f"{path} {kind}: {error}{remedy}") from error


def _opened(path: Path, **settings: Any) -> h5py.File:
    try:
        return h5py.File(path, "r", rdcc_nbytes=CHUNK_CACHE, **settings)
    except OSError as error:
        # The same process holds it open with locking; HDF5 wants the flags to agree.
        if "locking" in str(error) and settings:
            return _opened(path)
        if "already open for write" in str(error) and "swmr" not in settings:
            return _opened(path, swmr=True, **settings)  # by one who lets others read
        raise


def is_there(group: h5py.Group, key: str, path: str | Path) -> bool:
    """Whether a group has an object of this name; a link that leads nowhere is a ValueError, to a pipe an OSError."""
    link = group.get(key, getlink=True)
    if link is None:
        return False
    if isinstance(link, h5py.ExternalLink):
        for target in (Path(group.file.filename).parent / link.filename, Path(link.filename)):
            if target.exists():
                require_regular(target)  # HDF5 would wait for a pipe without an end
    if not isinstance(link, h5py.HardLink) and group.get(key) is None:
        target = ":".join(getattr(link, name) for name in ("filename", "path") if hasattr(link, name))
        raise ValueError(
            f"{place(group, key, path)} is a link to {target}, which is not there; restore that or remove the link"
        )
    return True


def get_dataset(group: h5py.Group, key: str, path: str | Path) -> h5py.Dataset:
    """A dataset by name; a ValueError lists what is there instead."""
    if not is_there(group, key, path) or not isinstance(group[key], h5py.Dataset):
        where = "the file" if group.name == "/" else "the group"
        raise ValueError(
            f"{place(group, key, path)} is missing; {where} holds: {', '.join(sorted(group)) or 'nothing'}"
        )
    return group[key]


def get_group(file: h5py.Group, key: str, path: str | Path) -> h5py.Group:
    """A group by name; errors as of ``get_dataset`` and ``require_names``."""
    if not is_there(file, key, path) or not isinstance(file[key], h5py.Group):
        raise ValueError(f"{place(file, key, path)} is no group; there are: {', '.join(file)}")
    require_names(file[key], path)
    return file[key]


def require_names(group: h5py.Group, path: str | Path) -> None:
    """Refuse a group whose damage hides some of its names: optional variables would be missed in silence."""
    lost = [name for name in group if group.get(name, getlink=True) is None]
    if lost or len(set(group)) < len(group):
        raise ValueError(f"{path} is damaged: of the names that {group.name} lists {lost or 'some'} lead nowhere")


def place(group: h5py.Group, key: str, path: str | Path) -> str:
    """FILE:/group/dataset, for messages."""
    return f"{path}:{(group.name or '').rstrip('/')}/{key}"


def text_attribute(dataset: Any, key: str) -> str | None:
    """A string attribute or None."""
    value = dataset.attrs.get(key)
    if value is None:
        list(dataset.attrs)  # fails where damage hides an attribute, which is not left out then
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if value is None or isinstance(value, h5py.Empty):
        return None
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def read_si(group: h5py.Group, key: str, unit: str, path: str | Path, any_size: bool = False) -> np.ndarray:
    """A dataset in an SI unit; real numbers as meant, float64 where the file has another unit than ``unit``.

    Raises:
        ValueError: it is missing, has no unit of this quantity, holds no real numbers, or such as
            no measurement has, unless ``any_size``; as ``read_values``.
    """
    dataset, label = get_dataset(group, key, path), place(group, key, path)
    factor = si_factor(SI_QUANTITY[unit], text_attribute(dataset, "units"), label)
    values = read_values(dataset, label, path)
    values = values if factor == 1 else values.astype(np.float64) * factor
    if not any_size:
        require_plausible(values, SI_QUANTITY[unit], label)
    return values


def read_number(group: h5py.Group, key: str, unit: str, path: str | Path) -> float:
    """One number in an SI unit; an array of one counts."""
    size = get_dataset(group, key, path).size
    if size != 1:
        raise ValueError(f"{place(group, key, path)} has shape {group[key].shape}; one number is needed")
    return float(read_si(group, key, unit, path).reshape(()))


def read_texts(group: h5py.Group, key: str, path: str | Path) -> list[str]:
    """A list of texts along a dimension."""
    dataset, label = get_dataset(group, key, path), place(group, key, path)
    if h5py.check_string_dtype(dataset.dtype) is None or dataset.ndim != 1:
        raise ValueError(f"{label} is {dataset.dtype} of shape {dataset.shape}; a list of texts is needed")
    require_stored(dataset, label, path)
    return [str(text) for text in dataset.asstr(errors="replace")[()]]


def set_texts(owner: Any, **texts: str) -> None:
    """Attributes as texts of fixed length, which nco and Octave read; HDF5 has 64 kB for them, beyond it no choice."""
    for key, text in texts.items():
        stored = text.encode()
        fixed = h5py.string_dtype("utf-8", max(1, len(stored)) if len(stored) < LONGEST_TEXT else None)
        owner.attrs.create(key, stored, dtype=fixed)


def write_variable(
    group: h5py.Group, name: str, values: Any, units: str, dims: Sequence[str] = (), **storage: Any
) -> h5py.Dataset:
    """A netCDF-4 variable: data, units, and its dimension scales, which must exist.

    A variable whose dimension bears its own name is that dimension's scale.
    """
    dataset = group.create_dataset(name, data=values, **storage)
    set_texts(dataset, units=units)
    attach_scales(dataset, group, dims)
    return dataset


def attach_scales(dataset: h5py.Dataset, group: h5py.Group, dims: Sequence[str]) -> None:
    """Name the axes of a dataset by dimension scales of its group, of which it may be one."""
    for axis, dim in enumerate(dims):
        if group[dim] == dataset:
            dataset.make_scale(dim)
        else:
            dataset.dims[axis].attach_scale(group[dim])


def write_index(group: h5py.Group, name: str, count: int) -> None:
    """A dimension without coordinates: 0, 1, ..."""
    row = write_variable(group, name, np.arange(count), "1", (name,))
    set_texts(row, long_name=f"number of the {name.replace('_', ' ')}")


def write_texts(group: h5py.Group, name: str, texts: Sequence[str], dim: str) -> None:
    """A list of texts along a dimension, whose scale it is if it bears its name."""
    attach_scales(group.create_dataset(name, data=list(texts), dtype=h5py.string_dtype()), group, (dim,))


def tiles(shape: Sequence[int], rows: int, columns: int = 64, level: int = 9) -> dict[str, Any]:
    """Storage of a compressed variable: gzip in tiles of at most ``rows`` along the first axis."""
    chunks = tuple(min(n, columns if axis else rows) for axis, n in enumerate(shape))
    return {"compression": "gzip", "compression_opts": level, "shuffle": True, "chunks": chunks}


def to_json(value: Any) -> str:
    """JSON text; arrays and tensors become lists, what JSON does not know becomes text."""
    return json.dumps(value, default=lambda item: item.tolist() if hasattr(item, "tolist") else str(item))


def read_json(file: h5py.Group, key: str, path: str | Path, default: Any) -> Any:
    """A JSON attribute, or ``default`` if there is none."""
    text = text_attribute(file, key)
    if not text:
        return default
    label = f"{path}: attribute {key!r}"
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{label} is not JSON ({error}); repair or remove it") from error
    wanted, kind = (list, "a list") if isinstance(default, tuple | list) else (dict, "an object")
    if isinstance(default, tuple | list | dict) and not isinstance(found, wanted):
        raise ValueError(f"{label} is {text[:40]!r}; {kind} is needed")
    return found


def write_references(file: h5py.File, reference: Mapping[str, complex]) -> None:
    """Impedances by name, each as two scalars whose attribute ``label`` holds the name."""
    for number, (label, value) in enumerate(reference.items()):
        stem = "reference_" + re.sub(r"\W+", "_", label)
        if f"{stem}_resistance" in file:
            stem = f"{stem}_{number}"
        parts = {"resistance": complex(value).real, "reactance": complex(value).imag}
        for part, amount in parts.items():
            row = write_variable(file, f"{stem}_{part}", amount, "1")
            set_texts(row, label=label, long_name=f"{part} from elsewhere, {label}")
