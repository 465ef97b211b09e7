r"""The educed reflection as a sum over node speeds: one plane, any liner, no pass over its data.

The educed reflection is linear in the response R(f, |v|) of the liner. Interpolated over |v| from
the speeds v_k of a basis, it is

    R_educed = sum_q sum_k W[q, k] R(f_q, v_k),

with the window's lines q (one, f itself, by default) and weights W that follow from the moments of
|v| alone: they are the same for every liner and every frequency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.conversions import admittance_from_reflection, impedance_from_admittance
from torchliner.liners.model import LinerModel
from torchliner.names import ORDERS
from torchliner.reduction.basis import interpolation_error, response_of
from torchliner.reduction.line_means import LineReader
from torchliner.tdibc.prepared import Prepared


@dataclass(frozen=True, eq=False)
class SpeedWeights:
    """Whole-liner impedance of one plane as a function of what its liner reflects.

    Args:
        ready: prepared plane.  order: of averaging.
        weights: W, complex128, (C, Q K) for C columns.
        share: of each column in the mean, complex128, (C,).
    """

    ready: Prepared
    order: str
    weights: Tensor
    share: Tensor

    @property
    def reader(self) -> LineReader:
        """Lines and speeds at which R is asked for."""
        assert self.ready.reader is not None
        return self.ready.reader

    def reflection(self, values: Tensor) -> Tensor:
        """R of every column, (..., F, C), from the model's at lines and speeds, (..., F, Q, K)."""
        return values.flatten(-2) @ self.weights.T

    def impedance(self, values: Tensor) -> Tensor:
        """Z of the liner, (..., F), from the model's R at lines and speeds, (..., F, Q, K)."""
        admittance = admittance_from_reflection(self.reflection(values))
        return impedance_from_admittance(admittance @ self.share)

    def model_error(self, liner: LinerModel) -> float:
        """Largest error in R of the interpolation over |v|, up to the largest of the data."""
        lines, top = self.reader.read.flatten(), self.ready.top_speed
        return interpolation_error(self.reader.basis, response_of(liner), lines, top)[0]


def responses_of(liner: LinerModel, planes: Sequence[SpeedWeights]) -> list[Tensor]:
    """R at the lines and speeds of each plane, (F, Q, K); the model is asked once.

    Args:
        liner: of all planes.  planes: that share a basis and, where they have kernels, these.
    """
    read = [plane.reader.read for plane in planes]
    lines, place = torch.cat([each.flatten() for each in read]).unique(return_inverse=True)
    values = planes[0].ready.response(liner)(lines, planes[0].reader.basis.speeds)
    rows = values[place].split([each.numel() for each in read])
    return [row.unflatten(0, each.shape) for row, each in zip(rows, read, strict=True)]


def _columns(ready: Prepared, order: str) -> Tensor:
    """Of the order's group, those that it averages over, bool."""
    if order == ORDERS[1]:
        return torch.ones(ready.cells.count, dtype=torch.bool)
    return ready.used if order == ORDERS[0] else ready.in_cells


def speed_weights(ready: Prepared, order: str) -> SpeedWeights:
    """W of the columns that an order averages over, one of ``ORDERS``; no data are read."""
    assert ready.reader is not None
    group, columns = ready.sums.groups[ORDERS.index(order)], _columns(ready, order)
    found = ready.reader.weights(group)[..., columns.to(group.totals.device)]
    size = ready.cells.weight if order == ORDERS[1] else None
    size = torch.ones(found.shape[-1], dtype=torch.float64) if size is None else size
    return SpeedWeights(
        ready, order, (found.flatten(0, 1) / ready.window_sums.zero).T.cpu(),
        (size / size.sum()).to(torch.complex128),
    )  # fmt: skip


def driving_speed(ready: Prepared, order: str) -> float:
    """rms over the record and the columns of the |v| that drives the model, m/s."""
    seen, group = ready.survey, ORDERS.index(order)
    first = (0, ready.plane.probes, ready.plane.probes + ready.cells.count)[group]
    columns = first + _columns(ready, order).nonzero()[:, 0].to(seen.mean_square.device)
    square = seen.mean_square[columns]
    if ready.chosen.mean == "removed":
        square = square - seen.mean[columns] ** 2
    return float(square.mean().clamp(min=0).sqrt())
