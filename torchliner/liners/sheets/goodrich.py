"""The plate of Yu, Ruiz & Kwan, known as the Goodrich model, with flow."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import plain_number
from torchliner.fluid import Fluid
from torchliner.liners.sheets.plate import (
    GrazedPlate,
    ingard_end,
    jet_resistance,
    left_by_flow,
    tube_impedance,
)

MASS_SLOPE = 2.07e-5  # s
JET = 1.336541  # of jet_resistance


@dataclass(frozen=True)
class Goodrich(GrazedPlate):
    r"""Goodrich's plate: Crandall's tube, slopes in |v| of resistance and mass, grazing flow.

    .. math::
        Z &= \frac{j\omega (t + \epsilon d)}{c\sigma F}
             + 1.336541\,\frac{1-\sigma^2}{2c\,C_D^2\sigma^2}|v|
             + \frac{M}{\sigma(2 + 1.256\,\delta^*/d)} - j\,\frac{2.07\cdot10^{-5}\,k}{\sigma^2}|v|,
        \\ \epsilon &= \frac{0.85 (1 - 0.7\sqrt\sigma)}{1 + 305 M^3}, \qquad
        C_D = 0.80695\,\sigma^{0.05}\, e^{0.2536\, t/d},

    F that of ``tube_impedance``. Conversion of S_m = -0.0000207 k/sigma^2, k in 1/cm for |v| in
    cm/s: k |v| is 1/s in both systems, so the number keeps its value, in seconds.

    Args:
        thickness, orifice_diameter, porosity: t, d, sigma; see ``Plate``.
        mach, displacement_thickness: see ``GrazedPlate``.
    Raises:
        ValueError: C_D comes out above 1, which is outside its correlation: a thick plate.

    Range: the mass is a straight line in |v| and negative above |v| = sigma (t + epsilon d)/2.07e-5
    m/s (3.7 m/s for t 0.8 mm, d 1 mm, sigma 5 %), where the law no longer holds; the sheet stays
    passive. |v|: rms over all frequencies, in front.

    Source: Yu, Ruiz & Kwan (2008), AIAA 2008-2930, which could not be opened. All terms as in a
        public code (function impedanceUTAS of an eduction), there without the 0.85 of epsilon,
        which is Ingard's and stands in the sources of ``two_parameter.py``; the flow term also as
        in Roncen et al. (2026), eq. (2.7).
    """

    law = "goodrich"

    def __post_init__(self) -> None:
        super().__post_init__()
        if (found := plain_number(self.discharge(self.tensors(torch.zeros(()))))) > 1:
            raise ValueError(
                f"sheet {self.law!r}: the correlation gives a discharge coefficient of {found:.3g} "
                "for this thickness over diameter and porosity; it holds to 1, law "
                "'two-parameter' takes a stated one"
            )

    def discharge(self, n: dict[str, Tensor]) -> Tensor:
        """C_D."""
        slenderness = n["thickness"] / n["orifice_diameter"]
        return 0.80695 * n["porosity"] ** 0.05 * torch.exp(0.2536 * slenderness)

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        n = self.tensors(omega)
        porosity = n["porosity"]
        length = n["thickness"] + ingard_end(n) * left_by_flow(n["mach"])
        linear = tube_impedance(omega, length, n["orifice_diameter"], fluid) / porosity
        mass = MASS_SLOPE * omega / fluid.sound_speed / porosity**2 * speed
        jets = JET * jet_resistance(speed, {**n, "discharge_coefficient": self.discharge(n)}, fluid)
        return linear + jets + self.grazing(n) - 1j * mass
