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

import torch
from torch import Tensor

from torchliner.conversions import impedance_from_admittance, reflection_from_admittance
from torchliner.records import Interval
from torchliner.signals.resampling import Resampling


def admittance_slope(reflection: Tensor) -> Tensor:
    """dY/dR of Y = (1 - R)/(1 + R)."""
    return -2 / (1 + reflection) ** 2


def admittance_bias(reflection: Tensor, moment: Tensor) -> Tensor:
    """E[Y(R + dR)] - Y(R), to second order, for E[dR] = 0 and E[dR^2] = ``moment``."""
    return 2 / (1 + reflection) ** 3 * moment


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

    def add(self, part: slice, deviation: Tensor, bias: Tensor) -> None:
        """Some members: deviation of Y in each block, (S, p, F), and the bias of Y, (p, F)."""
        self.sums.index_add_(1, self.labels[part], self._weighted(deviation, part))
        self.biases.index_add_(0, self.labels[part], self._weighted(bias, part))

    def _weighted(self, values: Tensor, part: slice) -> Tensor:
        """Of some members, (..., p, F)."""
        return values if self.weights is None else self.weights[part] * values

    @functools.cached_property
    def series(self) -> Tensor:
        """Deviation of each group's R in each block, (S, G, F), once all members are added."""
        deviation = self.sums[:, : self.count] / self.sizes
        return deviation / admittance_slope(reflection_from_admittance(self.mean))

    def bias(self, how: Resampling) -> Tensor:
        """Of the mean admittance, (G, F)."""
        own = admittance_bias(reflection_from_admittance(self.mean), how.second_moment(self.series))
        return self.biases[: self.count] / self.sizes - own

    def interval(self, how: Resampling) -> Interval:
        """Over time, (G, F); nan for a group without members, which has no mean."""
        bias = self.bias(how)
        found = how.over_time(self.series, reflection_from_admittance(self.mean - bias))
        found = self.with_bias(found, bias)
        # Not by a factor of nan or 1, which infinite bounds would not survive.
        return found.map(lambda value: torch.where(self.empty, torch.nan, value))

    def with_bias(self, interval: Interval, bias: Tensor) -> Interval:
        """An interval that was formed without the bias of Y, and that bias in Z."""
        value = impedance_from_admittance(self.mean)
        off = value - impedance_from_admittance(self.mean - bias)
        return dataclasses.replace(interval, bias=torch.where(bias == 0, 0, off))
