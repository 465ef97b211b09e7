"""Z of runs by a law, which speeds it is made of, the least squares that fit the law, and its posterior in the bounds.

The posterior is sampled by importance. Proposals come from a mixture: nine in ten from a multivariate t about the best
fit, with the Gauss-Newton covariance held to the size of the box, one in ten uniform over the box, so that no corner is
missed. Each draw carries the weight posterior/proposal; how many independent draws that is worth is reported.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.least_squares import with_slopes
from torchliner.studies.laws import Knots, Law, impedance_at
from torchliner.studies.runs import Run

START = (0.02, 0.98)  # of the box: a start on a bound could not leave it
WITHIN = 0.995  # of a plane's weight lies below the last knot
CREST = 4.0  # times the rms of the fastest column: no |v| that matters is larger
FINE = 60  # steps in sqrt |v| by which the last knot is found
# Degrees of freedom of the t: tails heavier than those of a posterior with stated noise, or with
# five data more than parameters; the uniform draws cover heavier ones.
HEAVY = 4.0
UNIFORM = 0.1  # share of draws from the whole box


def curves_at_nodes(law: Law, values: Tensor, runs: Sequence[Run]) -> Iterator[Tensor]:
    """Z at the frequencies and node speeds of each run, (F, K), differentiable; each liner is asked once."""
    every = torch.cat([run.frequency for run in runs]).unique()
    made: dict[Any, Tensor] = {}
    for run in runs:
        key = (id(run.liner), run.plane.mach, run.nodes)
        if key not in made:
            made[key] = law.curve(values, run.in_flow, every, run.nodes.speeds)
        yield made[key][torch.searchsorted(every, run.frequency)]


def impedances(law: Law, values: Tensor, runs: Sequence[Run]) -> list[Tensor]:
    """Z of each run, (F,), differentiable in the values."""
    return [run.impedance(z) for run, z in zip(runs, curves_at_nodes(law, values, runs), strict=True)]


def drawn_impedances(law: Law, draws: Tensor, runs: Sequence[Run]) -> list[Tensor]:
    """Z of each run for many values, (M, n) to (M, F) each."""
    rows = zip(*(curves_at_nodes(law, values, runs) for values in draws), strict=True)
    return [run.impedance(torch.stack(each)) for run, each in zip(runs, rows, strict=True)]


def residuals_of(law: Law, values: Tensor, runs: Sequence[Run]) -> tuple[Tensor, Tensor]:
    """Residuals of the data and then of the prior, (m,), and their derivatives in the values, (m, n)."""

    def made(at: Tensor) -> Tensor:
        return torch.cat([run.residuals(z) for run, z in zip(runs, impedances(law, at, runs), strict=True)])

    left, by = with_slopes(made, values)
    return torch.cat([left, law.prior @ (values - law.centre)]), torch.cat([by, law.prior])


def solve(law: Law, runs: Sequence[Run]) -> tuple[Tensor, Tensor, Tensor]:
    """Values of least squares, (n,), by trust-region reflective steps (scipy) with the exact Jacobian; and
    ``residuals_of`` them.

    Raises:
        ValueError: fewer data than parameters, a prior counting as one datum each.
        RuntimeError: the least squares do not converge.
    """
    from scipy.optimize import least_squares

    data, count = sum(run.data for run in runs), sum(len(run.frequency) for run in runs)
    if data + len(law.prior) < len(law.names):
        what = "levels and phases" if runs[0].ratio is not None else f"R and X of {count} impedances"
        raise ValueError(
            f"{data} data ({what}) and {len(law.prior)} priors cannot fix {len(law.names)} parameters "
            f"({', '.join(law.names)}); add planes or frequencies, or free fewer"
        )
    width = law.high - law.low
    start = law.low + width * ((law.start - law.low) / width).clamp(*START)

    @functools.lru_cache(maxsize=1)
    def both(place: bytes) -> tuple[Tensor, Tensor]:
        return residuals_of(law, start + width * torch.from_numpy(np.frombuffer(place).copy()), runs)

    def residuals(at: np.ndarray) -> np.ndarray:
        return both(at.tobytes())[0].numpy()

    def jacobian(at: np.ndarray) -> np.ndarray:
        return (both(at.tobytes())[1] * width).numpy()

    low, high = (((end - start) / width).numpy() for end in (law.low, law.high))
    how: Any = {"x_scale": "jac", "max_nfev": 1000} | dict.fromkeys(("xtol", "ftol", "gtol"), law.tolerance)
    found = least_squares(residuals, np.zeros(len(width)), jacobian, bounds=(low, high), **how)
    if not found.success:
        raise RuntimeError(
            f"the least squares do not settle in {found.nfev} evaluations ({found.message}), sum of squares "
            f"{2 * found.cost:.3g}; narrow the bounds, state a larger noise, or free fewer parameters"
        )
    place = np.asarray(found.x, dtype=np.float64)
    return start + width * torch.from_numpy(place), *both(place.tobytes())


def weights_of(run: Run, values: Tensor, knots: Knots) -> Tensor:
    """Share of each spline of a curve in Z of a plane, (F, n), which sum to 1; ``values``: Z at the nodes, (F, K)."""
    at = values.detach().requires_grad_()
    (slopes,) = torch.autograd.grad(run.impedance(at).real.sum(), at)
    found = (slopes @ knots.splines(run.nodes.speeds).to(slopes)).abs()
    return found / found.sum(-1, keepdim=True)


def knots_for(runs: Sequence[Run]) -> Knots:
    """Up to the |v| below which nearly all of every plane's weight lies."""
    square = max(float(run.squares.max()) for run in runs)
    fine, last = Knots(CREST * square**0.5, FINE), 0
    for run in runs:
        curves = torch.stack([impedance_at(run.in_flow, f, run.nodes.speeds) for f in run.frequency])
        below = (weights_of(run, curves, fine).cumsum(-1) < WITHIN).sum(-1)
        last = max(last, int(below.max()))
    return Knots(float(fine.speeds[last]))


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted draws.

    Args:
        draws: values, SI, (M, n), all inside the bounds.
        weights: sum to 1, (M,).
    """

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
