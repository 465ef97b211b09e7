r"""Liners of several layers: sheets and cavities from the flow down to a rigid backplate.

Pressure p and velocity v, averaged over the cell and normalised, on both sides of a layer:

    sheet    p = p' + Z v',                                  v = v'
    cavity   p = cosh(g h) p' + sinh(g h) v'/phi,            v = phi sinh(g h) p' + cosh(g h) v'

with the g = j k_c of eq. (2.2d), depth h and share phi of the cell. On the backplate v' = 0.
"""

from __future__ import annotations

import inspect
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self

import torch
from torch import Tensor

from torchliner.checks import plain_number, real_tensor, require_choice
from torchliner.fluid import Fluid
from torchliner.liners.cavity import cavity_propagation
from torchliner.liners.cell import CellLiner, omega_of, speed_of
from torchliner.liners.model import plain
from torchliner.liners.parameters import (
    Depth,
    Factor,
    Number,
    Range,
    Share,
    arguments_of,
    checked,
    numbers_of,
    ranges_of,
    tensors_of,
)
from torchliner.liners.sheets.table import LAWS

CAVITY = "cavity"


@dataclass(frozen=True)
class Layer:
    """A sheet under a law, or a cavity; ``sheet`` and ``Cavity`` make them.

    Args:
        kind: a key of ``LAWS``, or "cavity".
        values: parameters by name, SI; the others at their defaults.
    Raises:
        TypeError: a parameter is missing, or is no number.
        ValueError: no such law or parameter (the nearest is named), or a value out of range.
    """

    kind: str
    values: Mapping[str, Any]

    def __post_init__(self) -> None:
        if not self.is_cavity:
            require_choice("law of a sheet", self.kind, LAWS)
        label, declared = self.kind if self.is_cavity else f"sheet {self.kind!r}", declared_by(self.kind)
        for name in self.values:
            require_choice(f"parameter of {label}", name, ranges_of(declared))
        values = {name: self.values.get(name, arguments_of(declared)[name][1]) for name in ranges_of(declared)}
        for name, value in values.items():
            if value is inspect.Parameter.empty:
                raise TypeError(f"{label} lacks {name}")
        object.__setattr__(self, "values", checked(declared, values, label))
        if not self.is_cavity and (check := LAWS[self.kind].check):
            check(label, self.plain_values())

    @property
    def is_cavity(self) -> bool:
        """Whether it is one; else it is a sheet, which takes no room."""
        return self.kind == CAVITY

    def plain_values(self) -> dict[str, float]:
        """Parameters outside any gradient."""
        return {name: plain_number(value) for name, value in self.values.items()}

    @property
    def flow_resistance(self) -> float:
        """Resistance that the law of a sheet adds itself for grazing flow, normalised; 0 without."""
        added = None if self.is_cavity else LAWS[self.kind].flow_resistance
        return 0.0 if added is None else added(self.plain_values())

    def numbers(self) -> dict[str, Number]:
        """Parameters with units and ranges, by name."""
        return numbers_of(declared_by(self.kind), self.values)

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """A copy with other values."""
        return type(self)(self.kind, {**self.values, **values})

    def describe(self) -> dict[str, Any]:
        """A table ``[[layers]]`` of a liner file."""
        return {"kind": self.kind, **{name: plain(value) for name, value in self.values.items()}}

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """Pressure drop over velocity of a sheet; arguments and value as of the laws (``sheets/laws.py``)."""
        return LAWS[self.kind].impedance(omega, speed, fluid, **self._tensors(omega))

    def above(self, omega: Tensor, below: Tensor, speed: Tensor, fluid: Fluid) -> tuple[Tensor, Tensor]:
        """Admittance v/p above the layer, and velocity below it over that above.

        Args:
            omega: rad/s.  below: admittance below it, 0 for the backplate.  speed: |v| at it, m/s.  fluid: gas.
        """
        if self.is_cavity:
            return cavity(omega, below, fluid, **self._tensors(omega))
        return below / (1 + self.impedance(omega, speed, fluid) * below), torch.ones_like(omega)

    def _tensors(self, omega: Tensor) -> dict[str, Tensor]:
        return tensors_of(declared_by(self.kind), self.values, omega.device)


def cavity(
    omega: Tensor, below: Tensor, fluid: Fluid, *, depth: Depth, hydraulic_radius: Depth, porosity: Share = 1.0
) -> tuple[Tensor, Tensor]:
    """The ``above`` of a cavity: both columns of the module's formula over cosh(g h)."""
    way = cavity_propagation(omega, hydraulic_radius, fluid) * depth
    slope, back = torch.tanh(way), torch.exp(-2 * way)
    ratio = 2 * torch.exp(-way) * below / (below + porosity + (below - porosity) * back)
    return (below + porosity * slope) / (1 + slope * below / porosity), ratio


def declared_by(kind: str) -> Any:
    """What declares the parameters of a layer of this kind."""
    return cavity if kind == CAVITY else LAWS[kind].impedance


def layer_kinds() -> list[str]:
    """The ``kind``s of layers in liner files."""
    return [*LAWS, CAVITY]


def sheet(law: str, **numbers: Any) -> Layer:
    """A sheet of a liner: a plate, a mesh, or whatever takes no room and lets through all that comes to it.

    Args:
        law: a key of ``sheets.table.LAWS``, which docs/liners.md lists: "perforate", "goodrich", "mesh", ...
        numbers: its parameters, SI; lengths in m.
    Raises:
        TypeError, ValueError: see ``Layer``.

    >>> plate = tl.sheet("melling", thickness=0.8e-3, orifice_diameter=1e-3, porosity=0.05)
    >>> liner = tl.LayeredLiner([plate, tl.Cavity(38e-3, 5e-3)])
    >>> f"{complex(liner.impedance(1400.0, 3.0)):.2f}"
    '3.74+0.12j'
    """
    return Layer(law, numbers)


def Cavity(depth: Any, hydraulic_radius: Any, porosity: Any = 1.0) -> Layer:
    """An air column with losses at its walls, eq. (2.2d).

    Args:
        depth: h, m.  hydraulic_radius: r_c, m; D/2 for a square cavity of side D.  porosity: phi, its share of the
            cell.
    Raises:
        TypeError, ValueError: see ``Layer``.
    """
    return Layer(CAVITY, {"depth": depth, "hydraulic_radius": hydraulic_radius, "porosity": porosity})


@dataclass(frozen=True)
class LayeredLiner(CellLiner):
    r"""Sheets and cavities: one sheet over a cavity, perforate with mesh, two degrees of freedom.

    The measured |v| is that at the upper sheets, which no cavity parts from the flow. At a sheet behind a cavity (a
    septum) it is what the linear transfer makes of it, :math:`|v_s| = |v|\,|v_s/v|`, at the frequency asked for and
    with all sheets below at rest, or what ``septum_ratio`` or ``septum_speed`` state.

    Args:
        layers: from the flow down: ``sheet``s and ``Cavity``s. The first is a sheet, the last a cavity. In ``numbers``
            and messages they are called facesheet, facesheet2, ... (above the first cavity), septum, septum2, ...,
            cavity, cavity2, ...
        septum_ratio: |v| at every septum over |v| at the upper sheet; None: the linear transfer.
        septum_speed: |v| at every septum, m/s, whatever |v| is above.
        open_area_fraction, velocity_reading, velocity_gain, impedance_offset, cell_pitch, flow_facing_porosity, fluid,
            name: by keyword, see ``CellLiner``.
    Raises:
        TypeError: something else than layers.
        ValueError: an order of layers that is no liner; both rules for the septum, or one where there is none; a value
            outside its range.
    Source: transfer matrices of plane waves; cavities and, with the law ``perforate``, sheets as Roncen et al. (2026),
        eqs (2.2) and (2.4): with one of each it is ``SDoFLiner``. The paper names liners of two degrees of freedom in
        section 7.5 and gives no equations; that the sheets below count as at rest for |v| at a septum is a choice made
        here.

    >>> plate = tl.sheet("perforate", thickness=0.6e-3, orifice_diameter=1e-3, porosity=0.05)
    >>> septum = tl.sheet("perforate", thickness=0.8e-3, orifice_diameter=0.8e-3, porosity=0.02)
    >>> liner = tl.LayeredLiner([plate, tl.Cavity(20e-3, 5e-3), septum, tl.Cavity(20e-3, 5e-3)])
    >>> f"{complex(liner.impedance(1400.0, 3.0)):.2f}"
    '3.38-1.28j'
    """

    model = "layered"

    layers: tuple[Layer, ...]
    septum_ratio: Factor = None
    septum_speed: Annotated[Any, Range("m/s")] = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "layers", tuple(self.layers))
        self._check_layers(f"liner {self.name or self.model!r}")
        super().__post_init__()

    def _check_layers(self, where: str) -> None:
        for place, layer in enumerate(self.layers):
            if not isinstance(layer, Layer):
                raise TypeError(f"{where}: layer {place + 1} is {layer!r}; a sheet or a Cavity")
        if not self.layers:
            raise ValueError(f"{where} has no layers; a sheet and a cavity are the least")
        named = self.named_layers()
        if self.layers[0].is_cavity:
            raise ValueError(f"{where} begins with cavity; the first layer is the sheet that faces the flow")
        if not self.layers[-1].is_cavity:
            raise ValueError(
                f"{where} ends in {[*named][-1]} (sheet {self.layers[-1].kind!r}); the last layer is a cavity, whose "
                "depth is that from the lowest sheet to the backplate"
            )
        rules = [name for name in ("septum_ratio", "septum_speed") if getattr(self, name) is not None]
        if len(rules) == 2:
            raise ValueError(f"{where}: {' and '.join(rules)} are stated; one of them says |v|")
        if rules and "septum" not in named:
            raise ValueError(f"{where}: {rules[0]} is stated, but no sheet lies behind a cavity")

    def named_layers(self) -> dict[str, Layer]:
        """Layers by name, from the flow down."""
        count: Counter[str] = Counter()
        found = {}
        for layer in self.layers:
            name = CAVITY if layer.is_cavity else "septum" if count[CAVITY] else "facesheet"
            count[name] += 1
            found[name if count[name] == 1 else f"{name}{count[name]}"] = layer
        return found

    @property
    def hole_diameter(self) -> float | None:
        """Of the uppermost sheet, m, where it has holes."""
        return self.layers[0].plain_values().get("orifice_diameter")

    @property
    def facing(self) -> float | None:
        """See ``CellLiner``."""
        return self.layers[0].plain_values().get("porosity")

    @property
    def flow_resistance(self) -> float:
        """See ``LinerModel``."""
        return sum(layer.flow_resistance for layer in self.layers) / plain_number(self.open_area_fraction)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Tensor:
        """Normalised impedance at |v| = ``speed``; arguments, value and errors as ``SDoFLiner``."""
        omega = omega_of(frequency)
        alpha = real_tensor(self.open_area_fraction).to(omega.device)
        upper = speed_of(speed).to(omega.device) * self.gain().to(omega.device)
        return 1 / (self._stack(omega, self._speeds(omega, upper))[0] * alpha) + self.impedance_offset

    def _stack(self, omega: Tensor, speeds: Sequence[Tensor]) -> tuple[Tensor, list[Tensor]]:
        """Admittance of a cell, and velocity below over that above each layer, upwards."""
        admittance, ratios = 0 * omega.to(torch.complex128), []
        for layer, speed in zip(reversed(self.layers), reversed(speeds), strict=True):
            admittance, ratio = layer.above(omega, admittance, speed, self.fluid)
            ratios.append(ratio)
        return admittance, ratios

    def _speeds(self, omega: Tensor, upper: Tensor) -> list[Tensor]:
        """|v| at each layer, from the flow down, m/s; ``upper``: at the upper sheet."""
        count, first = len(self.layers), [layer.is_cavity for layer in self.layers].index(True)
        if self.septum_ratio is not None or self.septum_speed is not None:
            rules = (self.septum_ratio, self.septum_speed)
            ratio, fixed = (real_tensor(0.0 if rule is None else rule).to(omega.device) for rule in rules)
            return [upper] * first + [ratio * upper + fixed] * (count - first)
        if first == count - 1:
            return [upper] * count
        speeds = [upper]
        for each in self._stack(omega, [0 * omega] * count)[1][:0:-1]:
            speeds.append(each.abs() * speeds[-1])
        return speeds

    def numbers(self) -> dict[str, Number]:
        """Those of the layers, as "facesheet.porosity", and the others."""
        held = {name: layer.numbers() for name, layer in self.named_layers().items()}
        of_layers = {f"{name}.{key}": number for name, own in held.items() for key, number in own.items()}
        return of_layers | super().numbers()

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """See ``LinerModel``."""
        layers = tuple(
            layer.with_numbers({key: values[f"{name}.{key}"] for key in layer.values if f"{name}.{key}" in values})
            for name, layer in self.named_layers().items()
        )
        return super().with_numbers({**{k: v for k, v in values.items() if "." not in k}, "layers": layers})
