"""What every sheet of a liner is: a law for the pressure drop across it, and its parameters.

A law is one frozen dataclass in one file of this room and one row of ``names.SHEET_LAWS``. Its
parameters are fields made by ``parameter``; from these follow the checks, the keys of liner files
and what sensitivities and fits may vary.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar

from torch import Tensor

from torchliner.checks import one_number, real_tensor
from torchliner.fluid import Fluid
from torchliner.liners.model import Number, plain_fields

REQUIRED: Any = dataclasses.MISSING
SLIPS = {"1": " (5 % is 0.05)", "m": " (1 mm is 0.001 m)"}  # by unit, where a value is too large


def parameter(
    unit: str = "1", *, default: Any = REQUIRED, low: float = 0.0, high: float = math.inf,
    low_included: bool = False,
) -> Any:  # fmt: skip
    """A field of a sheet: a number, or a 0-d float64 tensor through which derivatives pass.

    Args:
        unit: SI, "1" if it has none.
        default: SI; without one it must be given.
        low, high: what makes sense: above ``low``, at most ``high``.
        low_included: whether ``low`` itself makes sense.
    """
    metadata = {"unit": unit, "low": low, "high": high, "low_included": low_included}
    return dataclasses.field(default=default, metadata=metadata)


@dataclasses.dataclass(frozen=True)
class Layer:
    """What a liner is stacked from: parameters with units and ranges."""

    law: ClassVar[str] = ""
    """Its ``kind`` in liner files: of sheets a key of ``names.SHEET_LAWS``."""

    @property
    def label(self) -> str:
        """For messages."""
        return self.law

    def __post_init__(self) -> None:
        for name, number in self.numbers().items():
            below = number.value < number.low or (
                number.value == number.low and not number.low_included
            )
            if below or not math.isfinite(number.value) or number.value > number.high:
                edge = "at least" if number.low_included else "above"
                unit = "" if number.unit == "1" else f" {number.unit}"
                most = "" if number.high == math.inf else f" and at most {number.high:g}{unit}"
                slip = SLIPS.get(number.unit, "") if number.value > number.high else ""
                raise ValueError(
                    f"{self.label}: {name} is {number.value:g}{unit}; it is {edge} "
                    f"{number.low:g}{unit}{most}{slip}"
                )

    def numbers(self) -> dict[str, Number]:
        """Parameters by name."""
        return {
            each.name: Number(one_number(f"{self.label}: {each.name}", plain), **each.metadata)
            for each in dataclasses.fields(self)
            if each.metadata
            for given in (getattr(self, each.name),)
            for plain in (given.detach() if isinstance(given, Tensor) else given,)
        }

    def tensors(self, omega: Tensor) -> dict[str, Tensor]:
        """Parameters as float64 tensors beside ``omega``, gradients kept."""
        return {name: real_tensor(getattr(self, name)).to(omega.device) for name in self.numbers()}

    def describe(self) -> dict[str, Any]:
        """A table ``[[layers]]`` of a liner file."""
        return {"kind": self.law, **plain_fields(self)}


@dataclasses.dataclass(frozen=True)
class Sheet(Layer):
    """A plate, a mesh, or whatever takes no room and lets through all that comes to it."""

    @property
    def label(self) -> str:
        """For messages."""
        return f"sheet {self.law!r}"

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """Pressure drop over velocity, normalised by rho c, complex128, e^(j omega t).

        Args:
            omega: rad/s, above 0.
            speed: |v| in front of the sheet, averaged over it (not in its holes), m/s, at least 0,
                of a shape that broadcasts with ``omega``. Laws are correlations in rms velocities;
                the replay puts the instantaneous one in.
            fluid: gas.
        """
        raise NotImplementedError(f"{type(self).__name__} defines no impedance")

    @property
    def open_area(self) -> float | None:
        """Open area over the area of the sheet, where it has holes."""
        found = self.numbers().get("porosity")
        return None if found is None else found.value

    @property
    def hole_diameter(self) -> float | None:
        """Of its holes, m, where it has any."""
        found = self.numbers().get("orifice_diameter")
        return None if found is None else found.value

    @property
    def flow_resistance(self) -> float:
        """Resistance that the law itself adds for grazing flow, normalised; 0 without."""
        return 0.0
