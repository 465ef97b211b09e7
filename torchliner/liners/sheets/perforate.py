"""The perforated plate of the paper."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.liners.facesheet import (
    SpeedLaw,
    facesheet_impedance,
    require_mass,
    speed_law_coefficients,
)
from torchliner.liners.parameters import parameter
from torchliner.liners.sheets.plate import Plate


@dataclass(frozen=True)
class Perforate(Plate):
    """Plate with round holes: eqs (2.2a-c) and (2.4).

    Args:
        thickness: L_p, m.  orifice_diameter: 2 r_p, m.  porosity: phi_p.
        vena_contracta: C_vc.
    Raises:
        ValueError: a thin plate of more than 77 % open area, whose end corrections (2.2b) are so
            far below 0 that its mass and resistance are, too.
    Source: Roncen et al. (2026), after Atalla & Sgard (2007), Temiz et al. (2016), Shah et al.
        (2024); see ``liners/facesheet.py``.
    """

    law = "perforate"

    vena_contracta: float | Tensor = parameter(default=0.8, high=1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        thickness, diameter, porosity, _ = (each.value for each in self.numbers().values())
        require_mass(f"sheet {self.law!r}", thickness, diameter, porosity)

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
