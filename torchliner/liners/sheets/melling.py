"""Melling's perforated plate: Crandall's tube, Fok's interaction, a jet with discharge."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.liners.parameters import parameter
from torchliner.liners.sheets.plate import (
    DISCHARGE,
    TONE,
    Plate,
    fok_sum,
    jet_resistance,
    tube_impedance,
)


@dataclass(frozen=True)
class Melling(Plate):
    r"""Plate of Beranek & Ingard and of Melling.

    .. math::
        Z = \frac{j\omega}{c\sigma F}\Big(t + \frac{8d}{3\pi\,\psi(\sqrt\sigma)}\Big)
            + \frac{8\sqrt2}{3\pi}\,\frac{1-\sigma^2}{2c\,(\sigma C_D)^2}|v|,

    F that of ``tube_impedance``, 1/psi that of ``fok_sum``.

    Args:
        thickness, orifice_diameter, porosity: t, d, sigma; see ``Plate``.
        discharge_coefficient: C_D, at most 1.

    Range: the jet is quasi-steady, the excursion in the hole |v|/(sigma omega) above d; in weaker
    sound the true resistance rises as |v|^2. 8 sqrt(2)/(3 pi) = 1.2004, printed 1.2, is for a tone
    of rms |v| in front; with its peak velocity the same law reads 4/(3 pi) (1 - sigma^2)/(c (sigma
    C_D)^2); derived in ``plate.py``.

    Source: Melling (1973), J. Sound Vib. 29, 1-65, which could not be opened; the nonlinear term
        and Fok's series as in OpenPulse (perforated_plate.py). Friction takes the gas's own
        viscosity, without Melling's larger one for walls that conduct heat, and acts on the end
        correction as on the tube.
    """

    law = "melling"

    discharge_coefficient: float | Tensor = parameter(default=DISCHARGE, high=1.0)

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        n = self.tensors(omega)
        end = 8 / (3 * math.pi) * n["orifice_diameter"] * fok_sum(n["porosity"])
        tube = tube_impedance(omega, n["thickness"] + end, n["orifice_diameter"], fluid)
        return tube / n["porosity"] + TONE * jet_resistance(speed, n, fluid)
