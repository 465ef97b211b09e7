"""HDF5 as it is opened and read: no value that was never written, and numbers as the CF conventions pack them."""

import math
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import Unwritten, naming, require_memory, require_regular

CHUNK_CACHE = 64 << 20  # bytes; the default of 1 MiB decompresses every tile many times
LINEAR, RANGE = ("scale_factor", "add_offset"), ("valid_range", "valid_min", "valid_max")
PACKING = (*LINEAR, *RANGE, "_FillValue", "missing_value")


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
    require_regular(path)
    # This process may hold it open with locking, HDF5 wants the flags to agree; or for writing while others read.
    for settings in ({"locking": False}, {}, {"locking": False, "swmr": True}, {"swmr": True}):
        try:
            return h5py.File(path, "r", rdcc_nbytes=CHUNK_CACHE, **settings)
        except OSError as error:
            failed = error.with_traceback(None)  # its frames, this one among them, would keep the file open in a cycle
            if not re.search("locking|already open for write", str(error)):
                break
    why = "is truncated" if "truncated" in str(failed) else "is not an HDF5 (netCDF-4) file"
    why = "cannot be read" if isinstance(failed, PermissionError) else why
    remedy = "; copy it again, or write it anew" if why == "is truncated" else ""
    raise OSError(f"{path} {why}: {failed}{remedy}") from failed


def is_there(group: h5py.Group, key: str, path: str | Path) -> bool:
    """Whether a group has an object of this name; a link that leads nowhere is a ValueError, to a pipe an OSError."""
    link = group.get(key, getlink=True)
    if link is None or isinstance(link, h5py.HardLink):
        return link is not None
    if isinstance(link, h5py.ExternalLink):
        for target in (Path(group.file.filename).parent / link.filename, Path(link.filename)):
            if target.exists():
                require_regular(target)  # HDF5 would wait for a pipe without an end
    if group.get(key) is None:
        to = ":".join(getattr(link, name) for name in ("filename", "path") if hasattr(link, name))
        label = f"{path}:{(group.name or '').rstrip('/')}/{key}"
        raise ValueError(f"{label} is a link to {to}, which is not there; restore that or remove the link")
    return True


def text_attribute(owner: Any, key: str) -> str | None:
    """A string attribute of what has ``attrs``, or None."""
    value = owner.attrs.get(key)
    if value is None:
        list(owner.attrs)  # fails where damage hides an attribute, which is not left out then
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if value is None or isinstance(value, h5py.Empty):
        return None
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def require_stored(dataset: h5py.Dataset, label: str, path: str | Path) -> None:
    """Refuse what HDF5 would fill with zeros; before reading.

    Args:
        dataset: that is to be read.
        label: FILE:/dataset, for messages.
        path: of the file that was opened.
    Raises:
        ValueError: an empty or a virtual dataset; chunks or values that were never written; raw storage outside the
            file.
    Warns:
        DataWarning: the values stand in another file, by an external link.
    """
    if dataset.shape is None:
        raise ValueError(f"{label} is empty: it has neither shape nor values")
    if dataset.external or dataset.is_virtual:
        raise ValueError(f"{label} keeps its values outside the file; copy them into one file (h5repack -l CONTI)")
    if dataset.file.driver != "core" and not os.path.samefile(dataset.file.filename, path):  # core: in memory
        tell(f"{label} is a link; its values stand in {dataset.file.filename}")
    if dataset.chunks is None:
        # Space is made when the first value is written, for all of them at once.
        wanted, written, what = int(dataset.size > 0), int(dataset.id.get_storage_size() > 0), "blocks"
    else:
        wanted = math.prod(-(-n // c) for n, c in zip(dataset.shape, dataset.chunks, strict=True))
        written, what = dataset.id.get_num_chunks(), "chunks"
    if written < wanted:
        raise Unwritten(
            f"{label}: {wanted - written} of {wanted} {what} were never written and would read as "
            f"{dataset.fillvalue}, as after a run that was broken off; cut the file to what is there, or write the rest"
        )


# Packed numbers


@dataclass(frozen=True)
class Packing:
    """How numbers are stored: value = factor * stored + offset.

    Args:
        factor, offset: of the value.
        marks: stored values that stand for none.
        low, high: stored values beyond them stand for none.
        unsigned: integers are stored as if they had a sign.
    """

    factor: float = 1.0
    offset: float = 0.0
    marks: tuple[Any, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    unsigned: bool = False

    def unpack(self, stored: np.ndarray, kind: Any = None) -> np.ndarray:
        """The values meant, nan where there is none; of the dtype ``kind``, default that of ``stored``, float64 of
        integers that are packed or missing."""
        stored = stored.view(_unsigned(stored.dtype)) if self.unsigned else stored
        lost = np.zeros(stored.shape, bool)
        for mark in self.marks:
            lost |= stored == mark
        if (self.low, self.high) != (-math.inf, math.inf):
            lost |= (stored < self.low) | (stored > self.high)
        missing, linear = bool(lost.any()), (self.factor, self.offset) != (1.0, 0.0)
        if kind is None:
            kind = np.float64 if stored.dtype.kind != "f" and (missing or linear) else stored.dtype
        values = stored.astype(kind, order="C", copy=missing or linear)
        with np.errstate(over="ignore", invalid="ignore"):  # told with the faults of probes
            if linear:
                values *= values.dtype.type(self.factor)
                values += values.dtype.type(self.offset)
        if missing:
            values[lost] = np.nan
        return values


PLAIN = Packing()


def packing_of(attributes: Mapping[str, Any], kind: np.dtype[Any], label: str, fill: Any = None) -> Packing:
    """What is said of the packing of a variable.

    Args:
        attributes: of the variable.
        kind: as which it is stored.
        label: FILE:/variable, for messages.
        fill: what the file itself fills in.
    Raises:
        ValueError: an attribute is no finite number; a factor of 0.
    Source: CF conventions 1.8, sections 2.5.1 and 8.1; netCDF Users Guide for ``_Unsigned``.
    """
    unsigned = kind.kind == "i" and "true" in np.asarray(attributes.get("_Unsigned", "")).astype(str).reshape(-1)
    kind = _unsigned(kind) if unsigned else kind
    found: dict[str, list[Any]] = {} if fill is None else {"fill": [fill]}
    for key in set(PACKING) & set(attributes):
        values = np.asarray(attributes[key]).reshape(-1)
        if values.dtype.kind not in "fiu" or len(values) < 1 + (key == "valid_range"):
            raise ValueError(f"{label}: attribute {key} is {attributes[key]!r}; numbers are needed")
        found[key] = (values.astype("i8").astype(kind) if unsigned and key not in LINEAR else values).tolist()
    factor, offset = (float(found.get(key, [default])[0]) for key, default in zip(LINEAR, (1.0, 0.0), strict=True))
    if factor == 0 or not math.isfinite(factor) or not math.isfinite(offset):
        raise ValueError(
            f"{label}: scale_factor is {factor:g}, add_offset {offset:g}; finite ones, the first not 0, are needed"
        )
    marks = [mark for key in ("_FillValue", "missing_value", "fill") for mark in found.get(key, ())]
    with np.errstate(all="ignore"):
        cast = [(mark, np.asarray(mark).astype(kind)[()]) for mark in marks]
    # nan needs no mark; among integers only a mark that is one can occur.
    missing = tuple({own for mark, own in cast if mark == mark and (kind.kind == "f" or own == mark)})
    low, high = found.get("valid_range", (-math.inf, math.inf))[:2]
    low, high = found.get("valid_min", (low,))[0], found.get("valid_max", (high,))[0]
    return Packing(factor, offset, missing, float(low), float(high), unsigned)


def _unsigned(kind: np.dtype[Any]) -> np.dtype[Any]:
    return np.dtype(kind.str.replace("i", "u"))


def fill_of(dataset: h5py.Dataset) -> Any:
    """What a dataset of HDF5 is filled with by its own words; 0 is chosen by hand for gaps that count as 0."""
    chosen = dataset.id.get_create_plist().fill_value_defined() == h5py.h5d.FILL_VALUE_USER_DEFINED
    return dataset.fillvalue if chosen and dataset.fillvalue != 0 else None


def read_values(dataset: h5py.Dataset, label: str, path: str | Path) -> np.ndarray:
    """Numbers of a dataset as they are meant: as ``Packing.unpack``.

    Args:
        dataset, label, path: as for ``require_stored``.
    Raises:
        ValueError: as ``require_stored`` and ``packing_of``; no real numbers; more than the machine's memory.
    """
    require_numbers(dataset, label)
    require_stored(dataset, label, path)
    require_memory(dataset.size * dataset.dtype.itemsize, f"{label}, {dataset.shape},")
    packing = packing_of(dict(dataset.attrs), dataset.dtype, label, fill_of(dataset))
    return packing.unpack(np.asarray(dataset[()]))


def require_numbers(dataset: Any, label: str) -> None:
    """Refuse texts, records and truth values."""
    if dataset.dtype.kind not in "fiu":
        raise ValueError(f"{label} is {dataset.dtype}; numbers are needed")
