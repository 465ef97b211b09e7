"""Velocity that stays in its HDF5 file."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from torch import Tensor

from torchliner.io.hdf5 import open_file
from torchliner.records.slabs import slab_bounds


def numpy_kind(out: Tensor) -> type:
    """numpy's type of a tensor."""
    return np.float32 if out.dtype == torch.float32 else np.float64


@dataclass
class H5Velocity:
    """A velocity dataset that stays on disk; see ``records.StoredVelocity``.

    Args:
        path, key: file and dataset.
        time_axis: 0 or -1.
        factor: to m/s.
    """

    path: Path
    key: str
    time_axis: int
    factor: float
    _file: Any = field(default=None, repr=False)
    _bytes: int = field(default=0, repr=False)

    def __post_init__(self) -> None:
        dataset = self._dataset()
        shape = tuple(int(n) for n in dataset.shape)
        self.shape = (*shape[1:], shape[0]) if self.time_axis == 0 else shape
        self.dtype = torch.float32 if dataset.dtype.itemsize <= 4 else torch.float64
        # Rows of a tile that hold together; a whole probe where time runs fastest.
        tile = None if dataset.chunks is None else int(dataset.chunks[self.time_axis])
        self.tile_rows = tile or (1 if self.time_axis == 0 else self.shape[-1])
        self._bytes = self.path.stat().st_size

    def _dataset(self) -> h5py.Dataset:
        if self._file is None or not self._file.id.valid:
            self._file = open_file(self.path)
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
        dataset = self._dataset()
        end = min(end, self.shape[-1])
        rows, probes = end - begin, math.prod(self.shape[:-1])
        if out is None:
            out = torch.empty(rows, probes, dtype=self.dtype)
        out = out[:rows]
        try:
            if self.time_axis == 0:
                into = out.numpy().reshape(rows, *self.shape[:-1])
                dataset.read_direct(into, source_sel=np.s_[begin:end])
            else:
                part = torch.from_numpy(np.asarray(dataset[..., begin:end], dtype=numpy_kind(out)))
                out.copy_(part.reshape(probes, rows).T)
        except OSError as error:
            raise OSError(
                f"{self.path}:/{self.key} cannot be read from sample {begin} to {end}: {error}"
            ) from error
        # HDF5 fills what lies beyond the end of a file with zeros and says nothing.
        now = self.path.stat().st_size
        if now < self._bytes:
            raise OSError(
                f"{self.path}:/{self.key}: the file shrank from {self._bytes} to {now} bytes while "
                f"it was read (samples {begin} to {end}); nothing of it can be used"
            )
        return out if self.factor == 1 else out.mul_(self.factor)

    def load(self) -> Tensor:
        """All of it, (..., T), a view of time-major memory."""
        samples, probes = self.shape[-1], math.prod(self.shape[:-1])
        whole = torch.empty(samples, probes, dtype=self.dtype)
        for begin, end in slab_bounds(samples, probes):
            self.read(begin, end, whole[begin:end])
        return whole.reshape(samples, *self.shape[:-1]).movedim(0, -1)
