"""The two-parameter model of industry: a flow resistance, linear in velocity, and a mass."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.liners.parameters import parameter
from torchliner.liners.sheets.plate import DISCHARGE, GrazedPlate, ingard_end, left_by_flow


@dataclass(frozen=True)
class TwoParameter(GrazedPlate):
    r"""Two-parameter plate (GE): steady-flow resistance A + B |v|, Ingard's mass, grazing flow.

    .. math::
        Z = \frac{32\nu t}{c\,\sigma C_D d^2} + \frac{|v|}{2c(\sigma C_D)^2}
            + \frac{M}{\sigma(2 + 1.256\,\delta^*/d)} + j\,\frac{k (t + \epsilon d)}{\sigma},
        \qquad \epsilon = \frac{0.85 (1 - 0.7\sqrt\sigma)}{1 + 305 M^3}.

    It differs from ``goodrich`` in its friction, that of a steady flow at all frequencies, over
    C_D; in its C_D, which is stated; in the missing (1 - sigma^2); and in a mass that sound does
    not change.

    Args:
        thickness, orifice_diameter, porosity: t, d, sigma; see ``Plate``.
        mach, displacement_thickness: see ``GrazedPlate``.
        discharge_coefficient: C_D, at most 1.

    Range: friction is too small where the viscous layer is thin, d sqrt(omega/(4 nu)) above 3,
    that is in most plates, and small there beside the other terms. |v|: rms, in front.

    Source: Motsinger & Kraft (1991) with the flow terms of Rice & Heidelberg, as used by NASA
        (Jones et al. 2022). None could be opened; read in notes on them and, with Jones, Parrott &
        Watson (2008) as its source, in a code, both public on GitHub. The code divides the mass
        by C_D too, the notes do not; theirs is taken. The model of Kraft, Yu & Kwan (NASA
        CR-1999-209120), asked for as Yu (GE/Boeing), could not be opened; this is GE's form of it.
    """

    law = "two-parameter"

    discharge_coefficient: float | Tensor = parameter(default=DISCHARGE, high=1.0)

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        n = self.tensors(omega)
        opened = n["porosity"] * n["discharge_coefficient"]
        friction = 32 * fluid.kinematic_viscosity * n["thickness"] / n["orifice_diameter"] ** 2
        resistance = (friction + speed / (2 * opened)) / (opened * fluid.sound_speed)
        length = n["thickness"] + ingard_end(n) * left_by_flow(n["mach"])
        mass = omega * length / (fluid.sound_speed * n["porosity"])
        return resistance + self.grazing(n) + 1j * mass
