r"""Mean admittances over groups of probes: how they deviate in each block, and their bias.

A group is treated as one reflector, R_G with Y(R_G) = <Y_p>, whose R deviates by
:math:`\langle Y'_p\,dR_p\rangle/Y'(R_G)` to first order; the rest is as for a probe, nonlinear in
the group's own deviation. What each probe scatters by itself leaves no scatter in a large group but
a bias, since Y is not linear: :math:`\langle Y''_p E[dR_p^2]\rangle/2`, of which the group's own,
:math:`Y''(R_G) E[dR_G^2]/2`, is no bias but part of its scatter: for probes that all see the same
the difference vanishes, and the group is as a single probe.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.conversions import impedance_from_admittance, reflection_from_admittance
from torchliner.records import Interval
from torchliner.signals.bootstrap import SHORTEST_RUN, beyond_runs, correlation_of
from torchliner.signals.resampling import Resampling, Scatter


def admittance_slope(reflection: Tensor) -> Tensor:
    """dY/dR of Y = (1 - R)/(1 + R)."""
    return -2 / (1 + reflection) ** 2


def admittance_bias(reflection: Tensor, moment: Tensor) -> Tensor:
    """E[Y(R + dR)] - Y(R), to second order, for E[dR] = 0 and E[dR^2] = ``moment``."""
    return 2 / (1 + reflection) ** 3 * moment


@dataclass(frozen=True)
class Members:
    """What some of the members bring.

    Args:
        part: of all members.
        deviation: of Y in each block, (S, p, F).
        bias: of Y, from the shortest runs alone, (p, F).
        pairs: sums over the deviation's blocks of |d|^2 and of neighbours' products, (2, p, F).
    """

    part: slice
    deviation: Tensor
    bias: Tensor
    pairs: Tensor

    @classmethod
    def of(
        cls, part: slice, reflection: Tensor, series: Tensor, scatter: Scatter,
        excluded: Tensor | None = None,
    ) -> Members:  # fmt: skip
        """From R, (p, F), its deviations, (S, p, F), and their scatter; ``excluded`` ones, (p, F),
        add nothing."""
        slope = admittance_slope(reflection)
        bias = admittance_bias(reflection, scatter.short)
        if excluded is not None:
            slope, bias = torch.where(excluded, 0, slope), torch.where(excluded, 0, bias)
        return cls(part, slope * series, bias, slope.abs().square() * scatter.pairs)


class Groups:
    """Running sums over the members of G groups."""

    def __init__(
        self, labels: Tensor, count: int, admittance: Tensor, blocks: int,
        weights: Tensor | None = None,
    ) -> None:  # fmt: skip
        """``labels`` 0 to G - 1, -1 for members of none, (P,); ``admittance`` Y, (P, F);
        ``weights`` of the members, (P,), None for equal ones."""
        device = admittance.device
        self.count = count
        self.weights = None if weights is None else weights.to(device)[:, None]
        admittance = self._weighted(admittance, slice(None))
        # One group more takes what belongs to none.
        self.labels = torch.where(labels >= 0, labels, count).to(device)
        sizes = torch.bincount(self.labels, weights, minlength=count + 1)[:count, None]
        self.empty = sizes == 0
        self.sizes = torch.where(self.empty, 1, sizes)
        shape = (count + 1, admittance.shape[1])
        total = torch.zeros(shape, dtype=torch.complex128, device=device)
        self.mean = total.index_add_(0, self.labels, admittance)[:count] / self.sizes
        self.sums = torch.zeros((blocks, *shape), dtype=torch.complex128, device=device)
        self.biases = torch.zeros(shape, dtype=torch.complex128, device=device)
        self.pairs = torch.zeros(2, shape[1], dtype=torch.float64, device=device)

    def add(self, some: Members) -> None:
        """Some members."""
        labels = self.labels[some.part]
        self.sums.index_add_(1, labels, self._weighted(some.deviation, some.part))
        self.biases.index_add_(0, labels, self._weighted(some.bias, some.part))
        self.pairs += torch.where((labels < self.count)[:, None], some.pairs, 0).sum(1)

    def _weighted(self, values: Tensor, part: slice) -> Tensor:
        """Of some members, (..., p, F)."""
        return values if self.weights is None else self.weights[part] * values

    @functools.cached_property
    def series(self) -> Tensor:
        """Deviation of each group's R in each block, (S, G, F), once all members are added."""
        deviation = self.sums[:, : self.count] / self.sizes
        return deviation / admittance_slope(reflection_from_admittance(self.mean))

    def bias(self, scatter: Scatter) -> Tensor:
        """Of the mean admittance, (G, F), from the scatter of ``series``.

        What lies beyond the shortest runs is that of a first-order process with the correlation of
        all members together: of each by itself it is generous by half in a record of 16 blocks, as
        suits a width, and a bias does not fall with the number of members.
        """
        own = admittance_bias(reflection_from_admittance(self.mean), scatter.short)
        rho = correlation_of(self.pairs, len(self.sums))
        beyond = beyond_runs(rho, torch.full_like(rho, SHORTEST_RUN))
        return beyond * (self.biases[: self.count] / self.sizes - own)

    def interval(self, how: Resampling) -> Interval:
        """Over time, (G, F); nan for a group without members, which has no mean."""
        scatter = how.scatter(self.series)
        bias = self.bias(scatter)
        found = how.interval(scatter, reflection_from_admittance(self.mean - bias))
        found = self.with_bias(found, bias)
        # Not by a factor of nan or 1, which infinite bounds would not survive.
        return found.map(lambda value: torch.where(self.empty, torch.nan, value))

    def with_bias(self, interval: Interval, bias: Tensor) -> Interval:
        """An interval that was formed without the bias of Y, and that bias in Z."""
        value = impedance_from_admittance(self.mean)
        off = value - impedance_from_admittance(self.mean - bias)
        return dataclasses.replace(interval, bias=torch.where(bias == 0, 0, off))
