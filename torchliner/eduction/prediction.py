"""What a calibrated liner says of another plane, with the spread of its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.eduction.budget import standard_of
from torchliner.eduction.posterior import Posterior


@dataclass(frozen=True, eq=False)
class Prediction:
    """Whole-liner impedance with its posterior spread.

    Args:
        frequency: Hz, (F,).
        impedance: at the best values, complex, (F,).
        draws: at each draw of the posterior, (M, F); None without one.
        posterior: the weights of the draws.
    """

    frequency: Tensor
    impedance: Tensor
    draws: Tensor | None
    posterior: Posterior | None

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
        """By how many standard deviations R and X lie off a known impedance, signed.

        Args:
            truth: normalised impedance.
            noise: its own standard uncertainty u(R) + j u(X), added in quadrature.
            index: of the frequency.
        """
        away, spread = complex(self.impedance[index]) - truth, complex(self.standard[index])
        parts = (
            (away.real, spread.real, noise.real),
            (away.imag, spread.imag, noise.imag),
        )
        first, second = (d / max((s * s + u * u) ** 0.5, 1e-300) if s == s else s
                         for d, s, u in parts)  # fmt: skip
        return complex(first, second)
