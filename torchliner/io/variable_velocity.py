"""Velocity of one variable that stays where it lies and is read by slabs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from torch import Tensor

from torchliner.file_checks import naming, require_memory
from torchliner.io.plane_format import Clock, Stored
from torchliner.io.stored_values import PLAIN, Packing, require_numbers, require_stored
from torchliner.io.variables import Field, Opener


@dataclass
class VariableVelocity(Stored):
    """Velocity of one variable that stays where it lies.

    Args:
        path, key, opens: file, name of the variable, and the file again, by whoever reads it.
        order: axes of the variable, time first, then those of the probes; of those left out one value is taken.
        part: of the variable by axis, where not all of it is read.
        factor, packing: to m/s, and how the values are stored.
        size: bytes of the file when it was opened; 0 of what is no file.
        held: what ``opens`` gave.
    """

    path: Path
    key: str
    opens: Opener
    order: tuple[int, ...]
    part: dict[int, slice]
    factor: float
    packing: Packing
    size: int
    shape: tuple[int, ...]
    label: str
    dtype: torch.dtype
    clock: Clock | None = None
    held: Any = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self.files = (self.path,) if self.path.exists() else ()

    def __getstate__(self) -> dict[str, Any]:
        """Handles do not travel to other processes; each opens its own."""
        return {**self.__dict__, "held": None}

    def fill(self, begin: int, end: int, out: Tensor) -> None:
        """As ``Stored.fill``; an OSError where the file has become shorter since it was opened."""
        try:
            self._require_whole()  # where a map of it would end the process
            self._fill(begin, end, out.numpy())
            self._require_whole()  # where HDF5 fills in zeros and says nothing
        except FileNotFoundError:
            raise
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


def velocity_of(
    each: Field,
    opens: Opener,
    order: tuple[int, ...],
    factor: float,
    clock: Clock | None = None,
    part: dict[int, slice] | None = None,
) -> VariableVelocity:
    """The velocity of a variable; arguments as of ``VariableVelocity``, errors as of ``require_stored``."""
    require_numbers(each.array, each.label)
    if isinstance(each.array, h5py.Dataset):
        require_stored(each.array, each.label, each.path)
    stored = each.array.dtype
    wide = stored.itemsize > (4 if stored.kind == "f" else 2)  # than float32 holds exactly
    shape = (*(each.shape[i] for i in order[1:]), each.shape[order[0]])
    require_memory(16 * math.prod(shape[:-1]), f"{each.label}, {each.shape}: one sample of all probes, read ahead,")
    return VariableVelocity(
        path=each.path,
        key=each.name.lstrip("/"),
        opens=opens,
        order=order,
        part=part or {},
        factor=factor,
        packing=each.packing,
        size=each.path.stat().st_size if each.path.is_file() else 0,
        shape=shape,
        label=each.label,
        dtype=torch.float64 if wide else torch.float32,
        clock=clock,
    )
