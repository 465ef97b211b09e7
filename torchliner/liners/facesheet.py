"""The perforated plate at vanishing amplitude."""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.fluid import Fluid


def end_correction(radius: Tensor, porosity: Tensor) -> Tensor:
    """Correction length eps_e of one side, m. Source: eq. (2.2b)."""
    return 0.85 * radius * (1 - 1.14 * torch.sqrt(porosity))


def facesheet_impedance(
    omega: Tensor, thickness: Tensor, radius: Tensor, porosity: Tensor, fluid: Fluid
) -> Tensor:
    """Linear impedance of a perforate, normalised: first two terms of eq. (2.2a).

    Args:
        omega: rad/s, > 0, real, any shape.  thickness, radius: L_p and r_p, m.
        porosity: phi_p, that of the plate in front of the cavity.  fluid: gas.
    Source: Roncen et al. (2026), eq. (2.2a-c), after Atalla & Sgard (2007).
    """
    extra = end_correction(radius, porosity)
    surface_resistance = torch.sqrt(fluid.dynamic_viscosity * omega * fluid.density)
    viscous = surface_resistance / (fluid.characteristic_impedance * porosity)
    viscous = viscous * (2 * thickness / radius + 4 * extra / radius) / 2**0.5
    mass = (2 * extra + thickness) / (fluid.sound_speed * porosity) * omega
    return torch.complex(viscous, viscous + mass)
