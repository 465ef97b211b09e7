"""One plane, one file: HDF5 that is valid netCDF-4 at once (docs/formats.md).

Dimensions (time, z, x), (time, x) or (time, probe); (probe, time) and contiguous layouts are read
as they are. Numbers beside the velocity are scalar variables with CF units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from torch import Tensor

from torchliner.io.axes import (
    find_time_axis,
    read_coordinate,
    read_fluid,
    read_times,
    write_coordinates,
    write_fluid,
)
from torchliner.io.hdf5 import (
    get_dataset,
    open_file,
    read_json,
    read_references,
    read_scalars,
    text_attribute,
    to_json,
    write_dimension,
    write_references,
    write_scalars,
    written_whole,
)
from torchliner.records import VelocityPlane
from torchliner.records.slabs import slab_bounds
from torchliner.units import si_factor

SCHEMA = "torchliner plane 1"
VELOCITY, STREAMWISE = "wall_normal_velocity", "streamwise_velocity"
COMPRESSED_ROWS = 256  # samples of a compressed tile

# name -> (quantity, units): scalar variables of the file and attributes of the record
SCALARS = {
    "height": ("length", "m"),
    "frequency": ("frequency", "Hz"),
    "incident_level": ("level", "dB"),
    "mach": ("number", "1"),
    "displacement_thickness": ("length", "m"),
}


def write_plane(plane: VelocityPlane, path: str | Path, compress: bool = False) -> None:
    """Write a plane; the old file, if any, is replaced only when the new one is whole.

    Args:
        plane: record.
        path: .h5 or .nc.
        compress: gzip in tiles (smaller, slower); default contiguous, as fast as the disk.
    Raises:
        ValueError: a single sample: a file's sampling rate is that of its times.
    """
    if plane.samples < 2:
        raise ValueError(f"{plane.name} has 1 sample; at least two times are needed in a file")
    with written_whole(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["Conventions"] = "CF-1.8"
        file.attrs["schema"] = SCHEMA
        for key in ("title", "source_side", "liner"):
            file.attrs[key] = getattr(plane, key)
        file.attrs["provenance"] = to_json(dict(plane.provenance))
        write_dimension(file, "time", np.arange(plane.samples) / plane.sampling_rate, "s")
        dims = write_coordinates(file, plane)
        _write_velocity(file, VELOCITY, plane, dims, compress)
        file[VELOCITY].attrs["positive"] = "away from the liner"
        if plane.streamwise is not None:
            stream = VelocityPlane(plane.streamwise, sampling_rate=plane.sampling_rate)
            _write_velocity(file, STREAMWISE, stream, dims, compress)
        write_scalars(file, plane, SCALARS)
        write_fluid(file, plane.fluid)
        write_references(file, plane.reference)


def _write_velocity(
    file: h5py.File, name: str, plane: VelocityPlane, dims: tuple[str, ...], compress: bool
) -> None:
    shape = (plane.samples, *(len(file[dim]) for dim in dims))
    extra: dict[str, Any] = {}
    if compress:
        chunk = (min(plane.samples, COMPRESSED_ROWS), *(min(n, 64) for n in shape[1:]))
        extra = {"compression": "gzip", "compression_opts": 9, "shuffle": True, "chunks": chunk}
    dataset = file.create_dataset(name, shape, numpy_kind(plane.velocity), **extra)
    dataset.attrs["units"] = "m/s"
    for axis, dim in enumerate(("time", *dims)):
        dataset.dims[axis].attach_scale(file[dim])
    for begin, end in slab_bounds(plane.samples, plane.probes, COMPRESSED_ROWS):
        dataset[begin:end] = (
            plane.read(begin, end).detach().cpu().numpy().reshape(end - begin, *shape[1:])
        )


def read_plane(path: str | Path, lazy: bool = False) -> VelocityPlane:
    """Read a plane written by ``VelocityPlane.write`` or by anyone who follows the schema.

    Args:
        path: HDF5 or netCDF-4 file.
        lazy: leave the velocity in the file, to be read by slabs as it is used.
    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: a dataset is missing, has a wrong shape or no or wrong units, or time is not
            uniform; the message names FILE:/dataset.
    """
    path = Path(path)
    with open_file(path) as file:
        schema = text_attribute(file, "schema") or ""
        if VELOCITY not in file and schema.startswith("torchliner "):
            raise ValueError(
                f"{path} is no velocity plane but a file of schema {schema!r}"
                + ("; use torchliner insitu" if "pressure" in schema else "")
            )
        velocity = get_dataset(file, VELOCITY, path)
        rate, samples = read_times(file, path)
        axis = find_time_axis(velocity, samples, path)
        shape = velocity.shape[1:] if axis == 0 else velocity.shape[:-1]
        stored = _stored(file, VELOCITY, axis, path)
        stream = None
        if STREAMWISE in file:
            if file[STREAMWISE].shape != velocity.shape:
                raise ValueError(
                    f"{path}:/{STREAMWISE} has shape {file[STREAMWISE].shape}, /{VELOCITY} "
                    f"{velocity.shape}; they share probes and times"
                )
            stream = _stored(file, STREAMWISE, axis, path)
        coordinates: dict[str, Any] = {k: read_coordinate(file, k, shape, path) for k in ("x", "z")}
        plane = VelocityPlane(
            stored,
            sampling_rate=rate,
            streamwise=stream if lazy or stream is None else stream.load(),
            fluid=read_fluid(file, path),
            **coordinates,
            **read_scalars(file, SCALARS, path),
            source_side=text_attribute(file, "source_side") or "unknown",
            liner=text_attribute(file, "liner") or "",
            title=text_attribute(file, "title") or path.stem,
            reference=read_references(file, path),
            provenance=read_json(file, "provenance", path, {}),
            name=f"{path}:/{VELOCITY}",
        )
    return plane if lazy else plane.load()


def _stored(file: h5py.File, key: str, axis: int, path: Path) -> H5Velocity:
    dataset, name = file[key], f"{path}:/{key}"
    if dataset.dtype.kind != "f":
        raise ValueError(f"{name} is {dataset.dtype}; floating-point m/s are needed")
    return H5Velocity(
        path, key, axis, si_factor("velocity", text_attribute(dataset, "units"), name)
    )


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
