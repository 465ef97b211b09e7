"""Impedance, reflection, admittance, absorption: one definition each.

Convention everywhere: time factor exp(+j omega t), z = p/(rho c v) with v into the liner.
"""

from typing import Any

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
    """Normalised impedance z = (1 + R)/(1 - R), the inverse of eq. (2.9); R = 1 (a rigid wall) gives inf."""
    require_complex("reflection", reflection)
    under = 1 - reflection
    zero = under == 0  # where the gradient is 0
    return torch.where(zero, torch.inf, (1 + reflection) / torch.where(zero, 1, under))


def admittance_from_reflection(reflection: Tensor) -> Tensor:
    """Normalised admittance y = (1 - R)/(1 + R): finite at a rigid wall, where z is not."""
    require_complex("reflection", reflection)
    return (1 - reflection) / (1 + reflection)


reflection_from_admittance = admittance_from_reflection  # which is its own inverse


def impedance_from_admittance(admittance: Tensor) -> Tensor:
    """Normalised impedance 1/y; inf, not nan, where y = 0 (a rigid wall)."""
    require_complex("admittance", admittance)
    zero = admittance == 0  # where the gradient is 0
    return torch.where(zero, torch.inf, torch.ones_like(admittance) / torch.where(zero, 1, admittance))


def absorption_from_reflection(reflection: Tensor) -> Tensor:
    """Share of the incident power absorbed at normal incidence, 1 - |R|^2.

    >>> float(tl.absorption_from_reflection(torch.tensor(0.5 + 0j)))
    0.75
    """
    return 1 - reflection.abs() ** 2


def spl_from_pressure_amplitude(amplitude: Tensor) -> Tensor:
    """Sound pressure level in dB re 20 uPa rms of a tone of peak ``amplitude`` (Pa)."""
    return 20 * torch.log10(amplitude.abs() / (2**0.5 * REFERENCE_PRESSURE))


def pressure_amplitude_from_spl(level: Any) -> Any:
    """Peak amplitude (Pa) of a tone of a given sound pressure level, dB re 20 uPa rms."""
    return 2**0.5 * REFERENCE_PRESSURE * 10 ** (level / 20)
