"""Stored values as they are meant: all of them written, and unpacked as the CF conventions say."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import Unwritten, require_memory

NUMBERS = "fiu"  # kinds of dtype
PACKING = ("scale_factor", "add_offset", "_FillValue", "missing_value", "valid_min", "valid_max", "valid_range")


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
        if values.dtype.kind not in NUMBERS or len(values) < 1 + (key == "valid_range"):
            raise ValueError(f"{label}: attribute {key} is {attributes[key]!r}; numbers are needed")
        found[key] = (values.astype("i8").astype(kind) if unsigned and key in PACKING[2:] else values).tolist()
    factor, offset = (float(found.get(key, [default])[0]) for key, default in zip(PACKING, (1.0, 0.0), strict=False))
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


def read_values(dataset: h5py.Dataset, label: str, path: str | Path, part: Any = ()) -> np.ndarray:
    """Numbers of a dataset, or a part of it, as they are meant: as ``Packing.unpack``.

    Args:
        dataset, label, path: as for ``require_stored``.
        part: as h5py takes it; () for all.
    Raises:
        ValueError: as ``require_stored`` and ``packing_of``; no real numbers; more than the machine's memory.
    """
    require_numbers(dataset, label)
    require_stored(dataset, label, path)
    if isinstance(part, tuple) and part == ():
        require_memory(dataset.size * dataset.dtype.itemsize, f"{label}, {dataset.shape},")
    packing = packing_of(dict(dataset.attrs), dataset.dtype, label, fill_of(dataset))
    return packing.unpack(np.asarray(dataset[part]))


def require_numbers(dataset: Any, label: str) -> None:
    """Refuse texts, records and truth values."""
    if dataset.dtype.kind not in NUMBERS:
        raise ValueError(f"{label} is {dataset.dtype}; numbers are needed")
