"""What a format of velocity planes offers, and velocity that stays in its files."""

import math
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.file_checks import machine_memory, require_memory
from torchliner.records.slabs import slab_bounds

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"


@dataclass(frozen=True)
class PlaneRequest:
    """What the user states of files whose own words do not say it; None: the file's, or an error.

    Args:
        variable: name of the velocity in the file, or of the vector it is a component of; default the one that fits.
        group: HDF5 group, netCDF group or block; default all.
        axes: of an array in order: time,z,x or probe,time ...; also y.
        velocity_units: m/s, mm/s ..., where the file has none.
        length_units: of coordinates: m, mm ..., where the file has none.
        sampling_rate: Hz, where the file has no times.
        normal: wall-normal direction of vectors and points: "x", "y" or "z", with "-" where the
            liner lies on the positive side (the velocity is then turned away from it); in a
            command ``--normal=-y``.
        row: which of several heights along an axis of the velocity is taken, from 0.
        wall_normal_component: one value a point, whatever its name, is the velocity along the wall normal.
        x: coordinates along the duct: FILE or FILE:VARIABLE. In Python also an array.
        z: coordinates across the duct, as ``x``.
        points: file of a point list, whose columns are x, y, z, of histories at points.
        overlap: of files of one run that hold the same times with other values, as after a restart from before a
            crash: "later" or "earlier", the values of the file that begins so; "refuse" by default.
    """

    variable: str | None = None
    group: str | None = None
    axes: Sequence[str] | None = None
    velocity_units: str | None = None
    length_units: str | None = None
    sampling_rate: float | None = None
    normal: str | None = None
    row: int | None = None
    wall_normal_component: bool | None = None
    x: Any = None
    z: Any = None
    points: str | Path | None = None
    overlap: str | None = None

    def __post_init__(self) -> None:
        if self.normal is not None and re.fullmatch("[+-]?[xyz]", str(self.normal)) is None:
            raise ValueError(
                f"normal is {self.normal!r}; x, y or z is needed, with '-' where the liner lies on the positive side"
            )

    @property
    def axis_names(self) -> list[str] | None:
        """Those of ``axes``, which may be one text with commas."""
        axes = self.axes.split(",") if isinstance(self.axes, str) else self.axes
        return None if axes is None else [str(axis).strip() for axis in axes]


@dataclass(frozen=True)
class PlaneFormat:
    """One row of the table of formats, ``names.PLANE_FORMATS``.

    Args:
        name: as messages and ``torchliner info`` call it.
        recognises: whether a file or folder is of this format, from its path and its first 4096
            bytes (empty of a folder); by content, not by name; quick, never raises.
        open: the plane of a path, or of the series that the path stands for.
        takes: fields of ``PlaneRequest`` that mean something here; others given are refused.
    """

    name: str
    recognises: Callable[[Path, bytes], bool]
    open: Callable[[Path, PlaneRequest], Any]
    takes: tuple[str, ...] = ()


class Stored:
    """Velocity that is read by slabs; a ``records.StoredVelocity``. A format supplies ``fill``.

    Attributes: ``shape``, (..., T); ``dtype`` of what is read; ``label``, FILE:/variable; ``files``, which must stay as
    they are while they are read.
    """

    shape: tuple[int, ...]
    dtype: torch.dtype
    label: str
    files: tuple[Path, ...] = ()

    def fill(self, begin: int, end: int, out: Tensor) -> None:
        """Samples begin .. end - 1 of every probe, m/s, into (t, P)."""
        raise NotImplementedError

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """Samples begin .. end - 1 of every probe, m/s, (t, P); in ``out`` if one is given."""
        end = min(end, self.shape[-1])
        if out is None:
            out = torch.empty(end - begin, math.prod(self.shape[:-1]), dtype=self.dtype)
        self.fill(begin, end, out[: end - begin])
        return out[: end - begin]

    def load(self) -> Tensor:
        """All of it, (..., T), a view of time-major memory."""
        samples, probes = self.shape[-1], math.prod(self.shape[:-1])
        label = f"{self.label}, {samples} samples of {probes} probes,"
        require_memory(self.dtype.itemsize * samples * probes, label, "read it by slabs (lazy=True)")
        whole = torch.empty(samples, probes, dtype=self.dtype)
        for begin, end in slab_bounds(samples, probes):
            self.read(begin, end, whole[begin:end])
        return whole.reshape(samples, *self.shape[:-1]).movedim(0, -1)


@dataclass
class Imported(Stored):
    """Velocity that was read once, (T, P), m/s, into memory or a temporary file, from text or one file a frame."""

    values: np.ndarray = field(repr=False)
    shape: tuple[int, ...]
    label: str

    def __post_init__(self) -> None:
        self.dtype = torch.float32 if self.values.dtype.itemsize == 4 else torch.float64

    def fill(self, begin: int, end: int, out: Tensor) -> None:
        """As ``Stored.fill``."""
        out.numpy()[:] = self.values[begin:end]


def room(shape: tuple[int, ...], kind: Any) -> np.ndarray:
    """An array to fill: in memory, or in a temporary file where that would take a quarter of it."""
    if math.prod(shape) * np.dtype(kind).itemsize < machine_memory() / 4:
        return np.empty(shape, kind)
    with tempfile.TemporaryFile() as file:  # the map keeps it
        return np.memmap(file, kind, "w+", shape=shape)
