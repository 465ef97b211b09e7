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
from torchliner.file_checks import Unwritten, naming, require_regular

CHUNK_CACHE = 64 << 20  # bytes; the default of 1 MiB decompresses every tile many times
LINEAR, MARKS = ("scale_factor", "add_offset"), ("_FillValue", "missing_value")


@contextmanager
def open_file(path: str | Path) -> Iterator[h5py.File]:
    """An HDF5 file for reading; every error of the block names it."""
    with naming(path), hold_open(path) as file:
        yield file


def hold_open(path: str | Path) -> h5py.File:
    """An HDF5 file that stays open; a solver may still hold it, so it is not locked. An OSError as of
    ``require_regular``, or where it is not HDF5, or truncated."""
    require_regular(path)
    # This process may hold it open with locking, HDF5 wants the flags to agree; or for writing while others read.
    for settings in ({"locking": False}, {}, {"locking": False, "swmr": True}, {"swmr": True}):
        try:
            return h5py.File(path, "r", rdcc_nbytes=CHUNK_CACHE, **settings)
        except OSError as error:
            failed = error.with_traceback(None)  # its frames, this one among them, would keep the file open in a cycle
            if not re.search("locking|already open for write", str(error)):
                break
    why = "is truncated" if "truncated" in str(failed) else "is not an HDF5 (netCDF-4) file that can be read"
    raise OSError(f"{path} {why}: {failed}") from failed


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
    """Refuse before reading what HDF5 would fill with zeros, in the file of a ``path``: a virtual dataset, raw storage
    outside the file, chunks or values that were never written. A DataWarning where the values stand in
    another file, by an external link."""
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


@dataclass(frozen=True)
class Packing:
    """How numbers are stored: value = factor * stored + offset; ``marks`` are stored values that stand for none."""

    factor: float = 1.0
    offset: float = 0.0
    marks: tuple[Any, ...] = ()

    def unpack(self, stored: np.ndarray, kind: Any = None) -> np.ndarray:
        """The values meant, nan where there is none; of the dtype ``kind``, default that of ``stored``, float64 of
        integers that are packed or missing."""
        lost = np.zeros(stored.shape, bool)
        for mark in self.marks:
            lost |= stored == mark
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
    """What attributes say of the packing of a variable of a ``kind``, and what the file itself fills in.

    Source: CF conventions 1.8, sections 2.5.1 and 8.1.
    """
    if "_Unsigned" in attributes and kind.kind == "i":
        raise ValueError(f"{label} is _Unsigned in signed integers; write it anew as floating-point numbers")
    found: dict[str, list[Any]] = {} if fill is None else {"fill": [fill]}
    for key in {*LINEAR, *MARKS} & set(attributes):
        values = np.asarray(attributes[key]).reshape(-1)
        if values.dtype.kind not in "fiu" or not len(values) or (key in LINEAR and not np.isfinite(values).all()):
            raise ValueError(f"{label}: attribute {key} is {attributes[key]!r}; numbers are needed")
        found[key] = values.tolist()
    factor, offset = (float(found.get(key, [default])[0]) for key, default in zip(LINEAR, (1.0, 0.0), strict=True))
    if factor == 0:
        raise ValueError(f"{label}: scale_factor is 0; it must be another number")
    marks = [mark for key in (*MARKS, "fill") for mark in found.get(key, ())]
    with np.errstate(all="ignore"):
        cast = [(mark, np.asarray(mark).astype(kind)[()]) for mark in marks if mark == mark]  # nan needs no mark
    # Among integers only a mark that is one can occur.
    return Packing(factor, offset, tuple({own for mark, own in cast if kind.kind == "f" or own == mark}))
