"""What a liner is stacked from: sheets under a law, and cavities."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import torch
from torch import Tensor

from torchliner.checks import plain_number, require_choice
from torchliner.fluid import Fluid
from torchliner.liners.cavity import cavity_propagation
from torchliner.liners.model import plain
from torchliner.liners.parameters import Depth, Number, Share, arguments_of, checked, numbers_of, ranges_of, tensors_of
from torchliner.liners.sheets.table import LAWS


class Layer:
    """Parameters, and the ``kind`` by which liner files know them."""

    kind: str

    def parameters(self) -> tuple[Any, Mapping[str, Any]]:
        """The class or function that declares them, and their values by name."""
        raise NotImplementedError

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """A copy with other values."""
        raise NotImplementedError

    def numbers(self) -> dict[str, Number]:
        """Parameters with units and ranges, by name."""
        return numbers_of(*self.parameters())

    def tensors(self, device: torch.device) -> dict[str, Tensor]:
        """Parameters as float64 tensors, gradients kept."""
        return tensors_of(*self.parameters(), device)

    def describe(self) -> dict[str, Any]:
        """A table ``[[layers]]`` of a liner file."""
        return {"kind": self.kind, **{name: plain(value) for name, value in self.parameters()[1].items()}}


@dataclass(frozen=True)
class Sheet(Layer):
    """A plate, a mesh, or whatever takes no room and lets through all that comes to it.

    Args:
        kind: its law, a key of ``LAWS``.
        values: parameters of the law by name, SI; the others at their defaults.
    Raises:
        TypeError: a parameter is missing, or is no number.
        ValueError: no such law or parameter (the nearest is named), or a value out of range.
    """

    kind: str
    values: Mapping[str, Any]

    def __post_init__(self) -> None:
        law, label = LAWS[require_choice("law of a sheet", self.kind, LAWS)], f"sheet {self.kind!r}"
        values = {}
        for name in self.values:
            require_choice(f"parameter of {label}", name, ranges_of(law.impedance))
        for name in ranges_of(law.impedance):
            values[name] = self.values.get(name, arguments_of(law.impedance)[name][1])
            if values[name] is inspect.Parameter.empty:
                raise TypeError(f"{label} lacks {name}")
        object.__setattr__(self, "values", checked(law.impedance, values, label))
        if law.check is not None:
            law.check(label, self._plain())

    def parameters(self) -> tuple[Any, Mapping[str, Any]]:
        """See ``Layer``."""
        return LAWS[self.kind].impedance, self.values

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """See ``Layer``."""
        return type(self)(self.kind, {**self.values, **values})

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """Pressure drop over velocity; arguments and value as of the laws (``sheets/laws.py``)."""
        return LAWS[self.kind].impedance(omega, speed, fluid, **self.tensors(omega.device))

    @property
    def open_area(self) -> float | None:
        """Open area over the area of the sheet, where it has holes."""
        return self._plain().get("porosity")

    @property
    def hole_diameter(self) -> float | None:
        """Of its holes, m, where it has any."""
        return self._plain().get("orifice_diameter")

    @property
    def flow_resistance(self) -> float:
        """Resistance that the law itself adds for grazing flow, normalised; 0 without."""
        added = LAWS[self.kind].flow_resistance
        return 0.0 if added is None else added(self._plain())

    def _plain(self) -> dict[str, float]:
        return {name: plain_number(value) for name, value in self.values.items()}


def sheet(law: str, **numbers: Any) -> Sheet:
    """A sheet of a liner.

    Args:
        law: one of ``LAWS``.  numbers: its parameters, SI (docs/liners.md).
    Raises:
        TypeError, ValueError: as ``Sheet``.
    """
    return Sheet(law, numbers)


@dataclass(frozen=True)
class Cavity(Layer):
    """Air between two sheets, or between a sheet and the backplate.

    Args:
        depth: H_c, m, at most 10.  hydraulic_radius: r_c, m; D/2 for a square cavity of side D.
        porosity: phi_c, its share of the cell.
    """

    kind = "cavity"

    depth: Depth
    hydraulic_radius: Depth
    porosity: Share = 1.0

    def __post_init__(self) -> None:
        for name, value in checked(Cavity, vars(self), self.kind).items():
            object.__setattr__(self, name, value)

    def parameters(self) -> tuple[Any, Mapping[str, Any]]:
        """See ``Layer``."""
        return Cavity, vars(self)

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """See ``Layer``."""
        return type(self)(**{**vars(self), **values})

    def down(self, omega: Tensor, below: Tensor, fluid: Fluid) -> tuple[Tensor, Tensor]:
        """Admittance v/p at its mouth, and velocity at its bottom over that at its mouth.

        Args:
            omega: rad/s.  below: admittance at its bottom, 0 for the backplate.  fluid: gas.
        """
        number = self.tensors(omega.device)
        share = number["porosity"]
        way = cavity_propagation(omega, number["hydraulic_radius"], fluid) * number["depth"]
        slope, back = torch.tanh(way), torch.exp(-2 * way)
        mouth = (below + share * slope) / (1 + slope * below / share)
        return mouth, 2 * torch.exp(-way) * below / (below + share + (below - share) * back)


def layer_kinds() -> dict[str, Any]:
    """What declares the parameters of a layer, by its ``kind`` in liner files."""
    return {**{name: law.impedance for name, law in LAWS.items()}, Cavity.kind: Cavity}
