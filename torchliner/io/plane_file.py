"""One plane, one file: HDF5 that is valid netCDF-4 at once (docs/formats.md).

Dimensions (time, z, x), (time, x) or (time, probe); (probe, time) and contiguous layouts are read
as they are. Numbers beside the velocity are scalar variables with CF units.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.fluid import Fluid
from torchliner.io.hdf5 import (
    get_dataset,
    open_file,
    read_json,
    read_number,
    read_references,
    read_si,
    text_attribute,
    to_json,
    write_dimension,
    write_references,
    write_variable,
    written_whole,
)
from torchliner.io.stored import H5Velocity, numpy_kind
from torchliner.io.units import si_factor
from torchliner.records import VelocityPlane
from torchliner.records.slabs import slab_bounds

SCHEMA = "torchliner plane 1"
VELOCITY, STREAMWISE = "wall_normal_velocity", "streamwise_velocity"
COMPRESSED_ROWS = 256  # samples of a compressed tile
UNIFORMITY = 0.01  # largest error of a time stamp, in sampling intervals

# name -> (quantity, units): scalar variables of the file and attributes of the record
SCALARS = {
    "height": ("length", "m"),
    "frequency": ("frequency", "Hz"),
    "incident_level": ("level", "dB"),
    "mach": ("number", "1"),
    "displacement_thickness": ("length", "m"),
}
FLUID = {
    "sound_speed": ("velocity", "m/s"),
    "density": ("density", "kg/m3"),
    "dynamic_viscosity": ("viscosity", "Pa s"),
    "heat_capacity_ratio": ("number", "1"),
    "prandtl": ("number", "1"),
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
        dims = _write_coordinates(file, plane)
        _write_velocity(file, VELOCITY, plane, dims, compress)
        file[VELOCITY].attrs["positive"] = "away from the liner"
        if plane.streamwise is not None:
            stream = VelocityPlane(plane.streamwise, sampling_rate=plane.sampling_rate)
            _write_velocity(file, STREAMWISE, stream, dims, compress)
        for key, (_, unit) in SCALARS.items():
            if getattr(plane, key) is not None:
                write_variable(file, key, float(getattr(plane, key)), unit)
        for key, (_, unit) in FLUID.items():
            write_variable(file, key, float(getattr(plane.fluid, key)), unit)
        write_references(file, plane.reference)


def _write_coordinates(file: h5py.File, plane: VelocityPlane) -> tuple[str, ...]:
    """Coordinate variables; returns the dimensions after time."""
    shape = plane.probe_shape
    if len(shape) == 2:
        for name, values, count in (("z", plane.z, shape[0]), ("x", plane.x, shape[1])):
            known = values is not None
            write_dimension(
                file, name, values if known else np.arange(count), "m" if known else "1"
            )
        return ("z", "x")
    if len(shape) == 0:
        for name in ("x", "z"):
            if getattr(plane, name) is not None:
                write_variable(file, name, float(getattr(plane, name)), "m")
        return ()
    if plane.z is None and plane.x is not None and bool((plane.x.diff() > 0).all()):
        write_dimension(file, "x", plane.x, "m")
        return ("x",)
    write_dimension(file, "probe", np.arange(shape[0]), "1")
    for name in ("x", "z"):
        if getattr(plane, name) is not None:
            write_variable(file, name, getattr(plane, name), "m", ("probe",))
    return ("probe",)


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
        velocity = get_dataset(file, VELOCITY, path)
        rate, samples = _sampling_rate(file, path)
        axis = _time_axis(velocity, samples, path)
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
        coordinates: dict[str, Any] = {k: _coordinate(file, k, shape, path) for k in ("x", "z")}
        plane = VelocityPlane(
            stored,
            sampling_rate=rate,
            streamwise=stream if lazy or stream is None else stream.load(),
            fluid=_fluid(file, path),
            **coordinates,
            **{k: read_number(file, k, q, path) for k, (q, _) in SCALARS.items() if k in file},
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


def _fluid(file: h5py.File, path: Path) -> Fluid:
    values = {k: read_number(file, k, q, path) for k, (q, _) in FLUID.items() if k in file}
    try:
        return Fluid(**values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _sampling_rate(file: h5py.File, path: Path) -> tuple[float, int]:
    time = read_si(file, "time", "time", path)
    name = f"{path}:/time"
    if time.ndim != 1 or len(time) < 2:
        raise ValueError(f"{name} has shape {time.shape}; a list of at least two times is needed")
    if not np.isfinite(time).all():
        raise ValueError(f"{name} holds {int((~np.isfinite(time)).sum())} values not finite")
    step = (time[-1] - time[0]) / (len(time) - 1)
    if step <= 0:
        raise ValueError(f"{name} does not increase: it runs from {time[0]:g} to {time[-1]:g} s")
    error = np.abs(time - (time[0] + step * np.arange(len(time)))) / step
    if error.max() > UNIFORMITY:
        steps = np.diff(time)
        worst = int(np.abs(steps - step).argmax())
        raise ValueError(
            f"{name} is not uniform: stamps are off by up to {error.max():.3g} sampling intervals "
            f"(limit {UNIFORMITY:g}); the step after sample {worst} is {steps[worst]:.6g} s, "
            f"{step:.6g} s on average. Resample the data to uniform times first"
        )
    return float(1 / step), len(time)


def _time_axis(velocity: h5py.Dataset, samples: int, path: Path) -> int:
    name = f"{path}:/{VELOCITY}"
    shape = velocity.shape
    if len(shape) not in (1, 2, 3):
        raise ValueError(f"{name} has shape {shape}; (time, z, x) or (time, probe) is needed")
    labels = [dim[0].name.split("/")[-1] if len(dim) else "" for dim in velocity.dims]
    if labels[0] == "time" or (labels[-1] != "time" and shape[0] == samples):
        axis = 0
    elif shape[-1] == samples:
        axis = -1
    else:
        raise ValueError(
            f"{name} has shape {shape}, but /time has {samples} values; time is its first or last "
            "axis"
        )
    if labels.count("time") == 0 and shape[0] == shape[-1] and len(shape) > 1:
        raise ValueError(
            f"{name} has shape {shape}: first and last axis both fit the {samples} times. Attach "
            "the dimension scale 'time' to the right one"
        )
    if shape[axis] != samples or "time" in labels[1:-1]:
        raise ValueError(
            f"{name} has shape {shape} with time on axis {labels.index('time')}, /time has "
            f"{samples} values; time is its first or last axis"
        )
    if [label for label in labels if label in ("z", "x")] == ["x", "z"]:
        raise ValueError(f"{name} has dimensions {tuple(labels)}; z comes before x: transpose it")
    return axis


def _coordinate(file: h5py.File, key: str, shape: tuple[int, ...], path: Path) -> np.ndarray | None:
    if key not in file or text_attribute(file[key], "units") == "1":
        return None
    values = read_si(file, key, "length", path).reshape(-1)
    wanted = 1 if not shape else shape[-1] if key == "x" or len(shape) == 1 else shape[0]
    if len(values) != wanted:
        raise ValueError(
            f"{path}:/{key} has {len(values)} values; the velocity's probes, {shape}, need {wanted}"
        )
    return values
