"""What a liner's facesheet is divided into: cells, which probes belong to which, averages over them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.records.case import AtProbes
from torchliner.records.declared import var

WHOLE = 0.9  # share of a pitch that probes must span for a cell to count


@dataclass(frozen=True)
class Cells:
    """Probes sorted into whole cells: -1 of those that are not whole, nan where the plane has no such coordinate."""

    labels: Tensor = var("point", name="cell_of_probe", text="cell of each probe, -1 for none")
    x: Tensor = var("cell", unit="m", name="cell_x", text="streamwise coordinate of the centre of a cell")
    z: Tensor = var("cell", unit="m", name="cell_z", text="spanwise coordinate of the centre of a cell")
    weight: Tensor | None = var("cell", name="cell_weight", text="share of a cell's probes in use", default=None)

    @property
    def count(self) -> int:
        """C."""
        return len(self.x)

    def kept(self, used: Tensor) -> Cells:
        """The cells that hold one of the probes ``used``, (P,), each weighing what it has of them.

        A cell of which nothing is left knows no velocity: counted at 0 it would be a liner at rest.
        """
        inside = self.labels >= 0
        of, left = (torch.bincount(self.labels[which], minlength=self.count) for which in (inside, inside & used))
        there = left > 0
        number = torch.where(there, there.to(torch.int64).cumsum(0) - 1, -1)
        labels = torch.where(inside & used, number[self.labels.clamp(min=0)], -1)
        weight = left[there].to(torch.float64) / of[there]
        alike = bool((weight == weight[:1]).all())
        return Cells(labels, self.x[there], self.z[there], None if alike else weight)

    def average(self, values: Tensor, used: Tensor, axis: int = -2) -> Tensor:
        """Means over the probes ``used`` of each cell: P becomes C on that axis of ``values``."""
        inside = ((self.labels >= 0) & used.cpu()).to(values.device)
        labels = self.labels.to(values.device)[inside]
        members = values.movedim(axis, 0)[inside]
        total = members.new_zeros(self.count, *members.shape[1:]).index_add_(0, labels, members)
        sizes = torch.bincount(labels, minlength=self.count).clamp(min=1)
        return (total / sizes.reshape(-1, *[1] * (total.ndim - 1))).movedim(0, axis)


def sort_into_cells(plane: AtProbes, pitch: float | None) -> Cells:
    """Cells of a plane, or of pressures on it: square tiles of side ``pitch`` (m) counted from the liner's edge.

    The edge is x = 0 (z = 0) if the probes begin before or within a pitch of it, else half a spacing before the first
    probe. Tiles that probes span by less than 0.9 do not count, unless there is no other. Without a pitch or without
    coordinates all probes are one cell.
    """
    tiles = []
    for values in plane.probe_coordinates():
        if values is None:
            nowhere = torch.full((1,), torch.nan, dtype=torch.float64)
            tiles.append((torch.zeros(plane.probes, dtype=torch.int64), nowhere))
            continue
        points = torch.unique(values)
        spacing = float(points.diff().median()) if len(points) > 1 else 0.0
        first, low, high = float(points[0]), float(points[0]) - spacing / 2, float(points[-1]) + spacing / 2
        if pitch is None or high - low < (1 + WHOLE) * pitch:
            centre = torch.tensor([(low + high) / 2], dtype=torch.float64)
            tiles.append((torch.zeros(plane.probes, dtype=torch.int64), centre))
            continue
        start = pitch * math.floor(first / pitch + 1e-9) if first < pitch else low
        index = torch.floor((values - start) / pitch + 1e-9).to(torch.int64)
        edges = start + pitch * torch.arange(int(index.max()) + 1, dtype=torch.float64)
        whole = (edges + pitch).clamp(max=high) - edges.clamp(min=low) >= WHOLE * pitch
        number = torch.where(whole, whole.to(torch.int64).cumsum(0) - 1, -1)
        tiles.append((number[index], (edges + pitch / 2)[whole]))
    (column, x_centres), (row, z_centres) = tiles
    both = (column >= 0) & (row >= 0)
    tile = torch.where(both, row * len(x_centres) + column, torch.full_like(row, -1))
    filled, compact = torch.unique(tile[both], return_inverse=True)
    labels = torch.full((plane.probes,), -1, dtype=torch.int64)
    labels[both] = compact
    return Cells(labels, x_centres[filled % len(x_centres)], z_centres[filled // len(x_centres)])
