r"""The perforated plate of the paper: its linear impedance, and eq. (2.4) in a form that is exact at v = 0.

With u = |v|/phi_p, S_t = q/u, q = sqrt(2) omega r_p and E = 1 + 0.06 exp(3.74/S_h):

    1/(1 + 2 S_t E)       = u/(u + 2 q E),
    1 - 1/(1 + X)         = X/(1 + X),   X = 0.013 S_h^2 (u/q)^2.5.

So at one frequency both parts are rational in |v| and |v|^2.5:

    Re G =  a |v|^2 / (|v| + b),         Im G = -c |v|^2.5 / (|v|^2.5 + d).

The printed forms lose 1e-3 relative at |v| = 1e-6 m/s and divide by zero at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.liners.parameters import Length, Share

LARGEST_EXPONENT = 700.0  # exp of more overflows float64; the resistance is 0 long before


def perforate(
    omega: Tensor,
    speed: Tensor,
    fluid: Fluid,
    *,
    thickness: Length,
    orifice_diameter: Length,
    porosity: Share,
    vena_contracta: Share = 0.8,
) -> Tensor:
    """Plate with round holes, of L_p, 2 r_p, phi_p and C_vc (0.8 in the paper, 0.75 for sharp edges).

    Source: Roncen et al. (2026), eqs (2.2a-c) and (2.4), after Atalla & Sgard (2007), Temiz et al. (2016), Shah et al.
        (2024).
    """
    radius = orifice_diameter / 2
    linear = linear_impedance(omega, thickness, radius, porosity, fluid)
    law = SpeedLaw(linear.real, linear.imag, *coefficients(omega, radius, porosity, vena_contracta, fluid))
    return torch.complex(*law.parts(speed))


def end_correction(radius: Tensor, porosity: Tensor) -> Tensor:
    """eps_e of one side, m, eq. (2.2b)."""
    return 0.85 * radius * (1 - 1.14 * torch.sqrt(porosity))


def require_mass(name: str, thickness: float, diameter: float, porosity: float) -> None:
    """Refuse thin plates (m) so open that eq. (2.2b) makes their mass and resistance negative.

    Raises:
        ValueError: thickness and end corrections are not above 0 together; ``name`` the plate.
    """
    length = thickness + 0.85 * diameter * (1 - 1.14 * porosity**0.5)
    if length <= 0:
        raise ValueError(
            f"{name}: thickness {thickness:g} m and end corrections are {length:.3g} m together at "
            f"porosity {porosity:g}; eq. (2.2b) holds to 0.77, take law 'melling' above"
        )


def linear_impedance(omega: Tensor, thickness: Tensor, radius: Tensor, porosity: Tensor, fluid: Fluid) -> Tensor:
    """First two terms of eq. (2.2a), normalised, for omega (rad/s, > 0, any shape), L_p, r_p (m) and phi_p."""
    extra = end_correction(radius, porosity)
    surface_resistance = torch.sqrt(fluid.dynamic_viscosity * omega * fluid.density)
    viscous = surface_resistance / (fluid.characteristic_impedance * porosity)
    viscous = viscous * (2 * thickness / radius + 4 * extra / radius) / 2**0.5
    mass = (2 * extra + thickness) / (fluid.sound_speed * porosity) * omega
    return torch.complex(viscous, viscous + mass)


def coefficients(
    omega: Tensor, radius: Tensor, porosity: Tensor, vena_contracta: Tensor, fluid: Fluid
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """a, b, c, d of the module's formula, of the shape of ``omega`` (rad/s).

    Source: Roncen et al. (2026), eqs (2.4a,b), (2.5a,b), rearranged, not changed. The exponential is capped where it
        would overflow, below about 3e-4 Hz: Re G is 0 there.
    """
    shear = radius * torch.sqrt(omega / fluid.kinematic_viscosity)
    strouhal_speed = 2**0.5 * omega * radius
    growth = 1 + 0.06 * torch.exp((3.74 / shear).clamp(max=LARGEST_EXPONENT))
    a = 2**0.5 / (2 * vena_contracta**2 * porosity**2 * fluid.sound_speed) + 0 * omega
    b = 2 * strouhal_speed * growth * porosity
    c = omega / fluid.sound_speed * radius / porosity * (0.6 + 1.6 / shear + 0.015 * shear)
    d = (strouhal_speed * porosity) ** 2.5 / (0.013 * shear**2)
    return a, b, c, d


@dataclass(frozen=True)
class SpeedLaw:
    """Z(|v|) at fixed frequencies: six real tensors of one shape, (F,) by rule.

    Z = linear + a |v|^2/(|v| + b) - j c |v|^2.5/(|v|^2.5 + d), |v| in m/s as measured.
    """

    resistance: Tensor
    reactance: Tensor
    a: Tensor
    b: Tensor
    c: Tensor
    d: Tensor

    def parts(self, speed: Tensor) -> tuple[Tensor, Tensor]:
        """Resistance and reactance for |v| broadcast against the coefficients."""
        square, power = powers(speed)
        resistance = self.resistance + self.a * (square / (speed + self.b))
        return resistance, self.reactance - self.c * (power / (power + self.d))


def powers(speed: Tensor) -> tuple[Tensor, Tensor]:
    """|v|^2 and |v|^2.5; v*v*sqrt(v) is ten times faster than a power of 2.5, and its clamp gives a slope of 0, not
    infinity, at rest."""
    square = speed * speed
    return square, square * speed.clamp(min=1e-30).sqrt()
