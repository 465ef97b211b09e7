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
    """A regular grid of probes: numbers of rows along z and of columns along x, spacings along x and z, m (inf along
    z for a line)."""

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
    rows = shape[0] if len(shape) == 2 else 1
    for axis, wanted in (("x", True), ("z", rows > 1)):
        if wanted and getattr(plane, axis) is None:
            raise ValueError(f"{plane.name} states no {axis}; averaging lengths need the probes' places, in m")
    if len(shape) == 1 and plane.z is not None and bool((plane.z != plane.z[0]).any()):
        raise ValueError(f"{plane.name} holds scattered probes; windows need a line or a (z, x) plane")
    row_spacing = _spacing(plane, "z", plane.z) if rows > 1 else math.inf
    return Grid(rows, shape[-1], _spacing(plane, "x", plane.x), row_spacing)


def _spacing(plane: VelocityPlane, axis: str, values: Tensor | None) -> float:
    assert values is not None
    steps = values.diff()
    middle = float(steps.mean())
    if middle <= 0 or float((steps - middle).abs().max()) > UNEVEN * middle:
        raise ValueError(
            f"{plane.name}: {axis} runs in steps of {1e3 * float(steps.min()):.4g} to {1e3 * float(steps.max()):.4g} "
            "mm; windows need probes in even, rising steps (within 1 %)"
        )
    return middle


@dataclass(frozen=True)
class Windows:
    """Boxes of ``height`` x ``width`` probes, along z and x, that lie wholly inside the plane, one at every position.

    Args:
        used: probes that take part, (Z, X) bool.
    """

    width: int
    height: int
    used: Tensor

    @property
    def count(self) -> int:
        """W."""
        rows, columns = self.used.shape
        return (rows - self.height + 1) * (columns - self.width + 1)

    def mean(self, values: Tensor) -> Tensor:
        """Mean of (..., P) over the used probes of each window, (..., W); nan where none is used."""
        counts = self._sums(self.used.to(values.device, torch.float64)).flatten()
        return (self._boxed(values) / torch.where(counts > 0.5, counts, torch.nan)).to(values.dtype)

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
    """Windows of ``length`` (m, at least a spacing) along x and z, or all of z, where that is shorter; the nearest
    number of probes is taken, and all rows go with all columns. ``used``: (Z, X) bool."""
    width = min(grid.columns, max(1, round(length / grid.spacing)))
    height = grid.rows if width == grid.columns else min(grid.rows, max(1, round(length / grid.row_spacing)))
    return Windows(width, height, used)
