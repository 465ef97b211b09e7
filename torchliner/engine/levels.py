"""Levels of |v| of a kernel table, and the interpolation between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import make_plain, require_choice, require_positive
from torchliner.engine.threads import is_differentiated
from torchliner.names import INTERPOLATIONS, SPACINGS

MOST_LEVELS = 10_000  # with 600 taps such a table takes 50 MB
STENCILS = {"linear": (0, 1), "cubic": (-1, 0, 1, 2)}  # levels, counted from the one below |v|
ROUNDING = 1e-6  # relative: a largest |v| that was found in float32


@dataclass(frozen=True)
class VelocityGrid:
    """Levels of |v| from 0 to ``maximum``, uniform in |v| or in its square root.

    Args:
        maximum: largest |v|, m/s, of a whole data set and never of a batch: the result of a probe must not depend on
            the probes that happen to be computed with it.
        levels: V, 4 to 10 000.
        spacing: ``sqrt`` or ``uniform`` (the paper).
        interpolation: ``cubic`` (local Lagrange polynomials) or ``linear`` (the paper).
    Raises:
        ValueError: a number or a name outside these ranges.
    Source: Roncen et al. (2026), section 3.1: 200 uniform levels, linear. The nonlinear loss starts like |v|^2 and
        turns linear within a small part of the range; levels uniform in the root of |v| resolve that, and the error
        in R falls from 2e-2 to 6e-6 at 20 m/s.
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
            raise ValueError(f"levels is {self.levels}; it must be 4 to {MOST_LEVELS}")

    @property
    def speeds(self) -> Tensor:
        """|v| of each level, m/s, float64, (V,)."""
        steps = torch.arange(self.levels, dtype=torch.float64) / (self.levels - 1)
        return self.maximum * (steps**2 if self.spacing == "sqrt" else steps)

    def locate(self, speed: Tensor) -> tuple[Tensor, list[Tensor]]:
        """First of the levels between which |v| is interpolated (int64), and the weight of each of them.

        Args:
            speed: |v|, m/s, any shape. Beyond ``maximum`` the weights are nan, so that no result comes from
                extrapolated kernels; the data are not read back to the host for a message.
        """
        share = torch.where(speed <= self.maximum * (1 + ROUNDING), speed, torch.nan) / self.maximum
        if self.spacing == "sqrt":
            share = share.clamp(min=1e-30).sqrt()  # not 0, where the derivative of a root is infinite
        place = share * (self.levels - 1)
        nodes = STENCILS[self.interpolation]
        base = place.detach().floor().clamp(-nodes[0], self.levels - 1 - nodes[-1]).nan_to_num(-nodes[0])
        t = place - base
        return base.to(torch.int64) + nodes[0], [t * -1 + 1, t] if self.interpolation == "linear" else _cubic(t)


def _cubic(t: Tensor) -> list[Tensor]:
    """Lagrange polynomials of four levels at -1, 0, 1, 2."""
    below, above, beyond = t + 1, t - 1, t - 2
    inner, outer = t * above, below * beyond
    return [inner * beyond * (-1 / 6), outer * above * 0.5, outer * t * (-0.5), inner * below * (1 / 6)]


def interpolate(table: Tensor, index: Tensor, weights: Sequence[Tensor]) -> Tensor:
    """Rows of a table (V, K) gathered and combined: (..., K).

    Args:
        table: real or complex.
        index: first level of each stencil, (...).
        weights: of the levels of the stencil, (...) each.
    """
    if table.is_complex() or is_differentiated(table, *weights):
        rows = [table[index + i] * weight[..., None].to(table.dtype) for i, weight in enumerate(weights)]
        return torch.stack(rows).sum(0)
    stencils = index.reshape(-1, 1) + torch.arange(len(weights), device=index.device)
    shares = torch.stack([weight.flatten() for weight in weights], dim=1)
    # The same sum without a temporary; it has no forward derivative.
    found = torch.nn.functional.embedding_bag(stencils, table, per_sample_weights=shares, mode="sum")
    return found.unflatten(0, index.shape)
