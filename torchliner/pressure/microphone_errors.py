r"""Errors of microphones, independent in level and in phase: what they leave of a fit, and draws of them.

Errors of :math:`s_l` nepers and :math:`s_p` radians are a relative error of variance :math:`s^2 = s_l^2 + s_p^2`. A fit
of U complex unknowns to N microphones leaves the share :math:`(N - U)/N` of it. A residual above that says that the
errors are larger than assumed, or that the waves of the fit are not all there is: either way the assumed errors would
give an interval that is too short. So they are multiplied by the ratio of the two where it contradicts them: where it
is above what 1 in 20 right models has. Below, it is as likely chance, and the errors stay as they are assumed. The
ratio comes from :math:`\nu = (N - U)(s_l^2 + s_p^2)^2/(s_l^4 + s_p^4)` real degrees of freedom (Satterthwaite 1946):
two a microphone where level and phase err alike, one where all the error is in the level. Hence each draw has a ratio
of its own, as Student's interval has it.
"""

from __future__ import annotations

import math

import torch
from scipy.special import chdtri
from torch import Tensor

from torchliner.checks import whole_number

LEVEL_ERROR, PHASE_ERROR = 0.1, 0.1  # dB and degrees, section 5.5.5
POOR = 0.01  # share of right models that are warned of
CONTRADICTED = 0.05  # share of right models whose errors are taken for larger than they are


def require_draws(draws: int) -> None:
    """Refuse a number of draws that has no deviation; 0 is none.

    Raises:
        TypeError, ValueError: no whole number, below 0, or 1.
    """
    if whole_number("draws", draws) < 0 or draws == 1:
        raise ValueError(f"draws is {draws}; 0 for none, or at least 2, since one has no deviation")


def error_parts(level_error: float, phase_error: float) -> tuple[float, float]:
    """dB and degrees as nepers and radians.

    Raises:
        ValueError: an error is not finite or below 0.
    """
    for name, value in (("level_error (dB)", level_error), ("phase_error (degrees)", phase_error)):
        if not 0 <= value < math.inf:
            raise ValueError(f"{name} is {value:g}; it must be finite and at least 0")
    return level_error * math.log(10) / 20, math.radians(phase_error)


def error_freedom(spare: int, level_error: float, phase_error: float) -> float:
    """nu, real degrees of freedom of what errors (dB, degrees) leave.

    Args:
        spare: N - U, microphones less complex unknowns.
    """
    level, phase = error_parts(level_error, phase_error)
    return spare * (level**2 + phase**2) ** 2 / (level**4 + phase**4)


def misfit_of(residual: Tensor, microphones: int, unknowns: int, level_error: float, phase_error: float) -> Tensor:
    """Squared residual over that which the errors leave, of the residual's shape: 1 in the mean where model and errors
    are right; nan without a degree of freedom, and for errors of 0.

    Args:
        residual: rms of what a fit leaves over that of the pressures.
        microphones: N.  unknowns: U, complex.  level_error: dB.  phase_error: degrees.
    """
    level, phase = error_parts(level_error, phase_error)
    expected = (level**2 + phase**2) * (1 - unknowns / microphones)
    return residual.square() / expected if expected > 0 else torch.full_like(residual, math.nan)


def largest_misfit(freedom: float, share: float = POOR) -> float:
    """That which only a share of right models exceeds, over its mean of 1; freedom above 0, or inf."""
    return float(chdtri(freedom, share)) / freedom if math.isfinite(freedom) else 1.0


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
    """Pressures with errors, (D, ..., N, F).

    Args:
        pressure: complex, Pa, (..., N, F).
        draws: D.
        generator: of random numbers, on the CPU.
        level_error: standard deviation of the SPL, dB.
        phase_error: standard deviation of the phase, degrees.
        scale: factor of both errors, (..., F); where it is above 1 it was estimated.
        freedom: real degrees of freedom behind it.
    Raises:
        ValueError: no draw, or an error below 0.
    Source: Roncen et al. (2026), section 5.5.5: 0.1 dB, 0.1 degrees, 500 realisations, no misfit.
    """
    if draws < 1:
        raise ValueError(f"draws is {draws}; at least 1")
    level, phase = error_parts(level_error, phase_error)
    noise = torch.randn(2, draws, *pressure.shape, generator=generator, dtype=torch.float64)
    if scale is not None and bool((scale > 1).any()):
        own = scale.cpu()
        power = torch.randn(max(1, int(freedom)), draws, *own.shape, generator=generator, dtype=torch.float64)
        drawn = torch.where(own > 1, own / power.square().mean(0).sqrt(), own)
        noise = noise * drawn[..., None, :]
    factor = torch.exp(torch.complex(noise[0] * level, noise[1] * phase)).to(pressure.device)
    return pressure * factor
