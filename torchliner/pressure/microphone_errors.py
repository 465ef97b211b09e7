r"""Errors of microphones, independent in level and in phase: what they leave of a fit, and draws of them.

Errors of :math:`s_l` nepers and :math:`s_p` radians are a relative error of variance :math:`s_l^2 + s_p^2`, of which a
fit of U complex unknowns to N microphones leaves the share :math:`(N - U)/N`. Where the residual is above what 1 in 20
right models has, the assumed errors are multiplied by the ratio, known from
:math:`\nu = (N - U)(s_l^2 + s_p^2)^2/(s_l^4 + s_p^4)` real degrees of freedom (Satterthwaite 1946); hence each draw has
a ratio of its own, as Student's interval has it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import torch
from scipy.special import chdtri
from torch import Tensor

from torchliner.checks import whole_number

LEVEL_ERROR, PHASE_ERROR = 0.1, 0.1  # dB and degrees, section 5.5.5
POOR = 0.01  # share of right models that are warned of
CONTRADICTED = 0.05  # share of right models whose errors are taken for larger than they are


def largest_misfit(freedom: float, share: float = POOR) -> float:
    """That which only a share of right models exceeds, over its mean of 1; freedom above 0, or inf."""
    return float(chdtri(freedom, share)) / freedom if math.isfinite(freedom) else 1.0


@dataclass(frozen=True)
class MicrophoneErrors:
    """What is assumed of the errors, and how many draws of them an eduction takes.

    Args:
        level_error: standard deviation of the levels, dB, default 0.1; what is used is larger by the root of the misfit
            where the waves leave more than 1 right model in 20.
        phase_error: standard deviation of the phases, degrees, default 0.1; as of the levels.
        draws: of the errors, at least 2 (the paper: 500); default 0, none: intervals to first order.
        generator: of random numbers, on the CPU; default one with seed 0.
    """

    level_error: float = LEVEL_ERROR
    phase_error: float = PHASE_ERROR
    draws: int = 0
    generator: torch.Generator | None = None

    def __post_init__(self) -> None:
        self.require_above(0)
        if whole_number("draws", self.draws) < 0 or self.draws == 1:
            raise ValueError(f"draws is {self.draws}; 0 for none, or at least 2, since one has no deviation")

    def require_above(self, least: float) -> None:
        """Refuse errors below a limit, dB and degrees."""
        for name, value in (("level_error (dB)", self.level_error), ("phase_error (degrees)", self.phase_error)):
            if not least <= value < math.inf:
                raise ValueError(f"{name} is {value:g}; it must be finite and at least {least:g}")

    @property
    def parts(self) -> tuple[float, float]:
        """Nepers and radians."""
        return self.level_error * math.log(10) / 20, math.radians(self.phase_error)

    @property
    def weights(self) -> tuple[float, float]:
        """1 over each."""
        return 1 / self.parts[0], 1 / self.parts[1]

    @property
    def choices(self) -> dict[str, float]:
        """As a result states them."""
        return {"level_error": self.level_error, "phase_error": self.phase_error}

    def freedom(self, spare: int) -> float:
        """nu of N - U spare microphones; inf where nothing can contradict the errors."""
        level, phase = self.parts
        if spare < 1 or level + phase == 0:
            return math.inf
        return spare * (level**2 + phase**2) ** 2 / (level**4 + phase**4)

    def misfit(self, residual: Tensor, microphones: int, unknowns: int) -> Tensor:
        """Squared residual (relative rms of what a fit of U unknowns to N microphones leaves) over that which the
        errors leave: 1 in the mean where all is right; nan without a spare microphone, and for errors of 0."""
        level, phase = self.parts
        expected = (level**2 + phase**2) * (1 - unknowns / microphones)
        return residual.square() / (expected if expected > 0 else math.nan)

    def with_draws(self, result: Any, pressure: Tensor, freedom: float, educed: Callable[[Tensor], Any]) -> Any:
        """An eduction of pressures (..., N, F), if wanted with that (``educed``) of draws of their errors, (D, ..., N,
        F), whose ``error_scale`` has ``freedom`` real degrees of freedom."""
        if not self.draws:
            return result
        source = self.generator or torch.Generator().manual_seed(0)
        drawn = draw_pressures(pressure, self.draws, source, **self.choices, scale=result.error_scale, freedom=freedom)
        about = {**result.choices, "draws": self.draws, "seed": source.initial_seed()}
        return replace(result, draws=educed(drawn), choices=about)


def draw_pressures(
    pressure: Tensor,
    draws: int,
    generator: torch.Generator,
    *,
    level_error: float = LEVEL_ERROR,
    phase_error: float = PHASE_ERROR,
    scale: Tensor | None = None,
    freedom: float = math.inf,
) -> Tensor:
    """Complex pressures (..., N, F) with errors, (D, ..., N, F), as of ``MicrophoneErrors``.

    Args:
        scale: factor of both errors, (..., F); above 1 it was estimated with ``freedom`` real degrees of freedom.
    Source: Roncen et al. (2026), section 5.5.5: 0.1 dB, 0.1 degrees, 500 realisations, no misfit.
    """
    level, phase = MicrophoneErrors(level_error, phase_error).parts
    noise = torch.randn(2, draws, *pressure.shape, generator=generator, dtype=torch.float64)
    if scale is not None and bool((scale > 1).any()):
        own = scale.cpu()
        power = torch.randn(max(1, int(freedom)), draws, *own.shape, generator=generator, dtype=torch.float64)
        noise = noise * torch.where(own > 1, own / power.square().mean(0).sqrt(), own)[..., None, :]
    return pressure * torch.exp(torch.complex(noise[0] * level, noise[1] * phase)).to(pressure.device)
