r"""The educed reflection as a sum over velocity levels: one pass over the data for any liner.

For a given record the educed reflection is linear in the response: with the levels v_l of the grid,
their interpolation and the window's lines q,

    R_educed = sum_q sum_l W[q, l] R(f_q, v_l) + E,

where W is gathered from the data once, and E is what the ends of the record and the interpolation
between levels add. E is taken from one whole replay with the liner at hand (``anchored``), so the
sum is exact there, and near it off by the change of E alone: some 1e-3 of the change of R.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.conversions import (
    admittance_from_reflection,
    mean_impedance,
    reflection_from_impedance,
)
from torchliner.liners.model import LinerModel
from torchliner.liners.response import impedance_of
from torchliner.names import ORDERS
from torchliner.replay.incident import Means
from torchliner.tdibc.engines import tone_sums, with_liner
from torchliner.tdibc.prepared import Prepared

MOST_BYTES = 4 << 30  # of W


@dataclass(frozen=True, eq=False)
class LevelWeights:
    """Whole-liner impedance of one plane as a function of what its liner reflects.

    Args:
        ready: prepared plane.
        order: of averaging.
        lines: Hz, of all frequencies, (L,).
        frequency_of: to which frequency each line belongs, 1 or 0, (F, L).
        weights: W over the sum of the window, complex128, (L, V, C) for C columns.
        remainder: E, (C, F).
    """

    ready: Prepared
    order: str
    lines: Tensor
    frequency_of: Tensor
    weights: Tensor
    remainder: Tensor

    def reflection(self, response: Tensor) -> Tensor:
        """R of every column, (..., C, F), from the model's R at lines and levels, (..., L, V)."""
        sums = torch.einsum("lvc,...lv->...cl", self.weights, response)
        return sums @ self.frequency_of.T + self.remainder

    def impedance(self, response: Tensor) -> Tensor:
        """Z of the liner, (..., F), from the model's R at lines and levels, (..., L, V)."""
        weights = self.ready.cells.weight if self.order == ORDERS[1] else None
        return mean_impedance(admittance_from_reflection(self.reflection(response)), -2, weights)

    def anchored(self, liner: LinerModel) -> LevelWeights:
        """The same with E of ``liner``, from a whole replay."""
        ready = with_liner(self.ready, liner)
        a = Means.of(tone_sums(ready, False, None), ready.window_sums).a.cpu()
        found = a[_columns(ready, self.order)]
        bare = dataclasses.replace(self, remainder=torch.zeros_like(found))
        remainder = found - bare.reflection(responses_of(liner, [self])[0])
        return dataclasses.replace(self, ready=ready, remainder=remainder)


def responses_of(liner: LinerModel, planes: Sequence[LevelWeights]) -> list[Tensor]:
    """R of the model at the lines and levels of each plane, (L, V); the model is asked once."""
    lines = torch.cat([plane.lines for plane in planes])[:, None]
    speeds = [plane.ready.grid.speeds.expand(len(plane.lines), -1) for plane in planes]
    found = reflection_from_impedance(impedance_of(liner, lines, torch.cat(speeds)))
    return list(found.split([len(plane.lines) for plane in planes]))


def _columns(ready: Prepared, order: str) -> Tensor:
    """Those that the order averages over, as indices."""
    probes = ready.plane.probes
    if order == ORDERS[0]:
        return ready.used.nonzero()[:, 0]
    if order == ORDERS[2]:
        return probes + ready.cells.count + ready.in_cells.nonzero()[:, 0]
    return torch.arange(probes, probes + ready.cells.count)


def level_weights(ready: Prepared, order: str) -> LevelWeights:
    """Gather W in one pass over the data; ``anchored`` has to follow.

    Args:
        ready: prepared plane, phase rule ``averaged``.
        order: of averaging, one of ``ORDERS``.
    Raises:
        ValueError: W would take more than 4 GiB.
    """
    record, grid, device = ready.record, ready.grid, ready.drive.device
    frequency = ready.frequency.tolist()
    lines = [record.line_frequencies(f)[0] for f in frequency]
    owner = torch.repeat_interleave(torch.tensor([len(each) for each in lines]))
    group = ORDERS.index(order)
    width, count = ready.drive.widths[group], len(owner)
    size = 16 * count * grid.levels * width
    if size > MOST_BYTES:
        raise ValueError(
            f"{ready.plane.name}: the level weights of {width} probes at {len(frequency)} "
            f"frequencies take {size / 1e9:.3g} GB; use order='velocity first', fewer frequencies "
            "or fewer levels"
        )
    weights = torch.zeros(count, grid.levels * width, dtype=torch.complex128, device=device)
    column = torch.arange(width, device=device)
    bounds = ready.drive.bounds()
    for (begin, end), slab in zip(bounds, ready.drive.slabs(bounds), strict=True):
        index, nodes = grid.locate(slab[group].speed.to(torch.float64))
        amounts = torch.cat([record.line_weights(f, begin, end) for f in frequency], dim=1)
        amounts = amounts.to(device)
        for step, node in enumerate(nodes):
            place = ((index + step) * width + column).flatten()
            for line in range(count):
                weights[line].index_add_(0, place, (amounts[:, line, None] * node).flatten())
    weights = weights.reshape(count, grid.levels, width).cpu() / ready.window_sums.zero.cpu()
    if order != ORDERS[1]:
        weights = weights[:, :, ready.used if order == ORDERS[0] else ready.in_cells]
    belongs = torch.nn.functional.one_hot(owner, len(frequency)).T.to(torch.complex128)
    at = torch.tensor([f for each in lines for f in each], dtype=torch.float64)
    nothing = torch.zeros(weights.shape[2], len(frequency), dtype=torch.complex128)
    return LevelWeights(ready, order, at, belongs, weights, nothing)


def driving_speed(ready: Prepared, order: str) -> float:
    """rms over the record and the columns of the |v| that drives the model, m/s."""
    seen, columns = ready.survey, _columns(ready, order).to(ready.survey.mean_square.device)
    square = seen.mean_square[columns]
    if ready.chosen.mean == "removed":
        square = square - seen.mean[columns] ** 2
    return float(square.mean().clamp(min=0).sqrt())
