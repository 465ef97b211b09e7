"""Planes to files, slab by slab: the velocity is read once and written once."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

from torchliner.io.hdf5 import attach_scales, set_texts
from torchliner.io.own_writer import fill, write_times
from torchliner.io.tables import write_dimensions, write_row
from torchliner.io.to_plane import KIND
from torchliner.io.whole_file import HDF5, written_whole
from torchliner.records import VelocityPlane
from torchliner.records.declared import Variable, table_of
from torchliner.records.slabs import read_ahead, slab_bounds

OVERHEAD = 1 << 20  # bytes of HDF5's own indices
UNSAID = ("velocity", "streamwise", "sampling_rate", "start", "name")  # of a plane: signals, times and the file's name
SIGNALS = (
    Variable("velocity", "m/s", name="wall_normal_velocity", attributes={"positive": "away from the liner"}),
    Variable("streamwise", "m/s", name="streamwise_velocity"),
)
(AREA,) = table_of(VelocityPlane, "area")


def write_plane(plane: VelocityPlane, path: str | Path, *, progress: Callable[[int], Any] | None = None) -> None:
    """Write a plane, contiguous, as fast as the disk; an old file is replaced only when the new one is whole.

    Args:
        plane: record, in memory or in its files, which are then read once.
        path: .h5 or .nc.
        progress: called with the number of bytes after each slab.
    Raises:
        ValueError: a single sample: a file's sampling rate is that of its times.
        OSError: the disk is full, the folder cannot be written to.
    """
    signals = [(row, value) for row in SIGNALS if (value := getattr(plane, row.field)) is not None]
    with h5py.File.in_memory() as file:
        set_texts(file, **KIND.constants, schema=KIND.schema)
        write_times(file, plane)
        fill(file, plane, unsaid=(*UNSAID, "area"))
        dims, shape = ("time", *plane.axes["probes"]), (plane.samples, *plane.probe_shape)
        for row, value in signals:
            write_dimensions(file, row, dims, shape)
            kind = np.float32 if value.dtype == torch.float32 else np.float64
            dataset = file.create_dataset(row.names[0], shape, kind)
            set_texts(dataset, units=row.unit, **row.attributes)
            attach_scales(dataset, file, dims)
        if plane.area is not None:
            write_row(file, AREA, plane.area.reshape(shape[1:]), plane.axes)
        file.flush()
        image = file.id.get_file_image()
    with written_whole(path, *HDF5) as temporary:
        reserve(temporary, image, sum(math.prod(value.shape) * value.dtype.itemsize for _, value in signals))
        with h5py.File(temporary, "r+") as file:
            for row, value in signals:
                dataset, bounds = file[row.names[0]], slab_bounds(plane.samples, plane.probes)
                for (low, high), slab in zip(bounds, _slabs(value, bounds), strict=True):
                    dataset[low:high] = slab.numpy().reshape(high - low, *dataset.shape[1:])
                    if progress is not None:
                        progress(slab.nbytes)


def reserve(path: Path, image: bytes, size: int) -> None:
    """Write a file without its ``size`` bytes of velocity, and take the room for these: HDF5 itself crashes on a full
    disk, and this is an OSError."""
    path.write_bytes(image)
    if hasattr(os, "posix_fallocate"):
        with path.open("r+b") as file:  # HDF5 cuts off what it did not need
            os.posix_fallocate(file.fileno(), 0, len(image) + size + size // 100 + OVERHEAD)


def _slabs(value: Any, bounds: list[tuple[int, int]]) -> Iterator[torch.Tensor]:
    if isinstance(value, torch.Tensor):
        whole = value.detach().movedim(-1, 0)
        return (whole[low:high].cpu() for low, high in bounds)
    return read_ahead(value, bounds, torch.device("cpu"))
