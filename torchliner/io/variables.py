"""Variables of files and datasets, whether h5py, scipy or xarray holds them; their times and coordinates."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import Unwritten
from torchliner.io.clocks import UNIFORMITY, require_same_rate, uniform_rate
from torchliner.io.hdf5 import is_there, text_attribute
from torchliner.io.plane_format import Clock
from torchliner.io.stored_values import Packing, fill_of, packing_of, read_values, require_numbers
from torchliner.units import SI_QUANTITY, require_plausible, si_factor

# How netCDF-4 says that a dimension has a length and no coordinates.
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"
Opener = Callable[[], Mapping[str, Any]]  # picklable: what holds the variables of a file by name


@dataclass(frozen=True, eq=False)
class Field:
    """One variable where it lies: an array of h5py, scipy or xarray; path of the file; name with its groups,
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

    @property
    def packing(self) -> Packing:
        """How the values are stored."""
        fill = fill_of(self.array) if isinstance(self.array, h5py.Dataset) else None
        return packing_of(dict(self.attrs), self.array.dtype, self.label, fill)

    def values(self) -> np.ndarray:
        """All values as they are meant; as ``read_values``."""
        if isinstance(self.array, h5py.Dataset):
            return read_values(self.array, self.label, self.path)
        require_numbers(self.array, self.label)
        stored = np.asarray(self.array[()])
        return self.packing.unpack(stored.astype(stored.dtype.newbyteorder("=")))

    def factor(self, unit: str, stated: str | None = None) -> float:
        """Factor to an SI unit; ``stated``: units, by the user, if the file has none; a ValueError if others."""
        found, quantity = self.text("units"), SI_QUANTITY[unit]
        factor = si_factor(quantity, stated if found is None else found, self.label)
        if stated is not None and si_factor(quantity, stated, "the stated unit") != factor:
            raise ValueError(f"{self.label} is in {found} by its own words, not in {stated}; correct one")
        return factor

    def si(self, unit: str, stated: str | None = None) -> np.ndarray:
        """All values in an SI unit, float64 where the file has another; such as a measurement may have."""
        factor, values = self.factor(unit, stated), self.values()
        values = values if factor == 1 else values.astype(np.float64) * factor
        require_plausible(values, SI_QUANTITY[unit], self.label)
        return values

    def number(self, unit: str) -> float:
        """One number in an SI unit; an array of one counts."""
        if self.size != 1 or self.array.shape is None:
            raise ValueError(f"{self.label} has shape {self.shape}; one number is needed")
        return float(self.si(unit).reshape(()))

    def signal_factor(self, unit: str, stated: str | None = None) -> float:
        """As ``factor``, of a signal: integers count where ``scale_factor`` or the user says what they stand for."""
        kind = self.array.dtype.kind
        if kind != "f" and (kind not in "iu" or ("scale_factor" not in self.attrs and stated is None)):
            raise ValueError(f"{self.label} is {self.array.dtype}; floating-point {unit} are needed")
        return self.factor(unit, stated)


Fields = Mapping[str, Field]


@dataclass(frozen=True)
class Source:
    """What a file or dataset holds: fields by name, /group/name, attributes, and how it is opened again."""

    path: Path
    fields: Fields
    attrs: Mapping[str, Any]
    opens: Opener


def field_of(group: h5py.Group, key: str, path: str | Path) -> Field:
    """A dataset of HDF5; its axes are named by dimension scales, or labels."""
    dataset = group[key]
    axes = tuple((dim[0].name if len(dim) else None) or dim.label for dim in dataset.dims) if dataset.shape else ()
    return Field(dataset, Path(path), f"{(group.name or '').rstrip('/')}/{key}", dataset.attrs, axes)


def fields_of_hdf5(file: h5py.Group, path: Path) -> dict[str, Field]:
    """All datasets of a file by name, but those that stand for the length of a dimension alone; a ValueError where a
    link leads nowhere."""
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
    return found


def references_of(fields: Fields) -> dict[str, complex]:
    """Impedances known from elsewhere, by name."""
    parts: dict[str, dict[str, Field]] = {}
    for name, each in fields.items():
        if named := re.fullmatch(r"/reference_(.*)_(resistance|reactance)", name):
            parts.setdefault(named[1], {})[named[2]] = each
    found = {}
    for name, both in parts.items():
        one = next(iter(both.values()))
        if len(both) < 2:
            raise ValueError(f"{one.label} stands without the other part of its impedance; restore or remove it")
        value = complex(both["resistance"].number("1"), both["reactance"].number("1"))
        if not np.isfinite(value):
            raise ValueError(f"{one.label} and its other part are {value}; repair or remove them")
        found[one.text("label") or name.replace("_", " ")] = value
    return found


def read_times(field: Field, stated: float | None = None) -> tuple[float, int, float, Clock | None]:
    """Sampling rate, Hz, number of samples, time of the first, s, and the epoch that they count from; the rate may be
    ``stated`` where the times have no units, or as they have it.

    Raises:
        ValueError: the times are not finite, not uniform, or of another rate than stated.
    Warns:
        DataWarning: they are rounded so that they tell the rate badly.
    """
    name, shape = field.label, field.shape
    if len(shape) != 1 or shape[0] < 2:
        raise Unwritten(f"{name} has shape {shape}; a list of at least two times is needed")
    unit, _, epoch = (field.text("units") or "").partition(" since ")
    counted = stated is not None and not unit  # whatever they count, evenly
    counts, kind = field.values(), field.array.dtype
    factor = 1.0 if counted else si_factor("time", unit or field.text("units"), name)
    if not epoch and not counted:
        require_plausible(factor * counts, "time", name)
    # Dates are far from their epoch; what counts is how far they are from each other.
    time = factor * (counts - (counts[0] if epoch or counted else 0)).astype(np.float64)
    # Stamps are as exact as their type; the largest is a unit in the last place off, at most.
    exact = factor * float(np.spacing(np.abs(counts).max().astype(kind))) if kind.kind == "f" else 0.0
    rate, length, first = uniform_rate(time, name, exact), time[-1] - time[0], factor * float(counts[0])
    clock = None
    if epoch:
        since = Fraction(counts[0].item()) * Fraction(str(factor))
        clock = (f"{epoch.strip()} {(field.text('calendar') or 'standard').lower()}", since)
    if stated is not None and counted:
        return stated, len(time), first * rate / stated, clock
    require_same_rate(rate, stated, name, unit)
    if stated is not None and abs(stated / rate - 1) * length <= 2 * exact:
        rate = stated  # the stamps cannot tell the two apart
    if stated is None and exact * rate > UNIFORMITY:
        tell(
            f"{name} are {kind}, exact to {exact:.1g} s, {exact * rate:.2g} of a step: the rate, {rate:.9g} Hz, is "
            f"known to {exact / length:.1g} of itself; write them in float64, or state sampling_rate=..."
        )
    return rate, len(time), first, clock


def time_axis(field: Field, samples: int) -> int:
    """0 or -1, from the dimension 'time' or from the lengths; a ValueError where neither or both fit."""
    shape, axes = field.shape, [axis.rpartition("/")[2] for axis in field.axes]
    fits = [i for i in (0, -1) if shape and shape[i] == samples and ("time" not in axes or axes[i] == "time")]
    if len(shape) > 1 and len(fits) == 2:
        raise ValueError(
            f"{field.label} has shape {shape}: first and last axis both fit the {samples} times. Attach the "
            "dimension scale 'time' to the right one"
        )
    if len(shape) not in (1, 2, 3) or not fits or [each for each in axes if each in ("z", "x")] == ["x", "z"]:
        raise ValueError(
            f"{field.label} has shape {shape} and dimensions {tuple(axes)}, but there are {samples} times; (time, z, x)"
            " or (time, probe) is needed, time first or last"
        )
    return fits[0]


def coordinate(field: Field, count: int, stated: str | None = None) -> np.ndarray | None:
    """Places of ``count`` probes, m, in units of the file or ``stated``; None where they number them alone."""
    if field.bare:
        return None
    if field.text("units") == "1" and np.array_equal(field.values(), np.arange(field.size)):
        return None
    values = field.si("m", stated).reshape(-1)
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"{field.label} has {len(values)} values; the probes need {count}, all finite")
    return values
