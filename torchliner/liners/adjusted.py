r"""The liner of the paper with factors on the terms that the resolved cases find wrong.

With the reactance of both ends :math:`E = 2\varepsilon_e \omega/(c \varphi_p \alpha)` of eq. (2.2b)
and the flow's Mach number M, factors neutral at 1 and coefficients at 0:

    X = X_2.2 + (end_correction - 1) E - mass_loss c |v|^2.5/(|v|^2.5 + s^2.5 d)
        - mach_mass_loss M end_correction E,
    R = R_2.4 + mach_resistance M/sigma,       sigma the open area of the whole surface.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

import torch
from pydantic import Field

from torchliner.checks import one_number, plain_number, real_tensor
from torchliner.liners.catalogue import SDoFFile
from torchliner.liners.cell import Parameter
from torchliner.liners.facesheet import SpeedLaw, end_correction
from torchliner.liners.model import Number
from torchliner.liners.sdof import SDoFLiner

FACTORS = {  # least value, and whether it makes sense itself
    "end_correction": (0.0, True),
    "mass_loss": (0.0, True),
    "mass_loss_speed": (0.0, False),
    "mach": (0.0, True),
    "mach_resistance": (-math.inf, False),
    "mach_mass_loss": (-math.inf, False),
}


@dataclass(frozen=True)
class AdjustedSDoFLiner(SDoFLiner):
    """``SDoFLiner`` with factors of its own on mass, lost mass and flow; neutral by default.

    Args:
        end_correction: factor on the mass of both ends, at least 0.
        mass_loss: factor on c of (2.4b), the mass that is lost at high |v|, at least 0.
        mass_loss_speed: factor on the |v| at which half of it is lost, above 0: s, d -> s^2.5 d.
        mach: of the flow over the plane, at least 0; given, not fitted.
        mach_resistance: resistance over mach/open area of the surface.
        mach_mass_loss: share of the ends' mass that is lost, over mach.
    Raises:
        ValueError: as ``SDoFLiner``, and a factor outside its range.
    Source: eqs (2.2b), (2.4) of Roncen et al. (2026); the factors are this package's. Resistance
        in M/sigma is the form of eq. (2.7) with its boundary layer in the coefficient.
    """

    model = "adjusted-sdof"

    end_correction: Parameter = 1.0
    mass_loss: Parameter = 1.0
    mass_loss_speed: Parameter = 1.0
    mach: Parameter = 0.0
    mach_resistance: Parameter = 0.0
    mach_mass_loss: Parameter = 0.0
    name: str = "adjusted-sdof"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, (low, included) in FACTORS.items():
            value = one_number(f"liner {name}", plain_number(getattr(self, name)))
            if not (low < value < math.inf or (included and value == low)):
                least = f"{'at least' if included else 'above'} {low:g}"
                raise ValueError(
                    f"liner {name} is {value:g}; it is finite"
                    + (f" and {least}" if low > -math.inf else "")
                )

    @classmethod
    def of(cls, liner: SDoFLiner, **factors: Any) -> AdjustedSDoFLiner:
        """The same liner with factors, SI; those it has already stay where none is given."""
        own = {each.name: getattr(liner, each.name) for each in dataclasses.fields(liner)}
        return cls(**own | factors)

    def speed_law(self, frequency: Any) -> SpeedLaw:
        """See ``SDoFLiner``."""
        law = super().speed_law(frequency)
        number = {n: real_tensor(getattr(self, n)).to(law.a.device) for n in FACTORS}
        porosity, alpha = real_tensor(self.porosity), real_tensor(self.open_area_fraction)
        facing = self.flow_facing_porosity
        open_area = porosity * alpha if facing is None else real_tensor(facing)
        length = 2 * end_correction(real_tensor(self.orifice_diameter) / 2, porosity)
        ends = 2 * torch.pi * real_tensor(frequency) * length
        ends = ends / (self.fluid.sound_speed * porosity * alpha)
        factor, mach = number["end_correction"], number["mach"]
        gained = factor - 1 - number["mach_mass_loss"] * mach * factor
        return SpeedLaw(
            law.resistance + number["mach_resistance"] * mach / open_area,
            law.reactance + gained * ends,
            law.a,
            law.b,
            law.c * number["mass_loss"],
            law.d * number["mass_loss_speed"] ** 2.5,
        )

    def numbers(self) -> dict[str, Number]:
        """Those of ``SDoFLiner`` and the factors."""
        factors = {
            name: Number(plain_number(getattr(self, name)), low=low, low_included=included)
            for name, (low, included) in FACTORS.items()
        }
        return {**super().numbers(), **factors}

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """See ``LinerModel``."""
        factors = {name: value for name, value in values.items() if name in FACTORS}
        moved = super().with_numbers(values)
        return dataclasses.replace(moved, **factors)  # type: ignore[return-value]


class AdjustedSDoFFile(SDoFFile):
    """Keys of a file with ``model = "adjusted-sdof"``: those of "sdof", and the factors."""

    model: Literal["adjusted-sdof"]  # type: ignore[assignment]
    end_correction: float = Field(1.0, ge=0)
    mass_loss: float = Field(1.0, ge=0)
    mass_loss_speed: float = Field(1.0, gt=0)
    mach: float = Field(0.0, ge=0)
    mach_resistance: float = 0.0
    mach_mass_loss: float = 0.0

    def build(self, path: Any, name: str) -> AdjustedSDoFLiner:
        """See ``LinerFile``."""
        values = self.model_dump(exclude={"model", "name", "description", "source", "fluid"})
        values["impedance_offset"] = complex(*self.impedance_offset)
        return AdjustedSDoFLiner(**values, fluid=self.fluid.build(), name=self.name or name)
