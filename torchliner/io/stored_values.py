"""Values of an HDF5 dataset as they are meant: all of them written, and unpacked."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import Unwritten, require_memory

NUMBERS = "fiu"  # kinds of dtype


@dataclass(frozen=True)
class Packing:
    """How the CF conventions store numbers: value = factor * stored + offset.

    Args:
        factor, offset: attributes ``scale_factor`` and ``add_offset``.
        missing: stored values that stand for none: ``_FillValue``, ``missing_value`` and the
            file's own fill value, in the dtype of the dataset.
        low, high: stored values beyond them stand for none: ``valid_range``, ``valid_min``,
            ``valid_max``.
        wrap: what negative stored values are below those meant: integers of n bits that are
            ``_Unsigned``, 2^n; else 0.
    """

    factor: float = 1.0
    offset: float = 0.0
    missing: tuple[Any, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    wrap: int = 0

    @property
    def linear(self) -> bool:
        """Whether stored values differ from those meant."""
        return (self.factor, self.offset) != (1.0, 0.0)

    def lost(self, stored: np.ndarray) -> np.ndarray | None:
        """Where stored values stand for none; None where all count."""
        ranged = (self.low, self.high) != (-math.inf, math.inf)
        if not stored.size or not (self.missing or ranged):
            return None
        # Most slabs hold none, as their ends tell without an array of answers; nan tells nothing.
        low, high = stored.min(), stored.max()
        bad: np.ndarray | None = None
        for mark in self.missing:
            if not (mark < low or mark > high):
                same = stored == mark
                bad = same if bad is None else bad | same
        if ranged and not (low >= self.low and high <= self.high):
            beyond = (stored < self.low) | (stored > self.high)
            bad = beyond if bad is None else bad | beyond
        return bad if bad is not None and bool(bad.any()) else None

    def unpack_floats(self, values: np.ndarray) -> None:
        """In place: stored values, already floats, become those meant, nan where there is none."""
        if self.wrap:
            values[values < 0] += self.wrap
        bad = self.lost(values)
        with np.errstate(over="ignore", invalid="ignore"):  # told with the faults of probes
            if self.factor != 1.0:
                values *= values.dtype.type(self.factor)
            if self.offset != 0.0:
                values += values.dtype.type(self.offset)
        if bad is not None:
            values[bad] = np.nan

    def unpack(self, stored: np.ndarray) -> np.ndarray:
        """The values meant; integers stay as they are where nothing is packed or missing."""
        if stored.dtype.kind == "f":
            self.unpack_floats(stored)
            return stored
        if self.wrap:
            stored = stored.view(stored.dtype.str.replace("i", "u"))
        bad = self.lost(stored)
        if bad is None and not self.linear:
            return stored
        values = stored.astype(np.float64) * self.factor + self.offset
        return values if bad is None else np.where(bad, np.nan, values)


def packing_of(dataset: h5py.Dataset, label: str) -> Packing:
    """What the attributes of a dataset say of its packing.

    Args:
        dataset: of numbers.
        label: FILE:/dataset, for messages.
    Raises:
        ValueError: an attribute is no finite number; a factor of 0.
    Source: CF conventions 1.8, sections 2.5.1 and 8.1; netCDF Users Guide for ``_Unsigned``.
    """
    kind, wrap = dataset.dtype, 0
    unsigned = np.asarray(dataset.attrs.get("_Unsigned", "")).astype(str).reshape(-1)
    if kind.kind == "i" and unsigned.tolist() == ["true"]:
        kind, wrap = np.dtype(kind.str.replace("i", "u")), 256**kind.itemsize
    found = {key: _numbers(dataset, key, label)
             for key in ("scale_factor", "add_offset", "_FillValue", "missing_value",
                         "valid_min", "valid_max", "valid_range")
             if key in list(dataset.attrs)}  # fmt: skip  # a list fails where damage hides one
    for key in ("scale_factor", "add_offset"):
        if key in found and not (len(found[key]) == 1 and np.isfinite(found[key][0])):
            raise ValueError(f"{label}: {key} is {found[key]}; one finite number is needed")
    if "scale_factor" in found and found["scale_factor"][0] == 0:
        raise ValueError(f"{label}: scale_factor is 0, so that all values are one; correct it")
    marks = [*found.get("_FillValue", ()), *found.get("missing_value", ())]
    fill = dataset.fillvalue
    if dataset.id.get_create_plist().fill_value_defined() == h5py.h5d.FILL_VALUE_USER_DEFINED and (
        fill != 0  # as chosen by hand for gaps that count as 0
    ):
        marks.append(fill)
    with np.errstate(all="ignore"):
        cast = [(m, np.asarray(m).astype(kind)[()]) for m in _wrapped(marks, wrap)]
    # nan needs no mark; among integers only a mark that is one can occur.
    missing = tuple({m for mark, m in cast
                     if mark == mark and (kind.kind == "f" or m == mark)})  # fmt: skip
    low, high = found.get("valid_range", (-math.inf, math.inf))[:2]
    ends = [found.get("valid_min", (low,))[0], found.get("valid_max", (high,))[0]]
    low, high = map(float, _wrapped(ends, wrap))
    return Packing(
        float(found.get("scale_factor", (1.0,))[0]),
        float(found.get("add_offset", (0.0,))[0]),
        missing,
        low,
        high,
        wrap,
    )


def _wrapped(marks: list[Any], wrap: int) -> list[Any]:
    """Stored values as ``Packing.wrap`` has them."""
    return [float(mark) + wrap if wrap and -math.inf < mark < 0 else mark for mark in marks]


def _numbers(dataset: h5py.Dataset, key: str, label: str) -> list[Any]:
    values = np.asarray(dataset.attrs[key]).reshape(-1)
    if values.dtype.kind not in NUMBERS or len(values) < 1 + (key == "valid_range"):
        raise ValueError(f"{label}: attribute {key} is {dataset.attrs[key]!r}; numbers are needed")
    return list(values)


def require_stored(dataset: h5py.Dataset, label: str, path: str | Path) -> None:
    """Refuse what HDF5 would fill with zeros, or what does not fit into memory; before reading.

    Args:
        dataset: that is to be read.
        label: FILE:/dataset, for messages.
        path: of the file that was opened.
    Raises:
        ValueError: an empty dataset; chunks or values that were never written; raw storage
            outside the file; a virtual dataset that does not cover itself or lacks a source; a
            chunk larger than the machine's memory.
    Warns:
        DataWarning: the values stand in another file: an external link, a virtual dataset.
    """
    if dataset.shape is None:
        raise ValueError(f"{label} is empty: it has neither shape nor values")
    if dataset.external:
        files = ", ".join(sorted({str(name) for name, *_ in dataset.external}))
        raise ValueError(
            f"{label} keeps its values outside the file, in {files}, where nothing tells whether "
            "they are whole; copy the dataset into one file (h5repack)"
        )
    home = dataset.file.filename
    if dataset.file.driver != "core" and not os.path.samefile(home, path):  # core: in memory
        tell(f"{label} is a link; its values stand in {home}")
    if dataset.is_virtual:
        _require_sources(dataset, label, Path(home).parent)
        return
    if dataset.chunks is None:
        # Space is made when the first value is written, for all of them at once.
        if dataset.size and dataset.id.get_storage_size() == 0:
            raise Unwritten(
                f"{label} holds no values: none of its {dataset.size} was ever written, and they "
                f"would read as {dataset.fillvalue}"
            )
        return
    require_memory(
        2 * math.prod(dataset.chunks) * dataset.dtype.itemsize,
        f"{label}: one chunk of {dataset.chunks}, which is unpacked as a whole,",
        "store it in smaller chunks (h5repack)",
    )
    wanted = math.prod(-(-n // c) for n, c in zip(dataset.shape, dataset.chunks, strict=True))
    written = dataset.id.get_num_chunks()
    if written < wanted:
        raise Unwritten(
            f"{label}: {wanted - written} of {wanted} chunks were never written and would read as "
            f"{dataset.fillvalue}, as after a run that was broken off; cut the file to what is "
            "there, or write the rest"
        )


def _require_sources(dataset: h5py.Dataset, label: str, folder: Path) -> None:
    """All parts of a virtual dataset are mapped, and each source is there and whole."""
    sources = dataset.virtual_sources()
    mapped = _mapped(dataset, [part.vspace for part in sources])
    if mapped < dataset.size:
        raise ValueError(
            f"{label} is a virtual dataset that has sources for {mapped} of its {dataset.size} "
            f"values; the others would read as {dataset.fillvalue}"
        )
    for part in sources:
        source = Path(dataset.file.filename if part.file_name == "." else folder / part.file_name)
        if not source.is_file():
            raise ValueError(f"{label} is a virtual dataset whose source {source} is not there")
        with h5py.File(source, "r", locking=False) as file:
            if part.dset_name not in file:
                raise ValueError(f"{label}: its source {source}:{part.dset_name} is not there")
            shape, chosen = file[part.dset_name].shape or (), part.src_space
            if chosen.get_select_type() == h5py.h5s.SEL_ALL:
                enough = math.prod(shape) >= part.vspace.get_select_npoints()
            else:
                last = chosen.get_select_bounds()[1]
                enough = len(last) == len(shape) and all(np.array(last) < shape)
            if not enough:
                raise ValueError(
                    f"{label} takes more of its source {source}:{part.dset_name} than there is, "
                    f"{shape}; what is missing would read as {dataset.fillvalue}"
                )
            require_stored(file[part.dset_name], f"{source}:{part.dset_name}", source)
    names = sorted({part.file_name for part in sources})
    tell(f"{label} is a virtual dataset; its values stand in {', '.join(names)}")


def _mapped(dataset: h5py.Dataset, spaces: Sequence[h5py.h5s.SpaceID]) -> int:
    """How many values of a virtual dataset have a source; those with several count once."""
    union = dataset.id.get_space()
    union.select_none()
    for each in spaces:
        if each.get_select_type() == h5py.h5s.SEL_ALL:
            return int(dataset.size)
        if each.get_select_npoints() == 0:
            continue
        if each.is_regular_hyperslab():
            slabs = [each.get_regular_hyperslab()]
        else:
            blocks = each.get_select_hyper_blocklist()
            slabs = [(a, None, np.ones_like(a), b - a + 1) for a, b in blocks]
        for start, stride, count, block in slabs:
            start, count, block = (tuple(map(int, n)) for n in (start, count, block))
            stride = None if stride is None else tuple(map(int, stride))
            union.select_hyperslab(start, count, stride, block, op=h5py.h5s.SELECT_OR)
    return int(union.get_select_npoints())


def read_values(dataset: h5py.Dataset, label: str, path: str | Path, part: Any = ()) -> np.ndarray:
    """Numbers of a dataset, or a part of it, as they are meant.

    Args:
        dataset, label, path: as for ``require_stored``.
        part: as h5py takes it; () for all.
    Returns:
        An array of the dataset's dtype; float64 where integers are packed or missing, nan where
        there is no value.
    Raises:
        ValueError: as ``require_stored`` and ``packing_of``; no real numbers; more than the
            machine's memory.
    """
    require_numbers(dataset, label)
    require_stored(dataset, label, path)
    if isinstance(part, tuple) and part == ():
        require_memory(dataset.size * dataset.dtype.itemsize, f"{label}, {dataset.shape},")
    return packing_of(dataset, label).unpack(np.asarray(dataset[part]))


def require_numbers(dataset: h5py.Dataset, label: str) -> None:
    """Refuse texts, records and truth values."""
    if dataset.dtype.kind not in NUMBERS:
        raise ValueError(f"{label} is {dataset.dtype}; numbers are needed")
