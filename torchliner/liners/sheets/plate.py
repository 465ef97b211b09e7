r"""What the laws of plates with round holes share: the plate, the tube, the jet, grazing flow.

Every |v| in this room is the rms velocity in front of the sheet; in the holes it is |v|/sigma.
Where a law is written for another, its docstring converts. Two ways lead from the quasi-steady
drop of a jet, dp = rho (1 - sigma^2)/(2 sigma^2 C_D^2) |v| v, to a resistance per rms velocity:

- the slope itself, dp/v at a steady v = |v|: factor 1;
- the part of dp in phase with a tone v = V sin: the mean of |sin|^3 over that of sin^2 is 8/(3 pi),
  and V = sqrt(2) |v|, so the factor is 8 sqrt(2)/(3 pi) = 1.2004, Melling's "1.2"; for the peak
  velocity, 1/2 times 8/(3 pi) is the 4/(3 pi) that others print. The two are one law.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import plain_number
from torchliner.fluid import Fluid
from torchliner.liners.cavity import ratio_i2_i0
from torchliner.liners.grazing import goodrich_resistance
from torchliner.liners.parameters import parameter
from torchliner.liners.sheets.sheet import Sheet

LARGEST = 0.1  # m; a plate above it is one whose millimetres were given as metres
TONE = 8 * 2**0.5 / (3 * math.pi)
DISCHARGE = 0.76  # C_D of sharp-edged holes, with which the two-parameter model is used
FOK = (1, -1.40925, 0, 0.33818, 0, 0.06793, -0.02287, 0.03015, -0.01641, 0.01729, -0.01248,
       0.01205, -0.00985)  # fmt: skip


@dataclass(frozen=True)
class Plate(Sheet):
    """Rigid plate with round holes.

    Args:
        thickness: t, m, at most 0.1.  orifice_diameter: d, m, at most 0.1.
        porosity: sigma, open area over the area of the plate, at most 1.
    """

    thickness: float | Tensor = parameter("m", high=LARGEST)
    orifice_diameter: float | Tensor = parameter("m", high=LARGEST)
    porosity: float | Tensor = parameter(high=1.0)


@dataclass(frozen=True)
class GrazedPlate(Plate):
    """Plate in grazing flow that adds R_f = M/(sigma (2 + 1.256 delta*/d)).

    Args:
        mach: M, of the flow, 0 to 1: bulk in Roncen et al. (2026), eq. (2.7), on the centre line
            in NASA's use of the same term.
        displacement_thickness: delta*, m, at most 0.1; needed with a Mach number above 0.
    Raises:
        ValueError: a Mach number without a displacement thickness.
    Source: Rice & Heidelberg, as in ``liners/grazing.py``.
    """

    mach: float | Tensor = parameter(default=0.0, high=1.0, low_included=True)
    displacement_thickness: float | Tensor = parameter("m", default=0.0, high=LARGEST, low_included=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if plain_number(self.mach) > 0 and plain_number(self.displacement_thickness) == 0:
            raise ValueError(
                f"sheet {self.law!r}: mach is {plain_number(self.mach):g} and "
                "displacement_thickness is 0 m; state it, 1e-3 to 5e-3 m in most ducts: the added "
                "resistance falls with it"
            )

    def grazing(self, n: dict[str, Any]) -> Any:
        """R_f, normalised, of parameters by name: tensors or floats."""
        return goodrich_resistance(n["mach"], n["porosity"], n["displacement_thickness"], n["orifice_diameter"])

    @property
    def flow_resistance(self) -> float:
        """See ``Sheet``."""
        return float(self.grazing({name: each.value for name, each in self.numbers().items()}))


def tube_impedance(omega: Tensor, length: Tensor, diameter: Tensor, fluid: Fluid) -> Tensor:
    r"""Air in a tube with friction, normalised: :math:`j\omega L/(c F)`, F = I2(s)/I0(s).

    32 nu L/(c d^2) + 4/3 j omega L/c at low frequency (Poiseuille), j omega L/c at high.

    Args:
        omega: rad/s.  length: L, m.  diameter: d, m.  fluid: gas.
    Source: Crandall (1926); F = 1 - 2 J1(x)/(x J0(x)), x = d/2 sqrt(-j omega/nu), is I2/I0 of
        s = d/2 sqrt(j omega/nu), which keeps its digits as s tends to 0.
    """
    shear = torch.sqrt(1j * omega) * (diameter / (2 * fluid.kinematic_viscosity**0.5))
    return 1j * omega * length / fluid.sound_speed / ratio_i2_i0(shear)


def jet_resistance(speed: Tensor, n: dict[str, Tensor], fluid: Fluid) -> Tensor:
    """(1 - sigma^2) |v|/(2 c sigma^2 C_D^2): the slope of the quasi-steady drop, normalised."""
    lost = (1 - n["porosity"] ** 2) / (n["porosity"] * n["discharge_coefficient"]) ** 2
    return lost * speed / (2 * fluid.sound_speed)


def ingard_end(n: dict[str, Tensor]) -> Tensor:
    """0.85 d (1 - 0.7 sqrt(sigma)), m, both sides: 0.85 is 8/(3 pi). Source: Ingard (1953)."""
    return 0.85 * n["orifice_diameter"] * (1 - 0.7 * torch.sqrt(n["porosity"]))


def left_by_flow(mach: Tensor) -> Tensor:
    """1/(1 + 305 M^3): what grazing flow leaves of the end correction.

    Source: Rice & Heidelberg, as quoted with the two-parameter model; see ``two_parameter.py``.
    """
    return 1 / (1 + 305 * mach**3)


def fok_sum(porosity: Tensor) -> Tensor:
    """What the neighbours leave of a hole's end correction: 1/psi of Fok, at xi = sqrt(sigma).

    1 - 1.40925 xi + 0.33818 xi^3 + ...; the 12 powers end at -0.005 instead of 0 for xi = 1, and
    what is below 0 is taken as 0.

    Source: Fok, as in Melling (1973); coefficients as in OpenPulse (perforated_plate.py).
    """
    root, total = torch.sqrt(porosity), torch.zeros_like(porosity)
    for coefficient in reversed(FOK):
        total = total * root + coefficient
    return total.clamp(min=0)
