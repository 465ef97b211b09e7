"""Which probes make up a cell, in a form that needs no look at the numbers, so that it works on any device."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Membership:
    """Probes by cell.

    Args:
        labels: cell of each probe, int64, (P,); C for probes of no cell.
        places: probes of each cell side by side, padded with probe 0, int64, (C, M).
        inside: 1 for a probe, 0 for padding, float64, (C, M).
        ordered: whether the probes already lie so in memory, all cells alike: no copy is needed.
    """

    labels: Tensor
    places: Tensor
    inside: Tensor
    ordered: bool

    @classmethod
    def of(cls, labels: Tensor, count: int, device: torch.device) -> Membership:
        """From labels on the host, (P,), -1 for no cell, of ``count`` cells that each hold a probe."""
        sizes = torch.bincount(labels[labels >= 0], minlength=count)
        most = int(sizes.max())
        order = torch.argsort(labels, stable=True)[int((labels < 0).sum()) :]
        places, inside = torch.zeros(count, most, dtype=torch.int64), torch.zeros(count, most, dtype=torch.float64)
        cell = labels[order]
        slot = torch.arange(len(order)) - (sizes.cumsum(0) - sizes)[cell]
        places[cell, slot], inside[cell, slot] = order, 1.0
        ordered = bool((places.flatten() == torch.arange(count * most)).all()) and count * most == len(labels)
        outside = torch.where(labels < 0, count, labels)
        return cls(outside.to(device), places.to(device), inside.to(device), ordered)

    @property
    def count(self) -> int:
        """C."""
        return len(self.places)

    @functools.cached_property
    def sizes(self) -> Tensor:
        """Probes of each cell, float64, (C,)."""
        return self.inside.sum(1)

    def members(self, values: Tensor) -> Tensor:
        """Those of each cell side by side, 0 in the padding: (..., P) to (..., C, M)."""
        if self.ordered:
            return values.unflatten(-1, self.places.shape)
        members = values.index_select(-1, self.places.flatten()).unflatten(-1, self.places.shape)
        return members.mul_(self.inside.to(members))

    def sum(self, values: Tensor) -> Tensor:
        """Over the probes of each cell: (..., P) to (..., C)."""
        return self.members(values).sum(-1)

    def mean(self, values: Tensor) -> Tensor:
        """Over the probes of each cell: (..., P) to (..., C)."""
        return self.sum(values) / self.sizes.to(values)

    def spread(self, of_cells: Tensor) -> Tensor:
        """The value of its cell at each probe, 0 at probes of no cell: (..., C) to (..., P)."""
        return torch.nn.functional.pad(of_cells, (0, 1)).index_select(-1, self.labels)
