"""Maa's micro-perforated plate, with the nonlinear terms of Laly et al."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.liners.parameters import parameter
from torchliner.liners.sheets.plate import DISCHARGE, Plate, jet_resistance, tube_impedance

JET = 2 * 1.6 / math.pi  # of jet_resistance; Laly et al. print beta/pi, beta = 1.6


@dataclass(frozen=True)
class Maa(Plate):
    r"""Micro-perforated plate of Maa, the exact tube and not his approximation to it.

    .. math::
        Z = \frac{j\omega t}{c\sigma F} + \frac{\alpha\sqrt{2\omega\rho\eta}}{\sigma\rho c}
            + j\,\frac{0.85\,\omega d}{c\sigma}\,\frac{1}{1 + |v|/(\sigma^2 c)}
            + \frac{1.6}{\pi}\,\frac{1-\sigma^2}{c\,C_D^2\sigma^2}|v|,

    F that of ``tube_impedance``, 1 - 2 J1(x)/(x J0(x)) with x = K sqrt(-j) and the perforate
    constant K = d sqrt(omega/(4 nu)).

    Args:
        thickness, orifice_diameter, porosity: t, d, sigma; see ``Plate``.
        discharge_coefficient: C_D, at most 1.
        edge_factor: alpha, 0 to 10: 0.5 is Maa (1998), 2 his earlier form, for sharp edges.

    Range: K of 1 to 10, holes below 1 mm, sigma of a few percent (holes that do not see each
    other). |v|: rms; Laly's V is that in the hole, |v|/sigma.

    Source: Maa (1998), J. Acoust. Soc. Am. 104, 2861, as in the theory page of acoustipy (whose
        1/sqrt(1 + K^2/2) is 1/sqrt(9 + K^2/2) here, the limit of the exact form). The terms in
        |v|: Laly et al. (2018), J. Sound Vib., S0022-460X(17)30674-0, after Maa's of high
        intensities, with beta = 1.6 and C_D = 0.76, as in public MATLAB classes that name the
        paper's equations 20 to 23 and 27. Neither paper could be opened.
    """

    law = "maa"

    discharge_coefficient: float | Tensor = parameter(default=DISCHARGE, high=1.0)
    edge_factor: float | Tensor = parameter(default=0.5, high=10.0, low_included=True)

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        n = self.tensors(omega)
        diameter, porosity, c = n["orifice_diameter"], n["porosity"], fluid.sound_speed
        edges = n["edge_factor"] * torch.sqrt(2 * omega * fluid.kinematic_viscosity) / c
        end = 0.85 * diameter / (1 + speed / (porosity**2 * c))
        linear = tube_impedance(omega, n["thickness"], diameter, fluid) + edges
        jets = JET * jet_resistance(speed, n, fluid)
        return (linear + 1j * omega * end / c) / porosity + jets
