"""Signals to files, slab by slab: a plane, read once and written once; the reflected signal of every probe as it is
formed (docs/formats.md)."""

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
import torch
from torch import Tensor

from torchliner.io.own_writer import fill, in_memory, make_dimensions, set_texts, write_row, write_times
from torchliner.io.whole_file import HDF5, written_whole
from torchliner.records import VelocityPlane
from torchliner.records.declared import Variable, table_of
from torchliner.records.slabs import read_ahead, slab_bounds

OVERHEAD = 1 << 20  # bytes of HDF5's own indices
VELOCITY = Variable("velocity", "m/s", name="wall_normal_velocity", attributes={"positive": "away from the liner"})
REFLECTED = Variable("reflected")
(AREA,) = table_of(VelocityPlane, "area")


def write_plane(plane: VelocityPlane, path: str | Path, *, progress: Callable[[int], Any] | None = None) -> None:
    """Write a plane to .h5 or .nc, contiguous, as fast as the disk; an old file is replaced when the new one is whole.
    ``progress`` is called with the number of bytes after each slab. An OSError where the disk is full."""
    dims, shape = ("time", *plane.axes["probes"]), (plane.samples, *plane.probe_shape)
    with in_memory() as (buffer, file):
        write_times(file, plane)
        fill(file, plane, unsaid=("velocity", "area"), schema="torchliner plane 1")
        size = _announce(file, VELOCITY, dims, shape, plane.velocity.dtype)
        if plane.area is not None:
            write_row(file, AREA, plane.area.reshape(shape[1:]), plane.axes)
    with _filled_later(path, buffer.getvalue(), size) as open_file:
        bounds = slab_bounds(plane.samples, plane.probes)
        if isinstance(plane.velocity, Tensor):
            whole = plane.velocity.detach().movedim(-1, 0)
            slabs: Iterator[Tensor] = (whole[low:high].cpu() for low, high in bounds)
        else:
            slabs = read_ahead(plane.velocity, bounds, torch.device("cpu"))
        for (low, high), slab in zip(bounds, slabs, strict=True):
            open_file[VELOCITY.names[0]][low:high] = slab.numpy().reshape(high - low, *shape[1:])
            if progress is not None:
                progress(slab.nbytes)


@contextmanager
def reflected_file(
    path: str | Path, plane: VelocityPlane, incident: Tensor, used: Tensor, choices: dict[str, Any]
) -> Iterator[Callable[[Tensor, int], None]]:
    """netCDF-4 with ``incident`` (time) and ``reflected`` (time, probe), in the same unit; nan for probes that are not
    ``used``, (P,). It yields ``store(signal, begin)`` for the samples from ``begin`` on, (t, N); columns beyond the
    probes are averages."""
    with in_memory() as (buffer, file):
        write_times(file, plane)
        set_texts(file, schema="torchliner reflected 1", title=plane.title, choices=choices)
        write_row(file, Variable("incident", dims=("time",)), incident)
        for axis, places in zip("xz", plane.probe_coordinates(), strict=True):
            if places is not None:
                write_row(file, Variable(axis, "m", ("probe",)), places)
        size = _announce(file, REFLECTED, ("time", "probe"), (plane.samples, plane.probes), torch.float32)
    with _filled_later(path, buffer.getvalue(), size) as open_file:

        def store(signal: Tensor, begin: int) -> None:
            part = torch.where(used, signal[:, : plane.probes].detach().cpu(), torch.nan)
            open_file["reflected"][begin : begin + len(part)] = part.numpy()

        yield store


def _announce(file: h5netcdf.File, row: Variable, dims: Sequence[str], shape: Sequence[int], kind: torch.dtype) -> int:
    """A variable without its values yet, and the bytes that they will take."""
    stored = np.dtype(np.float32 if kind == torch.float32 else np.float64)
    make_dimensions(file, row.field, dims, shape)
    set_texts(file.create_variable(row.names[0], dims, stored), units=row.unit, **row.attributes)
    return math.prod(shape) * stored.itemsize


@contextmanager
def _filled_later(path: str | Path, image: bytes, size: int) -> Iterator[h5py.File]:
    """A file that takes the place of an old one when ``size`` bytes of values stand in it. The room for these is taken
    first: HDF5 itself crashes on a full disk, and this is an OSError."""
    with written_whole(path, *HDF5) as temporary:
        temporary.write_bytes(image)
        if hasattr(os, "posix_fallocate"):
            with temporary.open("r+b") as raw:  # HDF5 cuts off what it did not need
                os.posix_fallocate(raw.fileno(), 0, len(image) + size + size // 100 + OVERHEAD)
        with h5py.File(temporary, "r+") as file:
            yield file
