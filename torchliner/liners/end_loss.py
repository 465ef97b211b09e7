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

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import torch
from pydantic import Field
from torch import Tensor

from torchliner.checks import one_number, plain_number, real_tensor
from torchliner.liners.catalogue import SDoFFile
from torchliner.liners.cell import Parameter
from torchliner.liners.facesheet import SpeedLaw, facesheet_impedance, powers
from torchliner.liners.model import Number
from torchliner.liners.sdof import SDoFLiner

FITTED = {"loss_displacement": 0.29, "mach_loss": 1.54}  # scripts/mass_loss.py
OWN = {  # highest value, and whether 0 makes sense
    "end_loss": (1.0, True),
    "loss_displacement": (math.inf, False),
    "mach_loss": (math.inf, True),
    "mach": (1.0, True),
    "combination": (8.0, False),
    "hydraulic_diameter": (math.inf, False),
}


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
class EndLossSDoFLiner(SDoFLiner):
    """``SDoFLiner`` with the module's law in place of eq. (2.4b).

    Args:
        mach: M of the flow over the plane, 0 to 1 (fitted up to 0.3, beyond which the share may
            pass 1); the law adds nothing to the resistance.
        hydraulic_diameter: D_h of a hole, m: ``orifice_diameter`` (None) for round ones, twice the
            width for slits.
        end_loss: A, 0 to 1.  loss_displacement: B, above 0.  mach_loss: k, at least 0.
        combination: p, above 0 and at most 8: 1 for the sum; towards the larger one with p.
    Raises:
        ValueError: as ``SDoFLiner``; one of these outside its range.
    Source: docs/mass_loss.md; the share of one half is Ingard's (1953) for strong jets.
    """

    model = "sdof-end-loss"

    mach: Parameter = 0.0
    hydraulic_diameter: Parameter | None = None
    end_loss: Parameter = 0.5
    loss_displacement: Parameter = FITTED["loss_displacement"]
    mach_loss: Parameter = FITTED["mach_loss"]
    combination: Parameter = 2.0
    name: str = "sdof-end-loss"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hydraulic_diameter is None:
            object.__setattr__(self, "hydraulic_diameter", self.orifice_diameter)
        for name, number in self._own().items():
            value = one_number(f"liner {name}", number.value)
            if not (0 < value <= number.high or value == 0 == 1 - number.low_included):
                least = "at least 0" if number.low_included else "above 0"
                most = "" if number.high == math.inf else f" and at most {number.high:g}"
                raise ValueError(f"liner {name} is {value:g}; it is finite, {least}{most}")

    def speed_law(self, frequency: Any) -> SpeedLaw:
        """See ``SDoFLiner``."""
        law = super().speed_law(frequency)
        omega = 2 * torch.pi * real_tensor(frequency)
        own = {name: real_tensor(getattr(self, name)).to(omega.device) for name in OWN}
        porosity = real_tensor(self.porosity)
        plate = facesheet_impedance(
            omega, real_tensor(self.facesheet_thickness),
            real_tensor(self.orifice_diameter) / 2, porosity, self.fluid,
        )  # fmt: skip
        inside = omega * self.facesheet_thickness / (self.fluid.sound_speed * porosity)
        ends = (plate.imag - inside) / self.open_area_fraction
        ends = ends + real_tensor(torch.as_tensor(self.impedance_offset).imag)
        gain = real_tensor(self.velocity_gain)
        if self.velocity_reading == "conserved":
            gain = gain / self.open_area_fraction
        half = own["loss_displacement"] * porosity * omega * own["hydraulic_diameter"] / gain
        return EndLossLaw(
            law.resistance, law.reactance, law.a, law.b, ends, half**2.5, own["end_loss"],
            own["mach_loss"] * own["mach"], own["combination"],
        )  # fmt: skip

    def _own(self) -> dict[str, Number]:
        unit = {"hydraulic_diameter": "m"}
        return {
            name: Number(plain_number(getattr(self, name)), unit.get(name, "1"), high=high,
                         low_included=included)
            for name, (high, included) in OWN.items()
        }  # fmt: skip

    def numbers(self) -> dict[str, Number]:
        """Those of ``SDoFLiner`` and of the law."""
        return {**super().numbers(), **self._own()}

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """See ``LinerModel``."""
        own = {name: value for name, value in values.items() if name in OWN}
        return super().with_numbers(values).replace(**own)  # type: ignore[return-value]


class EndLossFile(SDoFFile):
    """Keys of a file with ``model = "sdof-end-loss"``: those of "sdof", and those of the law."""

    model: Literal["sdof-end-loss"]  # type: ignore[assignment]
    mach: float = Field(0.0, ge=0, le=1)
    hydraulic_diameter: float | None = Field(None, gt=0, lt=0.2)
    end_loss: float = Field(0.5, ge=0, le=1)
    loss_displacement: float = Field(FITTED["loss_displacement"], gt=0)
    mach_loss: float = Field(FITTED["mach_loss"], ge=0)
    combination: float = Field(2.0, gt=0, le=8)

    def build(self, path: Path, name: str) -> EndLossSDoFLiner:
        """See ``LinerFile``."""
        values = self.model_dump(exclude={"model", "name", "description", "source", "fluid"})
        values["impedance_offset"] = complex(*self.impedance_offset)
        return EndLossSDoFLiner(**values, fluid=self.fluid.build(), name=self.name or name)
