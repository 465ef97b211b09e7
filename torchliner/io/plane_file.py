"""One plane, one file: HDF5 that is valid netCDF-4 at once (docs/formats.md).

Dimensions (time, z, x), (time, x) or (time, probe); (probe, time) and contiguous layouts are read
as they are. Numbers beside the velocity are scalar variables with CF units.
"""

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
from torchliner.io.axes import (
    find_time_axis,
    float_factor,
    read_case,
    read_coordinate,
    read_times,
    write_case,
    write_coordinates,
    write_times,
)
from torchliner.io.hdf5 import (
    attach_scales,
    get_dataset,
    hold_open,
    is_there,
    open_file,
    text_attribute,
    tiles,
)
from torchliner.io.stored_values import Packing, packing_of, require_stored
from torchliner.io.tables import FileKind, numbers
from torchliner.records import VelocityPlane
from torchliner.records.slabs import slab_bounds

KIND = FileKind(
    "torchliner plane 1", "velocity plane",
    {"title": "", "source_side": "unknown", "liner": "", "provenance": {}},
)  # fmt: skip
VELOCITY, STREAMWISE = "wall_normal_velocity", "streamwise_velocity"
COMPRESSED_ROWS = 256  # samples of a compressed tile
UNITS = {"height": "m", "frequency": "Hz", "incident_level": "dB", "mach": "1",
         "displacement_thickness": "m"}  # fmt: skip
NUMBERS = numbers(UNITS)


def write_plane(plane: VelocityPlane, path: str | Path, compress: bool = False) -> None:
    """Write a plane; the old file, if any, is replaced only when the new one is whole.

    Args:
        plane: record.
        path: .h5 or .nc.
        compress: gzip in tiles (smaller, slower); default contiguous, as fast as the disk.
    Raises:
        ValueError: a single sample: a file's sampling rate is that of its times.
    """
    with KIND.created(path, plane) as file:
        write_times(file, plane)
        dims = write_coordinates(file, plane.probe_shape, plane.x, plane.z)
        _write_velocity(file, VELOCITY, plane, dims, compress)
        file[VELOCITY].attrs["positive"] = "away from the liner"
        if plane.streamwise is not None:
            stream = VelocityPlane(plane.streamwise, sampling_rate=plane.sampling_rate)
            _write_velocity(file, STREAMWISE, stream, dims, compress)
        write_case(file, plane, NUMBERS)


def _write_velocity(
    file: h5py.File, name: str, plane: VelocityPlane, dims: tuple[str, ...], compress: bool
) -> None:
    """Slab by slab, as the plane may be larger than memory."""
    shape = (plane.samples, *(len(file[dim]) for dim in dims))
    storage = tiles(shape, COMPRESSED_ROWS) if compress else {}
    dataset = file.create_dataset(name, shape, numpy_kind(plane.velocity), **storage)
    dataset.attrs["units"] = "m/s"
    attach_scales(dataset, file, ("time", *dims))
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
        if not is_there(file, VELOCITY, path) and schema.startswith("torchliner "):
            raise ValueError(
                f"{path} is no velocity plane but a file of schema {schema!r}"
                + ("; use torchliner insitu" if "pressure" in schema else "")
            )
        velocity = get_dataset(file, VELOCITY, path)
        rate, samples = read_times(file, path)
        axis = find_time_axis(velocity, samples, path)
        stored = _stored(file, VELOCITY, axis, path)
        stream = None
        if is_there(file, STREAMWISE, path):
            if get_dataset(file, STREAMWISE, path).shape != velocity.shape:
                raise ValueError(
                    f"{path}:/{STREAMWISE} has shape {file[STREAMWISE].shape}, /{VELOCITY} "
                    f"{velocity.shape}; they share probes and times"
                )
            stream = _stored(file, STREAMWISE, axis, path)
        plane = VelocityPlane(
            stored,
            sampling_rate=rate,
            x=read_coordinate(file, "x", stored.shape[:-1], path),
            z=read_coordinate(file, "z", stored.shape[:-1], path),
            streamwise=stream if lazy or stream is None else stream.load(),
            name=f"{path}:/{VELOCITY}",
            **read_case(file, KIND, NUMBERS, path),
        )
    return plane if lazy else plane.load()


def _stored(file: h5py.File, key: str, axis: int, path: Path) -> H5Velocity:
    return H5Velocity(path, key, axis, float_factor(file, key, "m/s", path))


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
    _packing: Packing = field(default_factory=Packing, repr=False)
    _begin: int | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        dataset, label = self._dataset(), f"{self.path}:/{self.key}"
        require_stored(dataset, label, self.path)
        self._packing = packing_of(dataset, label)
        shape = tuple(int(n) for n in dataset.shape)
        self.shape = (*shape[1:], shape[0]) if self.time_axis == 0 else shape
        exact = 4 if dataset.dtype.kind == "f" else 2  # bytes that float32 holds without a loss
        self.dtype = torch.float32 if dataset.dtype.itemsize <= exact else torch.float64
        require_memory(
            2 * self.dtype.itemsize * math.prod(self.shape[:-1]),
            f"{label}, {dataset.shape}: one sample of all probes, read ahead,",
        )
        self.tile_bytes = math.prod(dataset.chunks or (0,)) * dataset.dtype.itemsize
        # Rows of a tile that hold together; a whole probe where time runs fastest.
        tile = None if dataset.chunks is None else int(dataset.chunks[self.time_axis])
        self.tile_rows = tile or (1 if self.time_axis == 0 else self.shape[-1])
        self._bytes = self.path.stat().st_size
        self._begin = self._plain_place(dataset)

    def _plain_place(self, dataset: h5py.Dataset) -> int | None:
        """Byte of the file where the values lie as they are read, one sample after another; None
        where they do not, and HDF5 is asked for every slab."""
        kind = np.dtype("f4" if self.dtype == torch.float32 else "f8")
        if self.time_axis != 0 or dataset.dtype != kind or not hasattr(os, "preadv"):
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
        rows, probes = end - begin, math.prod(self.shape[:-1])
        if out is None:
            out = torch.empty(rows, probes, dtype=self.dtype)
        out = out[:rows]
        try:
            if self._begin is not None:
                self._read_plain(begin, out)
            elif self.time_axis == 0:
                into = out.numpy().reshape(rows, *self.shape[:-1])
                dataset.read_direct(into, source_sel=np.s_[begin:end])
            else:
                part = torch.from_numpy(np.asarray(dataset[..., begin:end], dtype=numpy_kind(out)))
                out.copy_(part.reshape(probes, rows).T)
        except (OSError, RuntimeError) as error:
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
        self._packing.unpack_floats(out.numpy())
        return out if self.factor == 1 else out.mul_(self.factor)

    def load(self) -> Tensor:
        """All of it, (..., T), a view of time-major memory."""
        samples, probes = self.shape[-1], math.prod(self.shape[:-1])
        require_memory(
            self.dtype.itemsize * samples * probes,
            f"{self.path}:/{self.key}, {samples} samples of {probes} probes,",
            "read it by slabs (lazy=True)",
        )
        whole = torch.empty(samples, probes, dtype=self.dtype)
        for begin, end in slab_bounds(samples, probes):
            self.read(begin, end, whole[begin:end])
        return whole.reshape(samples, *self.shape[:-1]).movedim(0, -1)
