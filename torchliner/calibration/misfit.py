r"""The educed reflection as a sum over node speeds: one plane, any liner, no pass over its data;
from it impedances of several planes, and their misfit, as functions of parameters of their liners.

The educed reflection is linear in the response R(f, |v|) of the liner. Interpolated over |v| from
the speeds v_k of a basis, it is

    R_educed = sum_q sum_k W[q, k] R(f_q, v_k),

with the window's lines q (one, f itself, by default) and weights W that follow from the moments of
|v| alone: they are the same for every liner and every frequency.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import admittance_from_reflection, impedance_from_admittance
from torchliner.forward_mode import slopes_of
from torchliner.liners.model import LinerModel
from torchliner.names import ORDERS
from torchliner.reduction.basis import interpolation_error, response_of
from torchliner.reduction.line_means import LineReader
from torchliner.replay.phase_rule import phase_rule
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.prepared import Prepared

WORK_NUMBERS = 1 << 22  # complex, held at once for many draws


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
    """R at the lines and speeds of each plane, (F, Q, K); the model is asked once. The planes share
    a basis and, where they have kernels, these."""
    read = [plane.reader.read for plane in planes]
    lines, place = torch.cat([each.flatten() for each in read]).unique(return_inverse=True)
    values = planes[0].ready.response(liner)(lines, planes[0].reader.basis.speeds)
    rows = values[place].split([each.numel() for each in read])
    return [row.unflatten(0, each.shape) for row, each in zip(rows, read, strict=True)]


def require_plain_tones(chosen: Choices) -> None:
    """Refuse choices that a sum over node speeds does not know.

    Raises:
        ValueError: another engine or phase rule, or walls.
    """
    if chosen.engine != "spectral" or phase_rule(chosen.phase).needs_backward:
        raise ValueError(
            f"a fit replays tones with engine 'spectral', phase 'averaged', not {chosen.engine!r}, {chosen.phase!r}"
        )
    if chosen.wall_filter is not None:
        raise ValueError(
            f"wall_filter is {chosen.wall_filter:g}, and a fit takes all probes for liner: leave "
            "it out, and read a region without the walls"
        )


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


def driving_columns(ready: Prepared, order: str) -> Tensor:
    """Indices in the survey of the columns whose |v| drives the model."""
    group = ORDERS.index(order)
    first = (0, ready.plane.probes, ready.plane.probes + ready.cells.count)[group]
    return first + _columns(ready, order).nonzero()[:, 0].to(ready.survey.mean_square.device)


def driving_speed(ready: Prepared, order: str) -> float:
    """rms over the record and the columns of the |v| that drives the model, m/s."""
    seen, columns = ready.survey, driving_columns(ready, order)
    square = seen.mean_square[columns]
    if ready.chosen.mean == "removed":
        square = square - seen.mean[columns] ** 2
    return float(square.mean().clamp(min=0).sqrt())


@dataclass(frozen=True, eq=False)
class FreeLiners:
    """Planes whose liners share free parameters.

    Args:
        planes: weights of node speeds, one a plane.
        liners: one a plane; the same object where they share one.
        names: of the free parameters, n of them.
    """

    planes: Sequence[SpeedWeights]
    liners: Sequence[LinerModel]
    names: tuple[str, ...]

    def moved(self, values: Any) -> list[LinerModel]:
        """The liners with these values, SI; the same object where they share one."""
        named = dict(zip(self.names, values, strict=True))
        made = {id(liner): liner.with_numbers(named) for liner in self.liners}
        return [made[id(liner)] for liner in self.liners]

    def responses(self, values: Any) -> list[Tensor]:
        """R of each plane's liner at its lines and speeds, (F, Q, K)."""
        moved = self.moved(values)
        shared: dict[Any, list[int]] = {}
        for i, (liner, plane) in enumerate(zip(moved, self.planes, strict=True)):
            alone = None if plane.ready.kernels is None else i
            shared.setdefault((id(liner), plane.reader.basis, alone), []).append(i)
        found: dict[int, Tensor] = {}
        for members in shared.values():
            rows = responses_of(moved[members[0]], [self.planes[i] for i in members])
            found |= dict(zip(members, rows, strict=True))
        return [found[i] for i in range(len(moved))]

    def impedance(self, values: Tensor) -> Tensor:
        """Z of all planes and frequencies, (D,), differentiable in ``values`` (n,)."""
        rows = self.responses(values.unbind())
        return torch.cat([p.impedance(row) for p, row in zip(self.planes, rows, strict=True)])

    def impedances(self, values: Tensor) -> Tensor:
        """The same for many, (M, n) to (M, D), a block of them at a time."""
        work = sum(len(p.reader.frequency) * sum(p.weights.shape) for p in self.planes)
        blocks = []
        for block in values.split(max(1, WORK_NUMBERS // work)):
            rows = zip(*(self.responses(each) for each in block.unbind()), strict=True)
            found = [p.impedance(torch.stack(r)) for p, r in zip(self.planes, rows, strict=True)]
            blocks.append(torch.cat(found, dim=-1))
        return torch.cat(blocks)

    def model_error(self, values: Any) -> float:
        """Largest error in R of the interpolation over |v|, with these values."""
        both = zip(self.planes, self.moved(values), strict=True)
        return max(plane.model_error(liner) for plane, liner in both)


@dataclass(frozen=True, eq=False)
class Misfit(FreeLiners):
    """Residuals over their uncertainties.

    Args:
        low, high: bounds, (n,).  wanted: reference impedances of all planes and frequencies, (D,).
        noise: standard uncertainty of R (real part) and X (imaginary part), (D,).
        prior: mean and standard deviation by parameter.
    """

    low: Tensor
    high: Tensor
    wanted: Tensor
    noise: Tensor
    prior: Mapping[str, tuple[float, float]]

    @property
    def data(self) -> int:
        """How many real numbers the fit is held to, priors apart."""
        return 2 * len(self.wanted)

    def misses(self, impedance: Tensor) -> list[Tensor]:
        """Residuals of the data, each (..., n), from Z (..., D)."""
        away = impedance - self.wanted
        return [away.real / self.noise.real, away.imag / self.noise.imag]

    def values(self, share: Tensor) -> Tensor:
        """SI, from the place in the box, 0 to 1, (..., n)."""
        return self.low + share * (self.high - self.low)

    def residuals(self, values: Tensor, impedance: Tensor) -> Tensor:
        """(..., data + priors) from values (..., n) and Z (..., D)."""
        parts = self.misses(impedance)
        for i, name in enumerate(self.names):
            if name in self.prior:
                mean, spread = self.prior[name]
                parts.append((values[..., i : i + 1] - mean) / spread)
        return torch.cat(parts, dim=-1)

    def slopes(self, share: Tensor) -> tuple[Tensor, Tensor]:
        """Residuals (m,) and their derivatives in the place in the box, (m, n)."""
        at = [each.clone().requires_grad_() for each in share.detach()]
        values = self.values(torch.stack(at))
        rows = self.residuals(values, self.impedance(values))
        columns = [torch.zeros_like(rows) if c is None else c for c in slopes_of(rows, at)]
        return rows.detach(), torch.stack(columns, dim=1)


@dataclass(frozen=True, eq=False)
class ClosureMisfit(Misfit):
    """Held to closure alone: logarithm of implied over known pressure, no reference.

    ``noise`` is that of the level in nepers (real part) and of the phase in rad.

    Args:
        ratios: of each plane, from its Z (..., F); see ``torchliner.tdibc.closure``.
        has_phase: of each plane, whether the phase is known too.
    """

    ratios: Sequence[Callable[[Tensor], Tensor]]
    has_phase: Sequence[bool]

    @property
    def counts(self) -> list[int]:
        """Frequencies of each plane."""
        return [len(plane.ready.frequency) for plane in self.planes]

    @property
    def data(self) -> int:
        """A level each, and a phase where it is known."""
        both = zip(self.counts, self.has_phase, strict=True)
        return sum(count * (2 if phase else 1) for count, phase in both)

    def logarithms(self, impedance: Tensor) -> list[Tensor]:
        """Of each plane, complex, (..., F), from Z (..., D)."""
        parts = impedance.split(self.counts, -1)
        return [ratio(z).log() for ratio, z in zip(self.ratios, parts, strict=True)]

    def misses(self, impedance: Tensor) -> list[Tensor]:
        """Residuals of levels, and of phases where known."""
        found = []
        both = zip(self.logarithms(impedance), self.noise.split(self.counts), strict=True)
        for (away, noise), phase in zip(both, self.has_phase, strict=True):
            found.append(away.real / noise.real)
            if phase:
                found.append(away.imag / noise.imag)
        return found
