"""Posterior of a fit inside its bounds, by importance sampling of the misfit itself.

Proposals come from a mixture: nine in ten from a multivariate t about the best fit, with the
Gauss-Newton covariance held to the size of the box, one in ten uniform over the box, so that no
corner is missed. Each draw carries the weight posterior/proposal; how many independent draws
that is worth is reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.calibration.budget import standard_of

# Degrees of freedom of the t: tails heavier than those of a posterior with stated noise, or with
# five data more than parameters; the uniform draws cover heavier ones.
HEAVY = 4.0
UNIFORM = 0.1  # share of draws from the whole box
FEWEST_EFFECTIVE = 100.0


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted draws.

    Args:
        draws: values, SI, (M, n), all inside the bounds.  weights: sum to 1, (M,).
    """

    draws: Tensor
    weights: Tensor

    @property
    def effective(self) -> float:
        """Number of independent draws these are worth, 1/sum w^2."""
        return float(1 / self.weights.square().sum())

    def mean(self, values: Tensor) -> Tensor:
        """Of (M, ...)."""
        return torch.einsum("m,m...->...", self.weights.to(values.dtype), values)

    def covariance(self, values: Tensor) -> Tensor:
        """Of real (M, n), (n, n)."""
        away = values - self.mean(values)
        return torch.einsum("m,mi,mj->ij", self.weights, away, away)

    def quantiles(self, values: Tensor, shares: tuple[float, ...]) -> Tensor:
        """Of real (M, n), (shares, n)."""
        ordered, order = values.sort(dim=0)
        reached = self.weights[order].cumsum(0)
        rows = [ordered.gather(0, (reached < share).sum(0).clamp(max=len(values) - 1)[None])[0] for share in shares]
        return torch.stack(rows)


def sample_posterior(
    log_density: Callable[[Tensor], Tensor], best: Tensor, precision: Tensor, draws: int, seed: int
) -> Posterior:
    """Draws in the unit box; those of the proposals that fall outside do not count.

    Args:
        log_density: of (M, n) in the unit box, up to a constant, (M,).
        best: centre of the proposals, (n,).
        precision: inverse of the Gauss-Newton covariance, (n, n).
    """
    generator = torch.Generator().manual_seed(seed)
    size = len(best)

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
    weights = torch.softmax(log_density(proposals) - proposed, dim=0)
    return Posterior(proposals, weights)


@dataclass(frozen=True, eq=False)
class Prediction:
    """Whole-liner impedance with its posterior spread.

    Args:
        frequency: Hz, (F,).  impedance: at the best values, complex, (F,).
        before: with the liner's own numbers, (F,).
        draws: at each draw of the posterior, (M, F); None without one.
        posterior: the weights of the draws.  notes: warnings, with numbers.
    """

    frequency: Tensor
    impedance: Tensor
    before: Tensor
    draws: Tensor | None
    posterior: Posterior | None
    notes: tuple[str, ...] = ()

    @property
    def mean(self) -> Tensor:
        """Posterior mean of Z, (F,)."""
        if self.draws is None or self.posterior is None:
            return torch.full_like(self.impedance, complex(torch.nan, torch.nan))
        return self.posterior.mean(self.draws)

    @property
    def covariance(self) -> Tensor:
        """Of R and X, (F, 2, 2); nan without a posterior."""
        if self.draws is None or self.posterior is None:
            return torch.full((len(self.frequency), 2, 2), torch.nan, dtype=torch.float64)
        parts = torch.view_as_real(self.draws)
        return torch.stack([self.posterior.covariance(parts[:, i]) for i in range(parts.shape[1])])

    @property
    def standard(self) -> Tensor:
        """u(R) + j u(X) from the parameters' spread, (F,)."""
        return standard_of(self.covariance)

    def misses(self, truth: complex, noise: complex = 0j, index: int = 0) -> complex:
        """By how many standard deviations R and X lie off a known impedance, signed; its own
        uncertainty ``noise``, u(R) + j u(X), is added in quadrature."""
        away, spread = complex(self.impedance[index]) - truth, complex(self.standard[index])
        parts = ((away.real, spread.real, noise.real), (away.imag, spread.imag, noise.imag))
        first, second = (d / max((s * s + u * u) ** 0.5, 1e-300) if s == s else s
                         for d, s, u in parts)  # fmt: skip
        return complex(first, second)
