r"""The liner of the paper with one law of lost mass: round holes and slits, with and without flow.

Of the reactance E of the plate's ends, all that is not the air inside the holes, the share

    s^p = a^p + (k M)^p,    a = A xi^2.5/(xi^2.5 + B^2.5),    xi = |v|/(phi_p omega D_h),

is lost: a to the jets and the turbulence that |v| stands for, once the air in a hole moves by some B hydraulic
diameters, and k M to grazing flow. A = 1/2, the end that the jet leaves by; B and k are fitted to resolved liners, and
p = 2 lies between their sum and the larger of the two (docs/mass_loss.md). The law takes the place of eq. (2.4b), whose
largest loss is half as large for a slit; resistance is that of eq. (2.4a).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import torch
from torch import Tensor

from torchliner.checks import plain_number
from torchliner.liners.cell import omega_of
from torchliner.liners.parameters import Factor, FactorFrom0, Range, ShareFrom0
from torchliner.liners.sdof import FlowSDoFLiner
from torchliner.liners.sheets.perforate import SpeedLaw, linear_impedance, powers


@dataclass(frozen=True)
class EndLossLaw(SpeedLaw):
    """``c`` is E, ``d`` the |v|^2.5 of half of a; ``end_loss`` A, ``floor`` k M, ``power`` p."""

    end_loss: Tensor
    floor: Tensor
    power: Tensor

    def parts(self, speed: Tensor) -> tuple[Tensor, Tensor]:
        """See ``SpeedLaw``."""
        power = powers(speed)[1]
        # From the larger one, so that neither power underflows; 1e-300 keeps slopes finite at 0.
        share = (self.end_loss * power / (power + self.d)).clamp(min=1e-300)
        larger = torch.maximum(share, self.floor)
        both = (share / larger) ** self.power + (self.floor / larger) ** self.power
        return super().parts(speed)[0], self.reactance - self.c * larger * both ** (1 / self.power)


@dataclass(frozen=True)
class EndLossSDoFLiner(FlowSDoFLiner):
    """``SDoFLiner`` with the module's law in place of eq. (2.4b).

    Args:
        mach: see ``FlowSDoFLiner``; fitted up to 0.3, beyond which the share may pass 1. The law adds nothing to the
            resistance.
        hydraulic_diameter: D_h of a hole, m: ``orifice_diameter`` (None) for round ones, twice the width for slits.
        end_loss: A, 0 to 1.  loss_displacement: B, above 0.  mach_loss: k, at least 0.
        combination: p, above 0 and at most 8: 1 for the sum; towards the larger one with p.
    Raises:
        ValueError: as ``SDoFLiner``; one of these outside its range.
    Source: docs/mass_loss.md; the share of one half is Ingard's (1953) for strong jets.
    """

    model = "sdof-end-loss"

    hydraulic_diameter: Annotated[Any, Range("m", high=0.2)] = None
    end_loss: ShareFrom0 = 0.5
    loss_displacement: Factor = 0.29  # scripts/mass_loss.py
    mach_loss: FactorFrom0 = 1.54  # the same
    combination: Annotated[Any, Range(high=8.0)] = 2.0

    def __post_init__(self) -> None:
        if self.hydraulic_diameter is None:
            object.__setattr__(self, "hydraulic_diameter", self.orifice_diameter)
        super().__post_init__()

    @property
    def lacks_mach(self) -> bool:
        """See ``LinerModel``."""
        return self.mach is None and plain_number(self.mach_loss) > 0

    def speed_law(self, frequency: Any) -> SpeedLaw:
        """See ``SDoFLiner``."""
        law, omega = super().speed_law(frequency), omega_of(frequency)
        number = self.tensors(omega.device)
        porosity, thickness = number["porosity"], number["facesheet_thickness"]
        plate = linear_impedance(omega, thickness, number["orifice_diameter"] / 2, porosity, self.fluid)
        inside = omega * thickness / (self.fluid.sound_speed * porosity)
        offset = torch.as_tensor(self.impedance_offset, dtype=torch.complex128)
        ends = (plate.imag - inside) / number["open_area_fraction"] + offset.imag
        half = number["loss_displacement"] * porosity * omega * number["hydraulic_diameter"] / self.gain()
        return EndLossLaw(
            *(law.resistance, law.reactance, law.a, law.b, ends, half**2.5, number["end_loss"]),
            floor=number["mach_loss"] * number.get("mach", 0.0),
            power=number["combination"],
        )
