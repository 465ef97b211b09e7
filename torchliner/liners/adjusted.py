r"""The liner of the paper with factors on the terms that the resolved cases find wrong.

With the reactance of both ends :math:`E = 2\varepsilon_e \omega/(c \varphi_p \alpha)` of eq. (2.2b)
and the flow's Mach number M, factors neutral at 1 and coefficients at 0:

    X = X_2.2 + (end_correction - 1) E - mass_loss c |v|^2.5/(|v|^2.5 + s^2.5 d)
        - mach_mass_loss M end_correction E,
    R = R_2.4 + mach_resistance M/sigma,       sigma the open area of the whole surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from torchliner.checks import plain_number, real_tensor
from torchliner.liners.cell import omega_of
from torchliner.liners.parameters import Coefficient, Factor, FactorFrom0
from torchliner.liners.sdof import FlowSDoFLiner
from torchliner.liners.sheets.perforate import SpeedLaw, end_correction


@dataclass(frozen=True)
class AdjustedSDoFLiner(FlowSDoFLiner):
    """``SDoFLiner`` with factors of its own on mass, lost mass and flow; neutral by default.

    Args:
        mach: see ``FlowSDoFLiner``; given, not fitted.
        end_correction: factor on the mass of both ends, at least 0.
        mass_loss: factor on c of (2.4b), the mass that is lost at high |v|, at least 0.
        mass_loss_speed: factor on the |v| at which half of it is lost, above 0: s, d -> s^2.5 d.
        mach_resistance: resistance over mach/open area of the surface.
        mach_mass_loss: share of the ends' mass that is lost, over mach.
    Raises:
        ValueError: as ``SDoFLiner``, and a factor outside its range.
    Source: eqs (2.2b), (2.4) of Roncen et al. (2026); the factors are this package's. Resistance
        in M/sigma is the form of eq. (2.7) with its boundary layer in the coefficient.
    """

    model = "adjusted-sdof"

    end_correction: FactorFrom0 = 1.0
    mass_loss: FactorFrom0 = 1.0
    mass_loss_speed: Factor = 1.0
    mach_resistance: Coefficient = 0.0
    mach_mass_loss: Coefficient = 0.0

    @property
    def lacks_mach(self) -> bool:
        """See ``LinerModel``."""
        return self.mach is None and any(map(plain_number, (self.mach_resistance, self.mach_mass_loss)))

    def speed_law(self, frequency: Any) -> SpeedLaw:
        """See ``SDoFLiner``."""
        law = super().speed_law(frequency)
        number = self.tensors(law.a.device)
        porosity, alpha = number["porosity"], number["open_area_fraction"]
        facing = self.flow_facing_porosity
        open_area = porosity * alpha if facing is None else real_tensor(facing)
        length = 2 * end_correction(number["orifice_diameter"] / 2, porosity)
        ends = omega_of(frequency) * length / (self.fluid.sound_speed * porosity * alpha)
        factor, mach = number["end_correction"], number.get("mach", 0.0)
        gained = factor - 1 - number["mach_mass_loss"] * mach * factor
        return SpeedLaw(
            law.resistance + number["mach_resistance"] * mach / open_area,
            law.reactance + gained * ends,
            law.a,
            law.b,
            law.c * number["mass_loss"],
            law.d * number["mass_loss_speed"] ** 2.5,
        )
