"""What every sheet of a liner is: a law for the pressure drop across it, and its parameters.

A law is one frozen dataclass in one file of this room and one row of ``names.SHEET_LAWS``. Its
parameters are fields made by ``parameter`` of ``liners/parameters.py``.
"""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

from torch import Tensor

from torchliner.checks import real_tensor
from torchliner.fluid import Fluid
from torchliner.liners.model import Number, plain_fields
from torchliner.liners.parameters import numbers_of, require_ranges


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
        require_ranges(self.numbers(), self.label)

    def numbers(self) -> dict[str, Number]:
        """Parameters by name."""
        return numbers_of(self, self.label)

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
