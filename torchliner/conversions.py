"""Impedance, reflection, admittance, absorption: one definition each.

Convention everywhere: time factor exp(+j omega t), z = p/(rho c v) with v into the liner.
"""

from typing import TypeVar

import torch
from torch import Tensor

from torchliner.checks import require_complex

REFERENCE_PRESSURE = 20e-6  # Pa, rms


def reflection_from_impedance(impedance: Tensor) -> Tensor:
    r"""Plane-wave reflection coefficient of a locally reacting wall, :math:`R = 1 - 2/(z+1)`.

    Args:
        impedance: z = p/(rho c v), normalised, complex, any shape.
    Raises:
        TypeError: if ``impedance`` is real.
    Source: Roncen et al. (2026), eq. (2.9), rearranged so that z = inf gives 1 and not nan.

    >>> complex(tl.reflection_from_impedance(torch.tensor(3 + 0j)))
    (0.5+0j)
    """
    require_complex("impedance", impedance)
    return 1 - 2 / (impedance + 1)


def impedance_from_reflection(reflection: Tensor) -> Tensor:
    """Normalised impedance z = (1 + R)/(1 - R), the inverse of eq. (2.9).

    Args:
        reflection: R, complex, any shape; R = 1 (a rigid wall) gives inf.
    Raises:
        TypeError: if ``reflection`` is real.
    """
    require_complex("reflection", reflection)
    under = 1 - reflection
    zero = under == 0  # where the gradient is 0
    return torch.where(zero, torch.inf, (1 + reflection) / torch.where(zero, 1, under))


def admittance_from_reflection(reflection: Tensor) -> Tensor:
    """Normalised admittance y = (1 - R)/(1 + R): finite at a rigid wall, where z is not."""
    require_complex("reflection", reflection)
    return (1 - reflection) / (1 + reflection)


def impedance_from_admittance(admittance: Tensor) -> Tensor:
    """Normalised impedance 1/y; inf, not nan, where y = 0 (a rigid wall)."""
    require_complex("admittance", admittance)
    zero = admittance == 0  # where the gradient is 0
    return torch.where(zero, torch.inf, torch.ones_like(admittance) / torch.where(zero, 1, admittance))


def mean_impedance(admittance: Tensor, axis: int = 0, weights: Tensor | None = None) -> Tensor:
    """1 over the mean of 1/Z along an axis, as eq. (5.2) averages; inf, not nan, if that is 0.

    Args:
        admittance: 1/Z, normalised, complex.
        axis: of the mean.
        weights: above 0, one for each along the axis; None for equal ones.
    """
    if weights is None:
        return impedance_from_admittance(admittance.mean(axis))
    share = (weights / weights.sum()).to(admittance)
    return impedance_from_admittance((admittance.movedim(axis, -1) * share).sum(-1))


def reflection_from_admittance(admittance: Tensor) -> Tensor:
    """R = (1 - y)/(1 + y), the inverse of ``admittance_from_reflection``."""
    require_complex("admittance", admittance)
    return (1 - admittance) / (1 + admittance)


def absorption_from_reflection(reflection: Tensor) -> Tensor:
    """Share of the incident power absorbed at normal incidence, 1 - |R|^2.

    >>> float(tl.absorption_from_reflection(torch.tensor(0.5 + 0j)))
    0.75
    """
    require_complex("reflection", reflection)
    return 1 - reflection.abs() ** 2


def spl_from_pressure_amplitude(amplitude: Tensor) -> Tensor:
    """Sound pressure level in dB re 20 uPa rms of a tone of peak ``amplitude`` (Pa)."""
    return 20 * torch.log10(amplitude.abs() / (2**0.5 * REFERENCE_PRESSURE))


Level = TypeVar("Level", float, Tensor)


def pressure_amplitude_from_spl(level: Level) -> Level:
    """Peak amplitude (Pa) of a tone of a given sound pressure level, dB re 20 uPa rms."""
    return 2**0.5 * REFERENCE_PRESSURE * 10 ** (level / 20)
