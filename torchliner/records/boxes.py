"""Windows over a plane's probes, and the velocity averaged over each."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.records import VelocityPlane
from torchliner.records.slabs import slab_bounds

UNEVEN = 0.01  # of a spacing, by which probes may be off a regular grid
BOXED_BYTES = 1 << 28  # of the averaged velocities of one plane and length


@dataclass(frozen=True)
class Grid:
    """A regular grid of probes.

    Args:
        rows, columns: numbers of probes along z and x.
        spacing: along x, m.
        row_spacing: along z, m; inf for a line.
    """

    rows: int
    columns: int
    spacing: float
    row_spacing: float

    @property
    def length(self) -> float:
        """Along x, m: each probe stands for one spacing."""
        return self.columns * self.spacing


def grid_of(plane: VelocityPlane) -> Grid:
    """The grid of a plane.

    Raises:
        ValueError: fewer than two probes along x, no coordinates, or uneven ones.
    """
    shape = plane.probe_shape
    if len(shape) == 0 or shape[-1] < 2:
        raise ValueError(f"{plane.name} has {plane.probes} probe along x; averaging lengths need several")
    if plane.x is None or (len(shape) == 2 and shape[0] > 1 and plane.z is None):
        raise ValueError(
            f"{plane.name} states no {'x' if plane.x is None else 'z'}; averaging lengths need the probes' places, in m"
        )
    if len(shape) == 1 and plane.z is not None and bool((plane.z != plane.z[0]).any()):
        raise ValueError(f"{plane.name} holds scattered probes; windows need a line or a (z, x) plane")
    rows = shape[0] if len(shape) == 2 else 1
    spacing = _spacing(plane, "x", plane.x)
    return Grid(rows, shape[-1], spacing, _spacing(plane, "z", plane.z) if rows > 1 else math.inf)


def _spacing(plane: VelocityPlane, axis: str, values: Tensor) -> float:
    steps = values.diff()
    middle = float(steps.mean())
    if middle <= 0 or float((steps - middle).abs().max()) > UNEVEN * middle:
        raise ValueError(
            f"{plane.name}: {axis} runs in steps of {1e3 * float(steps.min()):.4g} to "
            f"{1e3 * float(steps.max()):.4g} mm; windows need probes in even, rising steps (within "
            "1 %)"
        )
    return middle


@dataclass(frozen=True)
class Windows:
    """Boxes of ``height`` x ``width`` probes that lie wholly inside the plane.

    Args:
        width, height: probes along x and z.
        left, top: first column and row of the windows, (Wx,) and (Wz,); all combinations count.
        used: probes that take part, (Z, X) bool.
    """

    width: int
    height: int
    left: Tensor
    top: Tensor
    used: Tensor

    @property
    def count(self) -> int:
        """Wz x Wx."""
        return len(self.left) * len(self.top)

    def mean(self, values: Tensor) -> Tensor:
        """Mean of (..., Z, X) over the used probes of each window, (..., Wz Wx).

        Sums run in double precision; nan where no probe of a window is used.
        """
        wide = values.to(torch.complex128 if values.is_complex() else torch.float64)
        sums = self._sums(torch.where(self.used, wide, torch.zeros((), dtype=wide.dtype)))
        counts = self._sums(self.used.to(torch.float64))
        nothing = torch.full_like(counts, torch.nan)
        return (sums / torch.where(counts > 0.5, counts, nothing)).flatten(-2)

    def _sums(self, values: Tensor) -> Tensor:
        along = torch.nn.functional.pad(values.cumsum(-1), (1, 0))
        along = along[..., self.left + self.width] - along[..., self.left]
        down = torch.nn.functional.pad(along.cumsum(-2), (0, 0, 1, 0))
        return down[..., self.top + self.height, :] - down[..., self.top, :]


def windows_of(grid: Grid, length: float, used: Tensor, samples: int = 1) -> Windows:
    """Windows of ``length`` along x and z (or all of z, where that is shorter).

    Args:
        grid: the probes.
        length: m, at least a spacing; the nearest number of probes is taken, and all rows go with
            all columns.
        used: (Z, X) bool.
        samples: T, for the limit on memory: every position is taken, or every second, third ...
            if the averaged velocities would pass 256 MB.
    """
    width = min(grid.columns, max(1, round(length / grid.spacing)))
    height = min(grid.rows, max(1, round(length / grid.row_spacing)))
    if width == grid.columns:
        height = grid.rows
    across, down = grid.columns - width + 1, grid.rows - height + 1
    most, step = max(1, BOXED_BYTES // (8 * samples)), 1
    while len(range(0, across, step)) * len(range(0, down, step)) > most:
        step += 1
    return Windows(width, height, torch.arange(0, across, step), torch.arange(0, down, step), used)


def averaged_planes(plane: VelocityPlane, several: Sequence[Windows]) -> list[VelocityPlane]:
    """The velocity averaged over each window, as planes of ``windows.count`` probes.

    The plane is read once, by slabs; what is held is the result.
    """
    rows, columns = several[0].used.shape
    dtype = plane.velocity.dtype
    averaged = [torch.empty(plane.samples, each.count, dtype=dtype) for each in several]
    for begin, end in slab_bounds(plane.samples, plane.probes):
        slab = plane.read(begin, end).cpu().reshape(end - begin, rows, columns)
        for each, windows in zip(averaged, several, strict=True):
            each[begin:end] = windows.mean(slab).to(dtype)
    return [
        dataclasses.replace(plane, velocity=each.T, x=None, z=None, streamwise=None, reference={}) for each in averaged
    ]
