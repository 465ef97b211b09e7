"""Time, coordinates and gas: what our files of signals at probes share (docs/formats.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import h5py
import numpy as np
from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.io.hdf5 import (
    read_number,
    read_si,
    text_attribute,
    write_dimension,
    write_variable,
)

UNIFORMITY = 0.01  # largest error of a time stamp, in sampling intervals
FLUID = {
    "sound_speed": ("velocity", "m/s"),
    "density": ("density", "kg/m3"),
    "dynamic_viscosity": ("viscosity", "Pa s"),
    "heat_capacity_ratio": ("number", "1"),
    "prandtl": ("number", "1"),
}


class Probes(Protocol):
    """Where a record has its probes."""

    @property
    def probe_shape(self) -> tuple[int, ...]:
        """(z, x), (x) or (probe), or ()."""
        ...

    @property
    def x(self) -> Tensor | None:
        """m."""
        ...

    @property
    def z(self) -> Tensor | None:
        """m."""
        ...


def write_coordinates(file: h5py.File, plane: Probes) -> tuple[str, ...]:
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


def write_fluid(file: h5py.File, fluid: Fluid) -> None:
    """The gas as scalar variables."""
    for key, (_, unit) in FLUID.items():
        write_variable(file, key, float(getattr(fluid, key)), unit)


def read_fluid(file: h5py.File, path: Path) -> Fluid:
    """The gas; air at 20 C where the file says nothing."""
    values = {k: read_number(file, k, q, path) for k, (q, _) in FLUID.items() if k in file}
    try:
        return Fluid(**values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def read_times(file: h5py.File, path: Path) -> tuple[float, int]:
    """Sampling rate (Hz) and number of samples.

    Raises:
        ValueError: the times are missing, not finite or not uniform.
    """
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


def find_time_axis(dataset: h5py.Dataset, samples: int, path: Path) -> int:
    """0 or -1, from the dimension scale 'time' or from the lengths.

    Raises:
        ValueError: neither axis fits the times, or both do.
    """
    name = f"{path}:{dataset.name}"
    shape = dataset.shape
    if len(shape) not in (1, 2, 3):
        raise ValueError(f"{name} has shape {shape}; (time, z, x) or (time, probe) is needed")
    labels = [dim[0].name.split("/")[-1] if len(dim) else "" for dim in dataset.dims]
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


def read_coordinate(
    file: h5py.File, key: str, shape: tuple[int, ...], path: Path
) -> np.ndarray | None:
    """x or z, m; None if the file has none."""
    if key not in file or text_attribute(file[key], "units") == "1":
        return None
    values = read_si(file, key, "length", path).reshape(-1)
    wanted = 1 if not shape else shape[-1] if key == "x" or len(shape) == 1 else shape[0]
    if len(values) != wanted:
        raise ValueError(
            f"{path}:/{key} has {len(values)} values; the probes, {shape}, need {wanted}"
        )
    return values
