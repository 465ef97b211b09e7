r"""The liner of the paper with one law of lost mass: round holes and slits, with and without flow.

Of the reactance E of the plate's ends, all that is not the air inside the holes, the share

    s^p = a^p + (k M)^p,    a = A xi^2.5/(xi^2.5 + B^2.5),    xi = |v|/(phi_p omega D_h),

is lost: a to the jets and the turbulence that |v| stands for, once the air in a hole moves by some
B hydraulic diameters, and k M to grazing flow. A = 1/2, the end that the jet leaves by; B and k are
fitted to resolved liners, and p = 2 lies between their sum and the larger of the two
(docs/mass_loss.md). The law takes the place of eq. (2.4b), whose largest loss is half as large for
a slit; resistance is that of eq. (2.4a).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import plain_number, real_tensor
from torchliner.liners.cell import Parameter, omega_of
from torchliner.liners.facesheet import SpeedLaw, facesheet_impedance, powers
from torchliner.liners.further import FurtherSDoFLiner, file_of
from torchliner.liners.parameters import parameter


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
class EndLossSDoFLiner(FurtherSDoFLiner):
    """``SDoFLiner`` with the module's law in place of eq. (2.4b).

    Args:
        mach: M of the flow over the plane, 0 to 1 (fitted up to 0.3, beyond which the share may
            pass 1); None: that which the data state, 0 where they state none. The law adds nothing
            to the resistance.
        hydraulic_diameter: D_h of a hole, m: ``orifice_diameter`` (None) for round ones, twice the
            width for slits.
        end_loss: A, 0 to 1.  loss_displacement: B, above 0.  mach_loss: k, at least 0.
        combination: p, above 0 and at most 8: 1 for the sum; towards the larger one with p.
    Raises:
        ValueError: as ``SDoFLiner``; one of these outside its range.
    Source: docs/mass_loss.md; the share of one half is Ingard's (1953) for strong jets.
    """

    model = "sdof-end-loss"

    mach: Parameter | None = parameter(default=None, high=1.0, low_included=True)
    hydraulic_diameter: Parameter | None = parameter("m", default=None, high=0.2)
    end_loss: Parameter = parameter(default=0.5, high=1.0, low_included=True)
    loss_displacement: Parameter = parameter(default=0.29)  # scripts/mass_loss.py
    mach_loss: Parameter = parameter(default=1.54, low_included=True)  # the same
    combination: Parameter = parameter(default=2.0, high=8.0)
    name: str = "sdof-end-loss"

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
        own = self._tensors(omega.device)
        porosity, thickness = real_tensor(self.porosity), real_tensor(self.facesheet_thickness)
        radius = real_tensor(self.orifice_diameter) / 2
        plate = facesheet_impedance(omega, thickness, radius, porosity, self.fluid)
        inside = omega * thickness / (self.fluid.sound_speed * porosity)
        ends = (plate.imag - inside) / self.open_area_fraction
        ends = ends + real_tensor(torch.as_tensor(self.impedance_offset).imag)
        half = own["loss_displacement"] * porosity * omega
        half = half * own["hydraulic_diameter"] / self._gain()
        return EndLossLaw(
            law.resistance, law.reactance, law.a, law.b, ends, half**2.5, own["end_loss"],
            own["mach_loss"] * own.get("mach", 0.0), own["combination"],
        )  # fmt: skip


EndLossFile = file_of(EndLossSDoFLiner)
