"""Wire mesh or felt: a resistance, linear in velocity, and a mass."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.liners.parameters import parameter
from torchliner.liners.sheets.sheet import Sheet


@dataclass(frozen=True)
class Mesh(Sheet):
    r"""Mesh as its maker states it, in rayl: :math:`Z = (R_0 + R_1 |v| + j\omega m)/(\rho c)`.

    Args:
        resistance_rayl: R_0, Pa s/m (MKS rayl; 1 cgs rayl is 10 of them).
        resistance_slope_rayl: R_1, Pa s2/m2, of the rms velocity in front; 0 for a linear mesh.
            From steady flow, dp = (R_0 + R_1 v) v; a tone sees 1.2 R_1 (``TONE`` of plate.py).
        surface_mass: m, kg/m2, of the air that moves in it (and of a limp mesh beside it).

    Range: that of the flow rig for |v|; frequencies at which the layer around a wire is thick
    against its pores, as in most meshes used as liners.

    Source: definition. Forchheimer's law for R_0 and R_1.
    """

    law = "mesh"

    resistance_rayl: float | Tensor = parameter("Pa s/m", low_included=True)
    resistance_slope_rayl: float | Tensor = parameter("Pa s2/m2", default=0.0, low_included=True)
    surface_mass: float | Tensor = parameter("kg/m2", default=0.0, low_included=True)

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        n = self.tensors(omega)
        resistance = n["resistance_rayl"] + n["resistance_slope_rayl"] * speed
        return (resistance + 1j * omega * n["surface_mass"]) / fluid.characteristic_impedance
