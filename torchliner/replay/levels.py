"""The velocity grid of the kernel tables and the interpolation between its levels."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.autograd import forward_ad

from torchliner.checks import make_plain, require_choice, require_positive
from torchliner.names import INTERPOLATIONS, SPACINGS

MOST_LEVELS = 10_000  # a table of so many takes some 50 MB a tap length of 600
# Nodes of the local Lagrange polynomial, in grid steps from the inner lower level.
STENCILS = {"linear": (0, 1), "cubic": (-1, 0, 1, 2)}


@dataclass(frozen=True)
class VelocityGrid:
    """Levels of |v| from 0 to ``maximum``, uniform in |v| or in sqrt|v|.

    Args:
        maximum: largest |v|, m/s. It is that of a whole data set, or stated; never of a batch, or
            a probe's result would depend on its neighbours in memory.
        levels: number of levels, 4 to 10 000.
        spacing: ``sqrt`` (default) or ``uniform`` (the paper).
        interpolation: ``cubic`` (default, local Lagrange) or ``linear`` (the paper).
    Source: Roncen et al. (2026), section 3.1: 200 uniform levels, linear. With the levels uniform
        in sqrt|v| and cubic interpolation the error in R falls from 1e-2 to 5e-6 at 20 m/s,
        because G_NL starts like |v|^2 and turns linear within a small share of the range.

    >>> tl.VelocityGrid(9.0, levels=4).speeds.tolist()  # m/s, uniform in the root of |v|
    [0.0, 1.0, 4.0, 9.0]
    """

    maximum: float
    levels: int = 200
    spacing: str = "sqrt"
    interpolation: str = "cubic"

    def __post_init__(self) -> None:
        make_plain(self)
        require_positive("velocity_max (m/s)", self.maximum)
        require_choice("level spacing", self.spacing, SPACINGS)
        require_choice("interpolation", self.interpolation, INTERPOLATIONS)
        if not 4 <= self.levels <= MOST_LEVELS:
            raise ValueError(f"levels is {self.levels}; it is 4 to {MOST_LEVELS}")

    @property
    def speeds(self) -> Tensor:
        """|v| of each level, m/s, float64, shape (V,)."""
        steps = torch.arange(self.levels, dtype=torch.float64) / (self.levels - 1)
        return self.maximum * (steps**2 if self.spacing == "sqrt" else steps)

    def locate(self, speed: Tensor) -> tuple[Tensor, list[Tensor]]:
        """First level of the stencil and the weights of its levels.

        Args:
            speed: |v|, m/s, 0 to ``maximum``, any shape.
        Returns:
            index (int64, shape of ``speed``) and one weight tensor per stencil node.
        """
        index, t = self.position(speed / self.maximum)
        return index, lagrange_weights(self.interpolation, t)

    def position(self, share: Tensor) -> tuple[Tensor, Tensor]:
        """First level of the stencil (int64) and place between the inner levels, 0 to 1.

        Args:
            share: |v| over ``maximum``, 0 to 1, any shape.
        """
        place = (share.sqrt() if self.spacing == "sqrt" else share) * (self.levels - 1)
        nodes = STENCILS[self.interpolation]
        base = place.floor().clamp(-nodes[0], self.levels - 1 - nodes[-1])
        return base.to(torch.int64) + nodes[0], place - base


def lagrange_weights(interpolation: str, t: Tensor) -> list[Tensor]:
    """Weights of the stencil's levels at ``t``, in steps from the inner lower one."""
    if interpolation == "linear":
        return [1 - t, t]
    below, above, beyond = t + 1, t - 1, t - 2
    inner, outer = t * above, below * beyond
    return [
        inner * beyond * (-1 / 6),
        outer * above * 0.5,
        outer * t * (-0.5),
        inner * below * (1 / 6),
    ]


def interpolate(table: Tensor, index: Tensor, weights: list[Tensor]) -> Tensor:
    """Rows of ``table`` (V, ...) gathered and combined at ``index`` (...)."""
    extra = (1,) * (table.ndim - 1)
    total: Tensor | None = None
    for offset, weight in enumerate(weights):
        term = table[index + offset] * weight.reshape(*weight.shape, *extra)
        total = term if total is None else total + term
    assert total is not None
    return total


def gather_rows(table: Tensor, index: Tensor, weights: list[Tensor]) -> Tensor:
    """``interpolate`` for a table of short rows, (V, C), by one fused gather: (N, C).

    Args:
        table: (V, C).
        index: first level of each stencil, (N,).
        weights: one (N,) per stencil node, in the precision of ``table``.
    """
    if carries_gradient(table):  # embedding_bag knows no forward derivative
        return interpolate(table, index, weights)
    nodes = torch.arange(len(weights), device=index.device)
    return torch.nn.functional.embedding_bag(
        index[:, None] + nodes, table, per_sample_weights=torch.stack(weights, dim=1), mode="sum"
    )


def carries_gradient(value: Tensor) -> bool:
    """True if ``value`` requires a gradient or has a tangent of forward differentiation."""
    return value.requires_grad or forward_ad.unpack_dual(value).tangent is not None
