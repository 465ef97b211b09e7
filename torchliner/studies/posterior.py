"""The posterior of a fit inside its bounds, by importance sampling.

Proposals come from a mixture: nine in ten from a multivariate t about the best fit, with the Gauss-Newton covariance
held to the size of the box, one in ten uniform over the box, so that no corner is missed. Each draw carries the weight
posterior/proposal; how many independent draws that is worth is reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

# Degrees of freedom of the t: tails heavier than those of a posterior with stated noise, or with five data more than
# parameters; the uniform draws cover heavier ones.
HEAVY = 4.0
UNIFORM = 0.1  # share of draws from the whole box


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted draws: values, SI, (M, n), all inside the bounds; weights, which sum to 1, (M,)."""

    draws: Tensor
    weights: Tensor

    @property
    def effective(self) -> float:
        """Number of independent draws these are worth, 1/sum w^2."""
        return float(1 / self.weights.square().sum())

    def covariance(self, values: Tensor) -> Tensor:
        """Of real (M, n), (n, n)."""
        away = values - self.weights @ values
        return torch.einsum("m,mi,mj->ij", self.weights, away, away)

    def quantiles(self, values: Tensor, shares: tuple[float, ...]) -> Tensor:
        """Of real (M, n), (shares, n)."""
        how = {"axis": 0, "weights": self.weights.numpy(), "method": "inverted_cdf"}
        return torch.from_numpy(np.quantile(values.numpy(), shares, **how))  # type: ignore[call-overload]


def sample_posterior(
    log_density: Callable[[Tensor], Tensor], best: Tensor, precision: Tensor, draws: int, seed: int
) -> Posterior:
    """Draws in the unit box; those of the proposals that fall outside do not count.

    Args:
        log_density: of (M, n) in the unit box, up to a constant, (M,).
        best: centre of the proposals, (n,).
        precision: inverse of the Gauss-Newton covariance, (n, n).
    """
    generator, size = torch.Generator().manual_seed(seed), len(best)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    # No wider than the box: + 1 in the precision.
    factor = torch.linalg.cholesky(precision + torch.eye(size, dtype=torch.float64))
    normal = torch.randn(draws, size, generator=generator, dtype=torch.float64)
    squares = torch.randn(draws, int(HEAVY), generator=generator, dtype=torch.float64)
    away = torch.linalg.solve_triangular(factor.T, normal.T, upper=True).T
    heavy = best + away * (HEAVY / squares.square().sum(1))[:, None].sqrt()
    proposals = torch.where(uniform(draws)[:, None] < UNIFORM, uniform(draws, size), heavy)
    proposals = proposals[((proposals >= 0) & (proposals <= 1)).all(1)]
    distance = ((proposals - best) @ factor).square().sum(1)
    log_heavy = (
        math.lgamma((HEAVY + size) / 2)
        - math.lgamma(HEAVY / 2)
        - size / 2 * math.log(HEAVY * math.pi)
        + float(factor.diagonal().log().sum())
        - (HEAVY + size) / 2 * torch.log1p(distance / HEAVY)
    )
    proposed = torch.logaddexp(log_heavy + math.log(1 - UNIFORM), torch.tensor(math.log(UNIFORM)))
    return Posterior(proposals, torch.softmax(log_density(proposals) - proposed, dim=0))
