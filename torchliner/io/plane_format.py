"""What formats of velocity planes share: what is asked of them, velocity that stays in its files, clocks."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import require_positive
from torchliner.file_checks import Unwritten, require_memory
from torchliner.records.slabs import slab_bounds

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
UNIFORMITY = 0.01  # largest error of a time stamp, in sampling intervals
SAME_RATE = 0.01  # relative: a rate that is stated, and that of the times
DIGITS = 6  # of a time that is printed, at least


@dataclass(frozen=True)
class PlaneRequest:
    """What the user states of files whose own words do not say it; None: the file's, or an error.

    Args:
        variable: name of the velocity in the file, or of the vector it is a component of; default
            wall_normal_velocity, of vectors U or velocity.
        group: block, surface or series, of files of VTK, OpenFOAM and PowerFLOW; default the only one.
        axes: of an array in order: time,z,x or probe,time ...; y where it runs across the duct.
        velocity_units: m/s, mm/s ..., where the file has none.
        length_units: of coordinates: m, mm ..., where the file has none.
        sampling_rate: Hz, where the file has no times.
        normal: wall-normal direction of vectors and points: "x", "y" or "z", with "-" where the
            liner lies on the positive side (the velocity is then turned away from it); in a
            command ``--normal=-y``.
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
    """One row of the table of formats, ``names.PLANE_FORMATS``."""

    name: str  # for messages and ``torchliner info``
    recognises: Callable[[Path, bytes], bool]  # from its first 4096 bytes, none of a folder: quick; an error is a no
    open: Callable[[Path, PlaneRequest], Any]  # the plane of a path, or of the series that the path stands for
    takes: tuple[str, ...] = ()  # fields of ``PlaneRequest`` that mean something here; others are refused


class Stored:
    """Velocity that is read by slabs, a ``records.StoredVelocity``, (..., T); a format supplies ``fill``. ``files``
    must stay as they are meanwhile."""

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


# Clocks


def uniform_rate(time: np.ndarray, name: str, exact: float = 0.0) -> float:
    """Sampling rate, Hz, of time stamps, s, that are rounded by ``exact``, s; ``name`` is for messages. A ValueError
    where they are not finite, out of order, or not uniform, or frames are missing."""
    if not np.isfinite(time).all():
        raise ValueError(f"{name} holds {int((~np.isfinite(time)).sum())} values not finite")
    if len(time) < 2:
        raise Unwritten(f"{name}: there is {len(time)} of them; at least two are needed")
    step = (time[-1] - time[0]) / (len(time) - 1)
    error = np.abs(time - (time[0] + step * np.arange(len(time)))).max()
    if step > 0 and error <= UNIFORMITY * step + min(exact, step / 4):
        return float(1 / step)
    steps = np.diff(time)
    back, usual = int(np.argmin(steps)), float(np.median(steps))
    if steps[back] == 0:
        raise ValueError(
            f"{name}: samples {back} and {back + 1} have the same time, {time[back]:.9g} s: write times with more "
            "digits (OpenFOAM: timePrecision in controlDict)"
        )
    if steps[back] < 0:
        raise ValueError(
            f"{name} is out of order: sample {back + 1} is at {time[back + 1]:.9g} s, after {time[back]:.9g} s; sort "
            "them, or give the runs as files of their own"
        )
    lost = np.rint(steps / usual).astype(int) - 1
    if lost.any() and np.abs(steps - (lost + 1) * usual).max() < 0.1 * usual:
        gap = int((lost > 0).argmax())
        raise ValueError(
            f"{name} lacks {int(lost.sum())} frames, the first {lost[gap]} after sample {gap} ({time[gap]:.9g} s); "
            "restore them, or keep one stretch between the gaps"
        )
    raise ValueError(
        f"{name} is not uniform: stamps are off by up to {error / step:.3g} sampling intervals (limit {UNIFORMITY:g}), "
        f"most after sample {int(np.abs(steps - step).argmax())}; resample to uniform times first"
    )


def clock_of(
    time: np.ndarray, name: str, stated: float | None, unit: str = "", exact: float | None = None
) -> tuple[float, float]:
    """Sampling rate, Hz, and time of the first of uniform stamps, s, rounded by ``exact``, s; default: printed ones.

    A rate that the user has ``stated``, Hz, is that of times without a ``unit``, which count evenly, whatever they
    count. Of times with a unit it must be the rate, to 1 %, and is it where the stamps cannot tell the two apart.
    """
    if exact is None:
        largest = float(np.nanmax(np.abs(time), initial=0.0))
        exact = 10.0 ** (math.floor(math.log10(largest)) + 1 - DIGITS) if 0 < largest < math.inf else 0.0
    found, first = uniform_rate(time, name, exact), float(time[0])
    if stated is None:
        return found, first
    require_positive(f"{name}: sampling_rate (Hz)", stated)
    if not unit:
        return stated, first * found / stated
    if (off := abs(found / stated - 1)) > SAME_RATE:
        raise ValueError(
            f"{name}: its times are at {found:.6g} Hz, sampling_rate states {stated:.6g} Hz; leave "
            f"it out, or correct the unit of the times, {unit}"
        )
    return (stated if off * (time[-1] - time[0]) <= 2 * exact else found), first
