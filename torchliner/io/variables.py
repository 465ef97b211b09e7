"""Variables of files and datasets, whether h5py, numpy or xarray holds them: values in SI units, clocks, coordinates,
and the velocity that stays where it lies."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.file_checks import Unwritten, naming, require_memory
from torchliner.io.hdf5 import PLAIN, Packing, hold_open, is_there, packing_of, require_stored, text_attribute
from torchliner.io.plane_format import UNIFORMITY, Stored, clock_of
from torchliner.units import SI_QUANTITY, require_plausible, si_factor

# How netCDF-4 says that a dimension has a length and no coordinates.
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"
Opener = Callable[[], Mapping[str, Any]]  # picklable: what holds the variables of a file by name


@dataclass(frozen=True, eq=False)
class Field:
    """One variable where it lies: an array of h5py, numpy or xarray; path of the file; name with its groups,
    /group/name; attributes; name of each axis with its groups, "" where it has none."""

    array: Any
    path: Path
    name: str
    attrs: Mapping[str, Any]
    axes: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """FILE:/variable."""
        return f"{self.path}:{self.name}" if self.name else f"{self.path}"

    @property
    def short(self) -> str:
        """Name without groups."""
        return self.name.rpartition("/")[2]

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes; () also of what HDF5 calls empty."""
        return tuple(int(n) for n in self.array.shape or ())

    @property
    def size(self) -> int:
        """Number of values."""
        return math.prod(self.shape)

    @property
    def bare(self) -> bool:
        """Whether it stands for the length of a dimension alone."""
        return "units" not in self.attrs and (self.text("NAME") or "").startswith(NO_VARIABLE)

    def text(self, key: str) -> str | None:
        """An attribute as text; None if there is none."""
        return text_attribute(self, key)

    def packing(self) -> Packing:
        """How its numbers are stored; a ValueError where they are none, or were never written."""
        if self.array.dtype.kind not in "fiu":
            raise ValueError(f"{self.label} is {self.array.dtype}; numbers are needed")
        fill = None
        if isinstance(self.array, h5py.Dataset):
            require_stored(self.array, self.label, self.path)
            chosen = self.array.id.get_create_plist().fill_value_defined() == h5py.h5d.FILL_VALUE_USER_DEFINED
            # 0 is chosen by hand for gaps that count as 0.
            fill = self.array.fillvalue if chosen and self.array.fillvalue != 0 else None
        return packing_of(dict(self.attrs), self.array.dtype, self.label, fill)

    def values(self) -> np.ndarray:
        """All values as they are meant, in the byte order of the machine; a ValueError as of ``packing``, or where they
        do not fit into memory."""
        packing = self.packing()
        require_memory(self.size * self.array.dtype.itemsize, f"{self.label}, {self.shape},")
        stored = np.asarray(self.array[()])
        return packing.unpack(stored.astype(stored.dtype.newbyteorder("="), copy=False))

    def factor(self, unit: str, stated: str | None = None) -> float:
        """Factor to an SI unit; ``stated`` by the user, where the file has no units; a ValueError if it has others."""
        found, quantity = self.text("units"), SI_QUANTITY[unit]
        factor = si_factor(quantity, stated if found is None else found, self.label)
        if stated is not None and si_factor(quantity, stated, "the stated unit") != factor:
            raise ValueError(f"{self.label} is in {found} by its own words, not in {stated}; correct one")
        return factor

    def si(self, unit: str, stated: str | None = None, wide: bool = False) -> np.ndarray:
        """All values in an SI unit, float64 where the file has another; a ValueError where no measurement is so, unless
        they are of a wide range."""
        factor, values = self.factor(unit, stated), self.values()
        values = values if factor == 1 else values.astype(np.float64) * factor
        if not wide:
            require_plausible(values, SI_QUANTITY[unit], self.label)
        return values

    def number(self, unit: str) -> float:
        """One number in an SI unit; an array of one counts."""
        if self.size != 1 or self.array.shape is None:
            raise ValueError(f"{self.label} has shape {self.shape}; one number is needed")
        return float(self.si(unit).reshape(()))

    def signal_factor(self, unit: str, stated: str | None = None) -> float:
        """``factor`` of a signal: integers count where ``scale_factor`` or the user says what they stand for."""
        kind = self.array.dtype.kind
        if kind != "f" and (kind not in "iu" or ("scale_factor" not in self.attrs and stated is None)):
            raise ValueError(f"{self.label} is {self.array.dtype}; floating-point {unit} are needed")
        return self.factor(unit, stated)


Fields = Mapping[str, Field]


def field_of(group: h5py.Group, key: str, path: str | Path) -> Field:
    """A dataset of HDF5; its axes are named by dimension scales, or labels."""
    dataset = group[key]
    axes = tuple((dim[0].name if len(dim) else None) or dim.label for dim in dataset.dims) if dataset.shape else ()
    return Field(dataset, Path(path), f"{(group.name or '').rstrip('/')}/{key}", dataset.attrs, axes)


def read_times(field: Field, stated: float | None = None) -> tuple[float, int, float]:
    """Sampling rate, Hz, number of samples, and time of the first, s, since the epoch if there is one; as ``clock_of``.
    A DataWarning where single precision tells the rate badly."""
    name, counts, kind = field.label, field.values(), field.array.dtype
    if counts.ndim != 1 or len(counts) < 2:
        raise Unwritten(f"{name} has shape {field.shape}; a list of at least two times is needed")
    unit, _, epoch = (field.text("units") or "").partition(" since ")
    factor = si_factor("time", unit or field.text("units"), name) if unit or stated is None else 1.0
    # Dates are far from their epoch; what counts is how far they are from each other.
    origin = counts[0] if epoch else 0
    exact = factor * float(np.spacing(np.abs(counts).max().astype(kind))) if kind.kind == "f" else 0.0
    rate, first = clock_of(factor * (counts - origin).astype(np.float64), name, stated, unit, exact)
    if stated is None and exact * rate > UNIFORMITY:
        tell(
            f"{name} are {kind}, exact to {exact:.1g} s, {exact * rate:.2g} of a step: the rate, {rate:.9g} Hz, is "
            f"known to {exact * rate / len(counts):.1g} of itself; write them in float64, or state sampling_rate=..."
        )
    return rate, len(counts), first + factor * float(origin)


@dataclass(frozen=True)
class Source:
    """What a file or dataset holds: fields by name, /group/name, attributes, and how it is opened again."""

    path: Path
    fields: Fields
    attrs: Mapping[str, Any]
    opens: Opener


def hdf5_source(file: h5py.Group, path: Path) -> Source:
    """All datasets of an HDF5 file but those that stand for the length of a dimension alone; a ValueError where a link
    leads nowhere."""
    found: dict[str, Field] = {}
    groups, seen = [file], {file}  # a function that calls itself would keep the file open
    for group in groups:
        for key in filter(lambda key: is_there(group, key, path), group):
            if isinstance(group[key], h5py.Dataset):
                each = field_of(group, key, path)
                found |= {} if each.bare else {each.name: each}
            elif isinstance(group[key], h5py.Group) and group[key] not in seen:
                seen.add(group[key])
                groups.append(group[key])
    return Source(path, found, file.attrs, partial(hold_open, path))


def references_of(fields: Fields) -> dict[str, complex]:
    """Impedances known from elsewhere, by name."""
    found = {}
    for name, one in fields.items():
        if named := re.fullmatch(r"(/reference_(.*)_)(resistance|reactance)", name):
            both = [fields.get(named[1] + end) for end in ("resistance", "reactance")]
            value = complex(*(math.nan if each is None else each.number("1") for each in both))
            if not np.isfinite(value):
                raise ValueError(f"{one.label} and its other part are {value}, nan if missing; restore or remove them")
            found[one.text("label") or named[2].replace("_", " ")] = value
    return found


def time_axis(field: Field, samples: int) -> int:
    """0 or -1, from the dimension 'time' or from the lengths; a ValueError where neither or both fit."""
    shape, axes = field.shape, [axis.rpartition("/")[2] for axis in field.axes]
    fits = [i for i in (0, -1) if shape and shape[i] == samples and ("time" not in axes or axes[i] == "time")]
    turned = [each for each in axes if each in ("z", "x")] == ["x", "z"]
    if len(fits) != 1 + (len(shape) == 1) or len(shape) > 3 or turned:
        raise ValueError(
            f"{field.label} has shape {shape} and dimensions {tuple(axes)}, but there are {samples} times; (time, z, x)"
            " or (time, probe) is needed, time first or last, marked by the dimension scale 'time' where both fit"
        )
    return fits[0]


class VariableVelocity(Stored):
    """The velocity of one variable, read by slabs by whoever ``opens`` its file again.

    ``order``: its axes, time first, then those of the probes; of axes left out one value is taken. ``factor``: to m/s.
    ``part``: of the variable by axis, where not all of it is read.
    """

    def __init__(
        self, each: Field, opens: Opener, order: tuple[int, ...], factor: float, part: dict[int, slice] | None = None
    ) -> None:
        self.path, self.key, self.label, self.packing = each.path, each.name.lstrip("/"), each.label, each.packing()
        self.opens, self.order, self.factor, self.part = opens, order, factor, part or {}
        self.shape = (*(each.shape[i] for i in order[1:]), each.shape[order[0]])
        require_memory(16 * math.prod(self.shape[:-1]), f"{each.label}, {each.shape}: one sample, read ahead,")
        stored = each.array.dtype
        wide = stored.itemsize > (4 if stored.kind == "f" else 2)  # than float32 holds exactly
        self.dtype = torch.float64 if wide else torch.float32
        self.size = each.path.stat().st_size if each.path.is_file() else 0  # when it was opened
        self.files = (each.path,) if each.path.exists() else ()
        self.held: Any = None

    def __getstate__(self) -> dict[str, Any]:
        """Handles do not travel to other processes; each opens its own."""
        return {**self.__dict__, "held": None}

    def fill(self, begin: int, end: int, out: Tensor) -> None:
        """As ``Stored.fill``; an OSError where the file has become shorter since it was opened."""
        try:
            self._require_whole()  # where a map of it would end the process
            self._fill(begin, end, out.numpy())
            self._require_whole()  # where HDF5 fills in zeros and says nothing
        except (OSError, RuntimeError) as error:
            raise OSError(f"{self.label} cannot be read from sample {begin} to {end}: {error}") from error
        if self.factor != 1:
            out.mul_(self.factor)

    def _fill(self, begin: int, end: int, out: np.ndarray) -> None:
        with naming(self.path):
            self.held = self.held or self.opens()
            array = self.held[self.key]
        time, plain = self.order[0], self.packing == PLAIN and [*self.order] == sorted(self.order) and not self.part
        if plain and time == 0 and isinstance(array, h5py.Dataset):
            array.read_direct(out.reshape(-1, *array.shape[1:]), source_sel=np.s_[begin:end])
            return
        part = self.part | {time: slice(begin, end)}
        stored = np.asarray(array[tuple(part.get(i, slice(None)) for i in range(len(array.shape)))])
        single = tuple(i for i in range(stored.ndim) if i not in self.order)
        stored = stored.transpose(*self.order, *single).reshape(out.shape)
        np.copyto(out, self.packing.unpack(stored.astype(stored.dtype.newbyteorder("="), copy=False), out.dtype))

    def _require_whole(self) -> None:
        if self.size and self.path.exists() and (now := self.path.stat().st_size) < self.size:
            raise OSError(f"the file shrank from {self.size} to {now} bytes; nothing of it can be used")
