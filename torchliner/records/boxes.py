"""Windows over the probes of a plane, and means over each."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.records import VelocityPlane

UNEVEN = 0.01  # of a spacing, by which probes may be off a regular grid


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
        used: probes that take part, (Z, X) bool.
    """

    width: int
    height: int
    used: Tensor

    @property
    def count(self) -> int:
        """W: one at every position."""
        rows, columns = self.used.shape
        return (rows - self.height + 1) * (columns - self.width + 1)

    def mean(self, values: Tensor) -> Tensor:
        """Mean of (..., P) over the used probes of each window, (..., W); nan where none is used."""
        counts = self._sums(self.used.to(values.device, torch.float64))
        return (self._boxed(values) / torch.where(counts > 0.5, counts, torch.nan).flatten()).to(values.dtype)

    def sum(self, values: Tensor) -> Tensor:
        """Of (..., P) over the used probes of each window, (..., W)."""
        return self._boxed(values).to(values.dtype)

    def _boxed(self, values: Tensor) -> Tensor:
        """``sum`` in double precision."""
        wide = values.to(torch.complex128 if values.is_complex() else torch.float64)
        used = self.used.to(values.device)
        return self._sums(torch.where(used, wide.unflatten(-1, used.shape), 0)).flatten(-2)

    def _sums(self, values: Tensor) -> Tensor:
        along = torch.nn.functional.pad(values.cumsum(-1), (1, 0))
        along = along[..., self.width :] - along[..., : -self.width]
        down = torch.nn.functional.pad(along.cumsum(-2), (0, 0, 1, 0))
        return down[..., self.height :, :] - down[..., : -self.height, :]


def windows_of(grid: Grid, length: float, used: Tensor) -> Windows:
    """Windows of ``length`` along x and z (or all of z, where that is shorter).

    Args:
        grid: the probes.
        length: m, at least a spacing; the nearest number of probes is taken, and all rows go with all columns.
        used: (Z, X) bool.
    """
    width = min(grid.columns, max(1, round(length / grid.spacing)))
    height = min(grid.rows, max(1, round(length / grid.row_spacing)))
    if width == grid.columns:
        height = grid.rows
    return Windows(width, height, used)
