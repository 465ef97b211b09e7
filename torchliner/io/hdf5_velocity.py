"""Velocity that stays in an HDF5 file and is read by slabs."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from torch import Tensor

from torchliner.file_checks import naming, require_memory
from torchliner.io.hdf5 import hold_open
from torchliner.io.plane_format import Stored, exact_type
from torchliner.io.stored_values import Packing, packing_of, require_stored


def numpy_kind(dtype: torch.dtype) -> type:
    """numpy's type of a tensor's."""
    return np.float32 if dtype == torch.float32 else np.float64


def time_part(order: tuple[int, ...], begin: int, end: int) -> tuple[slice, ...]:
    """Samples begin .. end - 1 of an array whose axes are ordered otherwise."""
    return (*[slice(None)] * order[0], slice(begin, end))


def time_first(values: np.ndarray, order: tuple[int, ...]) -> np.ndarray:
    """A view with the axes ``order``; those that are left out have size 1."""
    left_out = tuple(i for i in range(values.ndim) if i not in order)
    return values.transpose(*order, *left_out).squeeze(tuple(range(len(order), values.ndim)))


@dataclass
class H5Velocity(Stored):
    """A velocity dataset that stays on disk; see ``records.StoredVelocity``.

    Args:
        path: of the file.
        key: of the dataset.
        order: axes as of ``cf.Axes``.
        factor: to m/s.
    """

    path: Path
    key: str
    order: tuple[int, ...]
    factor: float
    _file: Any = field(default=None, repr=False)
    _bytes: int = field(default=0, repr=False)
    _packing: Packing = field(default_factory=Packing, repr=False)
    _begin: int | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self.key = self.key.lstrip("/")
        self.label = label = f"{self.path}:/{self.key}"
        dataset = self._dataset()
        require_stored(dataset, label, self.path)
        self._packing = packing_of(dataset, label)
        shape, time = tuple(int(n) for n in dataset.shape), self.order[0]
        self.shape = (*(shape[i] for i in self.order[1:]), shape[time])
        self._plain = time == 0 and list(self.order) == sorted(self.order)
        self.dtype = exact_type(dataset.dtype)
        require_memory(
            2 * self.dtype.itemsize * math.prod(self.shape[:-1]),
            f"{label}, {dataset.shape}: one sample of all probes, read ahead,",
        )
        self.tile_bytes = math.prod(dataset.chunks or (0,)) * dataset.dtype.itemsize
        # Rows of a tile that hold together; a whole probe where time runs fastest.
        tile = None if dataset.chunks is None else int(dataset.chunks[time])
        self.tile_rows = tile or (1 if time == 0 else self.shape[-1])
        self._bytes = self.path.stat().st_size
        self._begin = self._plain_place(dataset)

    def _plain_place(self, dataset: h5py.Dataset) -> int | None:
        """Byte of the file where the values lie as they are read, one sample after another; None
        where they do not, and HDF5 is asked for every slab."""
        kind = np.dtype("f4" if self.dtype == torch.float32 else "f8")
        if not self._plain or dataset.dtype != kind or not hasattr(os, "preadv"):
            return None
        if not os.path.samefile(dataset.file.filename, self.path):  # an external link
            return None
        kept = dataset.id.get_create_plist()
        if kept.get_layout() != h5py.h5d.CONTIGUOUS or kept.get_external_count():
            return None
        place = dataset.id.get_offset()
        return None if place is None else int(place)

    def _read_plain(self, begin: int, out: Tensor) -> None:
        """As HDF5 would, without its copy and its lock: half the time."""
        assert self._begin is not None
        whole: Any = out.numpy()
        values = memoryview(whole).cast("B")
        place = self._begin + begin * out[0].nbytes
        with self.path.open("rb", buffering=0) as file:
            while len(values):
                count = os.preadv(file.fileno(), [values], place)
                if not count and self.path.stat().st_size < self._bytes:
                    return  # which ``read`` says
                if not count:
                    raise OSError("the file ends before")
                values, place = values[count:], place + count

    def _dataset(self) -> h5py.Dataset:
        if self._file is None or not self._file.id.valid:
            self._file = hold_open(self.path)
        return self._file[self.key]

    def __getstate__(self) -> dict[str, Any]:
        """Handles do not travel to other processes; each opens its own."""
        return {**self.__dict__, "_file": None}

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """Samples begin .. end - 1 of every probe, m/s, (t, P).

        Args:
            begin, end: samples.
            out: memory to read into, of the file's precision, at least (end - begin, P).
        Raises:
            OSError: the file cannot be read there, or has become shorter since it was opened.
        """
        with naming(self.path):
            dataset = self._dataset()
        end = min(end, self.shape[-1])
        out = self.rows(begin, end, out)
        try:
            if self._begin is not None:
                self._read_plain(begin, out)
            elif self._plain:
                into = out.numpy().reshape(-1, *dataset.shape[1:])
                dataset.read_direct(into, source_sel=np.s_[begin:end])
            else:
                part = dataset[time_part(self.order, begin, end)]
                np.copyto(out.numpy().reshape(-1, *self.shape[:-1]), time_first(part, self.order))
        except (OSError, RuntimeError) as error:
            raise OSError(f"{self.path}:/{self.key} cannot be read from sample {begin} to {end}: {error}") from error
        # HDF5 fills what lies beyond the end of a file with zeros and says nothing.
        now = self.path.stat().st_size
        if now < self._bytes:
            raise OSError(
                f"{self.path}:/{self.key}: the file shrank from {self._bytes} to {now} bytes while "
                f"it was read (samples {begin} to {end}); nothing of it can be used"
            )
        self._packing.unpack_floats(out.numpy())
        return out if self.factor == 1 else out.mul_(self.factor)
