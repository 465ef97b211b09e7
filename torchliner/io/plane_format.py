"""What a format of velocity planes offers, and velocity that such a format leaves in its files."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.file_checks import require_memory
from torchliner.records.holes import Holes
from torchliner.records.slabs import slab_bounds

Clock = tuple[str, Fraction]  # epoch and calendar of times, and the first of them after that, s


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
        holes: places of the holes, for figures: a table x [mm], z [mm], diameter [mm], without z for slits. In
            Python also a ``Holes``.
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
    holes: Holes | str | Path | None = None
    overlap: str | None = None

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
        open: the plane of a path, or of the series that the path stands for, with its velocity
            left in the files (a ``records.StoredVelocity``).
        takes: fields of ``PlaneRequest`` that mean something here; others given are refused.
    """

    name: str
    recognises: Callable[[Path, bytes], bool]
    open: Callable[[Path, PlaneRequest], Any]
    takes: tuple[str, ...] = ()


class Stored:
    """What all velocity that stays in its files shares; a ``records.StoredVelocity``."""

    shape: tuple[int, ...]  # (..., T)
    dtype: torch.dtype
    label: str

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """Samples begin .. end - 1 of every probe, m/s, (t, P); in ``out`` if one is given."""
        raise NotImplementedError

    def rows(self, begin: int, end: int, out: Tensor | None) -> Tensor:
        """Memory for these samples, (t, P)."""
        if out is not None:
            return out[: end - begin]
        return torch.empty(end - begin, math.prod(self.shape[:-1]), dtype=self.dtype)

    def load(self) -> Tensor:
        """All of it, (..., T), a view of time-major memory."""
        samples, probes = self.shape[-1], math.prod(self.shape[:-1])
        require_memory(
            self.dtype.itemsize * samples * probes,
            f"{self.label}, {samples} samples of {probes} probes,",
            "read it by slabs (lazy=True)",
        )
        whole = torch.empty(samples, probes, dtype=self.dtype)
        for begin, end in slab_bounds(samples, probes):
            self.read(begin, end, whole[begin:end])
        return whole.reshape(samples, *self.shape[:-1]).movedim(0, -1)


@dataclass
class FrameVelocity(Stored):
    """Velocity that a format reads by slabs.

    Args:
        source: values of samples begin .. end - 1, (t, ...), as they stand in the file; picklable,
            so that workers read on their own. It may have ``fill(begin, end, out)`` into (t, P).
        shape: (..., T).
        label: FILE:/variable, for messages.
        factor: to m/s.
        dtype: of what is read.
        tile_rows: samples that are best read together.  tile_bytes: of a compressed tile.
        clock: epoch of the times, where they have one.
    """

    source: Any
    shape: tuple[int, ...]
    label: str
    factor: float = 1.0
    dtype: torch.dtype = torch.float32
    tile_rows: int = 1
    tile_bytes: int = field(default=0, repr=False)
    clock: Clock | None = None

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """As ``Stored.read``.

        Raises:
            OSError: the file cannot be read there.
        """
        end = min(end, self.shape[-1])
        out = self.rows(begin, end, out)
        into = out.numpy()
        try:
            if hasattr(self.source, "fill"):
                self.source.fill(begin, end, into)
                return out if self.factor == 1 else out.mul_(self.factor)
            values = np.asarray(self.source(begin, end))
        except FileNotFoundError:
            raise
        except (OSError, RuntimeError) as error:
            raise OSError(f"{self.label} cannot be read from sample {begin} to {end}: {error}") from error
        np.multiply(values.reshape(into.shape), self.factor, out=into, casting="same_kind")
        return out


def exact_type(kind: np.dtype[Any]) -> torch.dtype:
    """float32 where it holds all values of a type, else float64."""
    exact = 4 if kind.kind == "f" else 2  # bytes
    return torch.float32 if kind.itemsize <= exact else torch.float64
