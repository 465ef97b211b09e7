"""Guess's perforated plate, with flow and amplitude."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import plain_number
from torchliner.fluid import Fluid
from torchliner.liners.parameters import parameter
from torchliner.liners.sheets.plate import Plate, left_by_flow


@dataclass(frozen=True)
class Guess(Plate):
    r"""Plate of Guess: friction and radiation, an amplitude and a flow that add as Mach numbers.

    .. math::
        R &= \frac{\sqrt{8\nu\omega}}{c\sigma}\Big(1 + \frac td\Big) + \frac{(kd)^2}{8\sigma}
             + \frac{1-\sigma^2}{\sigma}(M_0 + 0.3 M), \qquad M_0 = \frac{|v|}{\sigma c}, \\
        X &= \frac{\omega (t + \delta)}{c\sigma} + \frac{\sqrt{8\nu\omega}}{c\sigma}
             \Big(1 + \frac td\Big), \qquad
        \delta = \frac{8d}{3\pi}(1 - 0.7\sqrt\sigma)\,
             \frac{1 + 5\cdot10^3 M_0^2}{1 + 10^4 M_0^2}\, \frac{1}{1 + 305 M^3}.

    Args:
        thickness, orifice_diameter, porosity: t, d, sigma; see ``Plate``.
        mach: M of the grazing flow, 0 to 1.

    Range: holes wide against the viscous layer, d sqrt(omega/(4 nu)) above 10 (below it friction
    is too small: it lacks Poiseuille's limit), and k d below 1. M_0 is that of the hole; whether
    Guess means rms or peak is not said where this was read, rms is taken: the jet of a discharge
    coefficient sqrt(TONE/2) = 0.775 (a peak would mean 0.65).

    Source: Guess (1975), J. Sound Vib. 40, 119-137, which could not be opened. All terms but one
        are as in the code VictorZaia/Impedance-calculation on GitHub (0.71 there for 0.7), after
        Malmary. The factor in M_0 of delta, which halves it in strong sound, is as commonly quoted
        and was found in no text that could be opened.
    """

    law = "guess"

    mach: float | Tensor = parameter(default=0.0, high=1.0, low_included=True)

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        n = self.tensors(omega)
        thickness, diameter, porosity = n["thickness"], n["orifice_diameter"], n["porosity"]
        share = porosity * fluid.sound_speed
        sound = (speed / share) ** 2
        friction = torch.sqrt(8 * fluid.kinematic_viscosity * omega) * (1 + thickness / diameter)
        radiation = (omega * diameter / fluid.sound_speed) ** 2 / (8 * porosity)
        jets = (1 - porosity**2) / porosity * (speed / share + 0.3 * n["mach"])
        end = 8 / (3 * math.pi) * diameter * (1 - 0.7 * torch.sqrt(porosity))
        end = end * (1 + 5e3 * sound) / (1 + 1e4 * sound) * left_by_flow(n["mach"])
        reactance = (friction + omega * (thickness + end)) / share
        return friction / share + radiation + jets + 1j * reactance

    @property
    def flow_resistance(self) -> float:
        """See ``Sheet``."""
        porosity = plain_number(self.porosity)
        return 0.3 * (1 - porosity**2) / porosity * plain_number(self.mach)
