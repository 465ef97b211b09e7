"""The plate of Yu, Ruiz & Kwan, known as the Goodrich model, with flow."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.liners.sheets.plate import (
    GrazedPlate,
    ingard_end,
    jet_resistance,
    left_by_flow,
    tube_impedance,
)

MASS_SLOPE = 2.07e-5  # s


@dataclass(frozen=True)
class Goodrich(GrazedPlate):
    r"""Goodrich's plate: Crandall's tube, slopes in |v| of resistance and mass, grazing flow.

    .. math::
        Z = \frac{j\omega (t + \epsilon d)}{c\sigma F} + \frac{1-\sigma^2}{2c\,C_D^2\sigma^2}|v|
            + \frac{M}{\sigma(2 + 1.256\,\delta^*/d)} - j\,\frac{2.07\cdot10^{-5}\,k}{\sigma^2}|v|,
        \qquad \epsilon = \frac{0.85 (1 - 0.7\sqrt\sigma)}{1 + 305 M^3},

    F that of ``tube_impedance``. Conversion of S_m = -0.0000207 k/sigma^2, k in 1/cm for V in cm/s:
    k V is 1/s in both systems, so the number keeps its value, in seconds.

    Args:
        thickness, orifice_diameter, porosity: t, d, sigma; see ``Plate``.
        discharge_coefficient, mach, displacement_thickness: see ``GrazedPlate``.

    Range: the mass is a straight line in |v| and negative above |v| = sigma (t + epsilon d)/2.07e-5
    m/s (3.7 m/s for t 0.8 mm, d 1 mm, sigma 5 %), where the law no longer holds; the sheet stays
    passive. |v|: rms over all frequencies, in front.

    Source: Yu, Ruiz & Kwan (2008), AIAA 2008-2930, which could not be opened. The flow terms are
        as in Roncen et al. (2026), eq. (2.7), and in the sources of ``two_parameter.py``; S_m and
        the slope of the resistance as commonly quoted. The authors correlate C_D with sigma and
        t/d and scale the slope; that correlation could not be checked and is left to the user, who
        states C_D.
    """

    law = "goodrich"

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        n = self.tensors(omega)
        porosity = n["porosity"]
        length = n["thickness"] + ingard_end(n) * left_by_flow(n["mach"])
        linear = tube_impedance(omega, length, n["orifice_diameter"], fluid) / porosity
        mass = MASS_SLOPE * omega / fluid.sound_speed / porosity**2 * speed
        return linear + jet_resistance(speed, n, fluid) + self.grazing(n) - 1j * mass
