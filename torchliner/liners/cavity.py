"""The air column behind the facesheet."""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.liners.bessel import ratio_i2_i0


def cavity_propagation(omega: Tensor, hydraulic_radius: Tensor, fluid: Fluid) -> Tensor:
    """j k_c of eq. (2.2d), 1/m: plane wave with viscous and thermal wall losses.

    Args:
        omega: rad/s, > 0, real, shape (...,).
        hydraulic_radius: r_c, m; D/2 for a square cavity of side D, D between plates D apart.
        fluid: gas.
    """
    root = torch.sqrt(1j * omega)
    one_minus_viscous = ratio_i2_i0(root * (hydraulic_radius / fluid.kinematic_viscosity**0.5))
    thermal = 1 - ratio_i2_i0(root * (hydraulic_radius / fluid.thermal_diffusivity**0.5))
    losses = (1 + (fluid.heat_capacity_ratio - 1) * thermal) / one_minus_viscous
    return 1j * omega / fluid.sound_speed * torch.sqrt(losses)


def cavity_impedance(
    omega: Tensor, depth: Tensor, hydraulic_radius: Tensor, fluid: Fluid
) -> Tensor:
    """coth(j k_c H_c), normalised: a closed cavity seen from its mouth. Last term of (2.2a)."""
    return 1 / torch.tanh(cavity_propagation(omega, hydraulic_radius, fluid) * depth)
