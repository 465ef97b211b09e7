"""The air column behind the facesheet: a wave with losses in a narrow tube."""

from __future__ import annotations

from typing import Any

import torch
from scipy.special import ive
from torch import Tensor

from torchliner.fluid import Fluid

ASYMPTOTIC_FROM = 1e4  # the first term left out of the series is below 1e-16 there


class _RatioI2I0(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, s: Tensor) -> Tensor:
        host = s.detach().cpu().to(torch.complex128)
        values = host.numpy()
        large = 1 - 2 / host * (1 - 1 / (2 * host) - 1 / (8 * host**2) - 1 / (8 * host**3))
        exact = torch.as_tensor(ive(2, values) / ive(0, values))
        ratio = torch.where(host.abs() > ASYMPTOTIC_FROM, large, exact).to(s.device)
        ctx.save_for_backward(s, ratio)
        ctx.save_for_forward(s, ratio)
        return ratio

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        return gradients[0] * _slope(*ctx.saved_tensors).conj()

    @staticmethod
    def jvp(ctx: Any, *tangents: Tensor) -> Tensor:
        return tangents[0] * _slope(*ctx.saved_tensors)


def _slope(s: Tensor, ratio: Tensor) -> Tensor:
    """From I0' = I1, I2' = I1 - 2 I2/s and I1/I0 = s (1 - ratio)/2; 0 at s = 0."""
    safe = torch.where(s == 0, 1, s)
    slope = s * (1 - ratio) ** 2 / 2 - 2 * ratio / safe
    return torch.where(s == 0, 0, slope)


def ratio_i2_i0(s: Tensor) -> Tensor:
    r"""I2(s)/I0(s) = 1 - Phi(s), the viscous (or thermal) function of a circular tube.

    Args:
        s: r sqrt(j omega/nu), complex128, any shape, Re s >= 0.
    Returns:
        The ratio, 0 at s = 0 and tending to 1; complex128, differentiable once.
    Source: Roncen et al. (2026), eq. (2.2e). Departure from print: Phi(s) = (2/s) I1(s)/I0(s); I1/I2 as printed breaks
        Phi(0) = 1. I2/I0 keeps full precision as s -> 0, where 1 - Phi would cancel. Above |s| = 1e4 the asymptotic
        series of I1/I0 is used.
    """
    if not s.is_complex():
        raise TypeError(f"s is {s.dtype}; a complex128 tensor is needed")
    result: Tensor = _RatioI2I0.apply(s)  # type: ignore[no-untyped-call]
    return result


def cavity_propagation(omega: Tensor, hydraulic_radius: Tensor, fluid: Fluid) -> Tensor:
    """j k_c of eq. (2.2d), 1/m: plane wave with viscous and thermal wall losses, at omega, rad/s.

    The hydraulic radius r_c, m, is D/2 for a square cavity of side D, D between plates D apart.
    """
    root = torch.sqrt(1j * omega)
    one_minus_viscous = ratio_i2_i0(root * (hydraulic_radius / fluid.kinematic_viscosity**0.5))
    thermal = 1 - ratio_i2_i0(root * (hydraulic_radius / fluid.thermal_diffusivity**0.5))
    losses = (1 + (fluid.heat_capacity_ratio - 1) * thermal) / one_minus_viscous
    return 1j * omega / fluid.sound_speed * torch.sqrt(losses)


def cavity_impedance(omega: Tensor, depth: Tensor, hydraulic_radius: Tensor, fluid: Fluid) -> Tensor:
    """coth(j k_c H_c), normalised: a closed cavity seen from its mouth. Last term of (2.2a)."""
    return 1 / torch.tanh(cavity_propagation(omega, hydraulic_radius, fluid) * depth)
