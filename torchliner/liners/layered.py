r"""What liners made of cells share (walls in parallel, a reading of |v|, an offset, a gas), and liners of several
layers: sheets and cavities from the flow down to a rigid backplate.

Pressure p and velocity v, averaged over the cell and normalised, on both sides of a layer:

    sheet    p = p' + Z v',                                  v = v'
    cavity   p = cosh(g h) p' + sinh(g h) v'/phi,            v = phi sinh(g h) p' + cosh(g h) v'

with the g = j k_c of eq. (2.2d), depth h and share phi of the cell. On the backplate v' = 0.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, plain_number, real_tensor, require_choice
from torchliner.file_checks import one_of
from torchliner.fluid import GAS_CONSTANT_AIR, Fluid
from torchliner.liners.laws import LAWS
from torchliner.liners.model import Declared, Depth, Factor, LinerModel, Number, Pitch, Share
from torchliner.liners.plates import Plate, Sheet, cavity_propagation
from torchliner.names import VELOCITY_READINGS

OFFSET = ("offset_resistance", "offset_reactance")


@dataclass(frozen=True, kw_only=True)
class CellLiner(LinerModel):
    """Base of the models whose cells see a share of the surface; ``front`` is the sheet that faces the flow.

    Args:
        open_area_fraction: alpha, the share of the surface that is cell and not rigid wall (section 5.3), 0 to 1.
        velocity_reading: |v_c| of the cell: ``as_measured``, |v|, or ``conserved``, |v|/alpha; left open in the paper.
        velocity_gain: factor on |v_c|.  impedance_offset: constant added to Z, normalised.
        cell_pitch: L_c, m, for averages over cells; None if there are no cells.
        flow_facing_porosity: porosity of the whole surface for eq. (2.7); default porosity x open_area_fraction.
        fluid: gas.  name: for labels.
    """

    groups = dict.fromkeys(("offset", "impedance_offset"), OFFSET)
    front: ClassVar[Any]

    open_area_fraction: Share = 1.0
    velocity_reading: Annotated[str, one_of(*VELOCITY_READINGS)] = "as_measured"
    velocity_gain: Factor = 1.0
    impedance_offset: complex | Tensor = 0j
    cell_pitch: Pitch = None
    flow_facing_porosity: Annotated[float | None, Number(high=1.0, varied=False)] = None
    fluid: Fluid = Fluid()
    name: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice("velocity_reading", self.velocity_reading, VELOCITY_READINGS)
        self.settle(front=self._front())
        if isinstance(self.front, Plate):
            self.settle(hole_diameter=plain_number(self.front.orifice_diameter))
            self.settle(surface_porosity=plain_number(self.open_area()))

    def _front(self) -> Sheet:
        raise NotImplementedError

    def open_area(self) -> Any:
        """Of the whole surface, as its share."""
        return self.flow_facing_porosity or self.front.porosity * self.open_area_fraction

    def seen(self, frequency: Any, speed: Any) -> tuple[Tensor, Tensor]:
        """rad/s, from Hz, and |v_c|, m/s, from |v|; ValueError for what is not above 0, negative or not finite."""
        wanted, values = real_tensor(frequency), real_tensor(speed)
        frequency_tensor(wanted)
        if not bool(torch.isfinite(values).all() and (values >= 0).all()):
            raise ValueError("speed is |v| in m/s; it must be finite and not negative")
        alpha = self.open_area_fraction if self.velocity_reading == "conserved" else 1.0
        return 2 * torch.pi * wanted, values.to(wanted.device) * (self.velocity_gain / alpha)

    def resonance(self, lowest: float = 100.0, highest: float = 6000.0) -> float:
        """First frequency (Hz) in the given range where the linear reactance is 0; ValueError if there is none."""
        from scipy.optimize import brentq  # takes a quarter of a second to import

        grid = torch.linspace(lowest, highest, 2000, dtype=torch.float64)
        negative = self.impedance(grid).imag.detach() < 0
        for i in (negative[:-1] & ~negative[1:]).nonzero()[:1, 0].tolist():
            low, high = grid[i : i + 2].tolist()
            return float(brentq(lambda f: plain_number(self.impedance(f).imag), low, high, xtol=1e-9))
        raise ValueError(f"{self.label} has no resonance in {lowest:g}-{highest:g} Hz")

    def numbers(self) -> dict[str, Number]:
        """Arguments, both parts of the offset, and the state of the gas."""
        offset = torch.view_as_real(torch.as_tensor(self.impedance_offset, dtype=torch.complex128).detach()).tolist()
        temperature, pressure = air_state(self.fluid).values()
        return {
            **super().numbers(),
            **{name: Number(part, low=-math.inf) for name, part in zip(OFFSET, offset, strict=True)},
            "temperature": Number(temperature, "K", 150.0, 1500.0),
            "pressure": Number(pressure, "Pa"),
        }

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """See ``LinerModel``; temperature and pressure move the gas as dry air."""
        changes, gas = dict(values), air_state(self.fluid)
        parts = [changes.pop(name, None) for name in OFFSET]
        state = {name: changes.pop(name) for name in gas if name in changes}
        if any(part is not None for part in parts):
            own = self.numbers()
            both = [own[n].value if part is None else part for n, part in zip(OFFSET, parts, strict=True)]
            made = torch.complex(*(torch.as_tensor(part, dtype=torch.float64) for part in both))
            changes["impedance_offset"] = made if any(isinstance(each, Tensor) for each in both) else made.item()
        if state:  # c, rho and eta scale as those of air, gamma and Pr stay
            base, moved = Fluid.from_temperature(**gas), Fluid.from_temperature(**gas | state)
            names = ("sound_speed", "density", "dynamic_viscosity")
            scaled: dict[str, Any] = {n: getattr(self.fluid, n) * (getattr(moved, n) / getattr(base, n)) for n in names}
            changes["fluid"] = dataclasses.replace(self.fluid, **scaled)
        return super().with_numbers(changes)


def air_state(fluid: Fluid) -> dict[str, float]:
    """Temperature (K) and pressure (Pa) of dry air with the sound speed and density of ``fluid``."""
    temperature = plain_number(fluid.sound_speed) ** 2 / (1.4 * GAS_CONSTANT_AIR)
    return {"temperature": temperature, "pressure": plain_number(fluid.density) * GAS_CONSTANT_AIR * temperature}


@dataclass(frozen=True)
class Cavity(Declared):
    """An air column with losses at its walls, eq. (2.2d): depth h and hydraulic radius r_c (D/2 for a square cavity of
    side D), m; porosity phi, its share of the cell."""

    kind = "cavity"
    depth: Depth
    hydraulic_radius: Depth
    porosity: Share = 1.0

    def above(self, omega: Tensor, below: Tensor, speed: Tensor, fluid: Fluid) -> tuple[Tensor, Tensor]:
        """As of ``Sheet``: both columns of the module's formula over cosh(g h)."""
        phi, way = self.porosity, cavity_propagation(omega, self.hydraulic_radius, fluid) * self.depth
        slope = torch.tanh(way)
        ratio = 2 * torch.exp(-way) * below / (below + phi + (below - phi) * torch.exp(-2 * way))
        return (below + phi * slope) / (1 + slope * below / phi), ratio


def sheet(law: str, **numbers: Any) -> Sheet:
    """A sheet of a liner: a plate or a mesh.

    Args:
        law: a key of ``laws.LAWS``, which docs/liners.md lists: "perforate", "goodrich", "mesh", ...
        numbers: its parameters, SI; lengths in m.
    Raises:
        TypeError: a parameter is missing, unknown, or no number.
        ValueError: no such law (the nearest is named), or a value out of range.
    """
    return LAWS[require_choice("law of a sheet", law, LAWS)](**numbers)


@dataclass(frozen=True)
class LayeredLiner(CellLiner):
    r"""Sheets and cavities: one sheet over a cavity, perforate with mesh, two degrees of freedom.

    The measured |v| is that at the upper sheets, which no cavity parts from the flow. At a sheet behind a cavity (a
    septum) it is what the linear transfer makes of it, :math:`|v_s| = |v|\,|v_s/v|`, at the frequency asked for and
    with all sheets below at rest.

    Args:
        layers: from the flow down, first a ``sheet``, last a ``Cavity``. In ``numbers`` they are called facesheet,
            facesheet2, ... (above the first cavity), septum, septum2, ..., cavity, cavity2, ...
        open_area_fraction, ...: by keyword, see ``CellLiner``.
    Raises:
        TypeError: something else than layers.
        ValueError: an order of layers that is no liner; a value outside its range.
    Source: transfer matrices of plane waves; with one ``perforate`` and one cavity it is ``SDoFLiner``. That the sheets
        below a septum count as at rest is a choice made here; the paper has no equations for two degrees of freedom.
    """

    model = "layered"

    layers: tuple[Sheet | Cavity, ...]

    def __post_init__(self) -> None:
        self.settle(layers=tuple(self.layers), name=self.name or self.model)
        for place, layer in enumerate(self.layers, 1):
            if not isinstance(layer, Sheet | Cavity):
                raise TypeError(f"{self.label}: layer {place} is {layer!r}; a sheet or a Cavity")
        named = self.named_layers()
        if not (named and isinstance(self.layers[0], Sheet) and isinstance(self.layers[-1], Cavity)):
            order = "the first is the sheet that faces the flow, the last a cavity"
            raise ValueError(f"{self.label} has layers {', '.join(named) or 'none'}; {order}")
        super().__post_init__()
        flow = sum(layer.flow_resistance for layer in self.layers if isinstance(layer, Sheet))
        self.settle(flow_resistance=flow / plain_number(self.open_area_fraction))

    def _front(self) -> Sheet:
        return self.layers[0]  # type: ignore[return-value]

    def named_layers(self) -> dict[str, Sheet | Cavity]:
        """Layers by name, from the flow down."""
        found, seen = dict[str, Sheet | Cavity](), list[str]()
        for layer in self.layers:
            name = "cavity" if isinstance(layer, Cavity) else "septum" if "cavity" in seen else "facesheet"
            seen.append(name)
            found[name if seen.count(name) == 1 else f"{name}{seen.count(name)}"] = layer
        return found

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Tensor:
        """Normalised impedance at |v| = ``speed``; arguments, value and errors as ``SDoFLiner``."""
        omega, upper = self.seen(frequency, speed)
        speeds = [upper] * len(self.layers)  # from the flow down
        if "septum" in self.named_layers():
            for i, ratio in enumerate(self._stack(omega, [0 * omega] * len(self.layers))[1][:0:-1], 1):
                speeds[i] = ratio.abs() * speeds[i - 1]
        admittance = self._stack(omega, speeds)[0]
        found: Tensor = 1 / (admittance * self.open_area_fraction) + self.impedance_offset
        return found

    def _stack(self, omega: Tensor, speeds: Sequence[Tensor]) -> tuple[Tensor, list[Tensor]]:
        """Admittance of a cell, and velocity below over that above each layer, upwards."""
        admittance, ratios = 0 * omega.to(torch.complex128), []
        for layer, speed in zip(reversed(self.layers), reversed(speeds), strict=True):
            admittance, ratio = layer.above(omega, admittance, speed, self.fluid)
            ratios.append(ratio)
        return admittance, ratios

    def numbers(self) -> dict[str, Number]:
        """Those of the layers, as "facesheet.porosity", and the others."""
        layers = self.named_layers().items()
        own = {f"{name}.{key}": each for name, layer in layers for key, each in layer.numbers().items()}
        return own | super().numbers()

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """See ``LinerModel``."""
        layers = tuple(
            layer.with_numbers({k.partition(".")[2]: v for k, v in values.items() if k.startswith(f"{name}.")})
            for name, layer in self.named_layers().items()
        )
        return super().with_numbers({**{k: v for k, v in values.items() if "." not in k}, "layers": layers})
