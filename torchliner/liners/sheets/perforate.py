"""The perforated plate of the paper."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.liners.facesheet import SpeedLaw, facesheet_impedance, speed_law_coefficients
from torchliner.liners.sheets.sheet import Sheet, parameter


@dataclass(frozen=True)
class Perforate(Sheet):
    """Plate with round holes: eqs (2.2a-c) and (2.4).

    Args:
        thickness: L_p, m.  orifice_diameter: 2 r_p, m.  porosity: phi_p.
        vena_contracta: C_vc.
    Source: Roncen et al. (2026), after Atalla & Sgard (2007), Temiz et al. (2016), Shah et al.
        (2024); see ``liners/facesheet.py``.
    """

    law = "perforate"

    thickness: float | Tensor = parameter("m")
    orifice_diameter: float | Tensor = parameter("m")
    porosity: float | Tensor = parameter(high=1.0)
    vena_contracta: float | Tensor = parameter(default=0.8, high=1.0)

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        number = self.tensors(omega)
        radius, porosity = number["orifice_diameter"] / 2, number["porosity"]
        linear = facesheet_impedance(omega, number["thickness"], radius, porosity, fluid)
        law = SpeedLaw(
            linear.real, linear.imag,
            *speed_law_coefficients(omega, radius, porosity, number["vena_contracta"], fluid),
        )  # fmt: skip
        return torch.complex(*law.parts(speed))
