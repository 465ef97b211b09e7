r"""Layers of a liner, and what their laws share: the air in tubes and cavities, the jet, ends, grazing flow.

Every |v| of a law is the rms velocity in front of the sheet; in the holes it is |v|/sigma. Of the quasi-steady drop of
a jet, dp = rho (1 - sigma^2)/(2 sigma^2 C_D^2) |v| v, the slope at a steady v is factor 1; the part in phase with a
tone of rms |v| is 8 sqrt(2)/(3 pi) = 1.2004 of it (4/(3 pi) of the peak velocity).
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from scipy.special import ive
from torch import Tensor

from torchliner.checks import real_tensor
from torchliner.fluid import Fluid
from torchliner.liners.model import Declared, Length, LinerModel, Share, impedance_of
from torchliner.records.case import OfOneTone

ASYMPTOTIC_FROM = 1e4  # |s|: the first term left out of the series is below 1e-16 there


class Sheet(Declared):
    """A layer that takes no room, under a law: a frozen dataclass of keywords, with a row in ``laws.LAWS``."""

    kind: ClassVar[str]  # in liner files

    @property
    def flow_resistance(self) -> float:
        """What the law itself adds for grazing flow, normalised."""
        return 0.0

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """Pressure drop over velocity, normalised by rho c, complex128, e^(j omega t), at omega (rad/s) and |v| (m/s),
        which broadcast."""
        raise NotImplementedError

    def above(self, omega: Tensor, below: Tensor, speed: Tensor, fluid: Fluid) -> tuple[Tensor, Tensor]:
        """Admittance v/p above it, and velocity below it over that above, for the admittance ``below`` it."""
        return below / (1 + self.impedance(omega, speed, fluid) * below), torch.ones_like(omega)


@dataclass(frozen=True, kw_only=True)
class Plate(Sheet):
    """t ``thickness``, d ``orifice_diameter``, sigma ``porosity``: open area over that of the plate."""

    thickness: Length
    orifice_diameter: Length
    porosity: Share

    shading: ClassVar[float] = 0.7  # of ends by their neighbours: Ingard (1953)

    def ends(self, mach: Any = 0.0) -> Any:
        """Both end corrections, m: 0.85 d (1 - 0.7 sqrt(sigma))/(1 + 305 M^3), 0.85 being 8/(3 pi).

        Source: Ingard (1953); what flow leaves of them: Rice & Heidelberg, read in notes and a code on GitHub.
        """
        alone = 0.85 * self.orifice_diameter * (1 - self.shading * self.porosity**0.5)
        return alone / (1 + 305 * mach**3)

    def jet(self, speed: Tensor, discharge: Any, fluid: Fluid) -> Tensor:
        """(1 - sigma^2) |v|/(2 c sigma^2 C_D^2): the slope of the quasi-steady drop, normalised."""
        lost = (1 - self.porosity**2) / (self.porosity * discharge) ** 2
        return lost * speed / (2 * fluid.sound_speed)


def ratio_i2_i0(s: Tensor) -> Tensor:
    """I2(s)/I0(s) = 1 - Phi(s), the viscous (or thermal) function of a circular tube, of s = r sqrt(j omega/nu),
    complex128, Re s >= 0: 0 at s = 0, tending to 1; once differentiable.

    Source: Roncen et al. (2026), eq. (2.2e). Departure from print: Phi(s) = (2/s) I1(s)/I0(s); I1/I2 as printed breaks
        Phi(0) = 1. I2/I0 keeps full precision as s -> 0, where 1 - Phi would cancel. Above |s| = 1e4 the asymptotic
        series of I1/I0 is used.
    """
    at = s.detach()
    host = at.cpu().to(torch.complex128)
    large = 1 - 2 / host * (1 - 1 / (2 * host) - 1 / (8 * host**2) - 1 / (8 * host**3))
    exact = torch.as_tensor(ive(2, host.numpy()) / ive(0, host.numpy()))
    ratio = torch.where(host.abs() > ASYMPTOTIC_FROM, large, exact).to(s.device)
    # From I0' = I1, I2' = I1 - 2 I2/s and I1/I0 = s (1 - ratio)/2; 0 at s = 0.
    slope = torch.where(at == 0, 0, at * (1 - ratio) ** 2 / 2 - 2 * ratio / torch.where(at == 0, 1, at))
    return ratio + slope * (s - at)


def cavity_propagation(omega: Tensor, hydraulic_radius: Any, fluid: Fluid) -> Tensor:
    """j k_c of eq. (2.2d), 1/m: plane wave with viscous and thermal wall losses, at omega, rad/s.

    The hydraulic radius r_c, m, is D/2 for a square cavity of side D, D between plates D apart.
    """
    radius, root = real_tensor(hydraulic_radius).to(omega.device), torch.sqrt(1j * omega)
    one_minus_viscous = ratio_i2_i0(root * (radius / fluid.kinematic_viscosity**0.5))
    thermal = 1 - ratio_i2_i0(root * (radius / fluid.thermal_diffusivity**0.5))
    losses = (1 + (fluid.heat_capacity_ratio - 1) * thermal) / one_minus_viscous
    return 1j * omega / fluid.sound_speed * torch.sqrt(losses)


def tube_impedance(omega: Tensor, length: Any, diameter: Any, fluid: Fluid) -> Tensor:
    r"""Air in a tube with friction, normalised: :math:`j\omega L/(c F)`, F = I2(s)/I0(s).

    32 nu L/(c d^2) + 4/3 j omega L/c at low frequency (Poiseuille), j omega L/c at high; omega in rad/s, lengths in m.

    Source: Crandall (1926); F = 1 - 2 J1(x)/(x J0(x)), x = d/2 sqrt(-j omega/nu), is I2/I0 of s = d/2 sqrt(j omega/nu).
    """
    shear = torch.sqrt(1j * omega) * (diameter / (2 * fluid.kinematic_viscosity**0.5))
    return 1j * omega * length / fluid.sound_speed / ratio_i2_i0(shear)


def goodrich_resistance(bulk_mach: Any, flow_facing_porosity: Any, displacement_thickness: Any, diameter: Any) -> Any:
    r"""Resistance added by grazing flow, normalised: M/(phi (2 + 1.256 delta*/d)).

    Args:
        bulk_mach: M_b, 0 to 1.  flow_facing_porosity: open area over the whole liner surface.
        displacement_thickness: delta*, m.  diameter: of an orifice, m.
    Source: Yu et al. (2008) as quoted in Roncen et al. (2026), eq. (2.7). Departure from print: M_b stands twice there;
        once reproduces the paper's own shift (1.03-1.22 for its 0.94-1.12 between Mach 0.1 and 0.3), twice gives
        0.41-0.49.

    >>> round(tl.goodrich_resistance(0.3, 0.0395, 1.73e-3, 0.7e-3), 3)
    1.488
    """
    return bulk_mach / (flow_facing_porosity * (2 + 1.256 * displacement_thickness / diameter))


def goodrich_of(case: OfOneTone, liner: LinerModel, frequency: Tensor) -> Tensor | None:
    """Z of the linear liner plus eq. (2.7), (F,), where Mach number and displacement thickness are stated; what the
    liner's own law adds for the flow is taken off before."""
    porosity, diameter = liner.surface_porosity, liner.hole_diameter
    if not (case.mach and case.displacement_thickness and porosity and diameter is not None):
        return None
    added = goodrich_resistance(case.mach, porosity, case.displacement_thickness, diameter) - liner.flow_resistance
    with torch.no_grad():
        return impedance_of(liner, frequency, torch.zeros(1)) + added
