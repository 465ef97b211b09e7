"""What liners made of cells share: walls in parallel, a reading of |v|, an offset, a gas."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, plain_number, real_tensor, require_choice
from torchliner.file_checks import one_of
from torchliner.fluid import GAS_CONSTANT_AIR, Fluid
from torchliner.liners.model import Factor, LinerModel, Number, Pitch, Share
from torchliner.liners.plates import Sheet
from torchliner.names import VELOCITY_READINGS

OFFSET = ("offset_resistance", "offset_reactance")


@dataclasses.dataclass(frozen=True, kw_only=True)
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
        hole, porosity = (getattr(self.front, name, None) for name in ("orifice_diameter", "porosity"))
        if hole is not None:
            self.settle(hole_diameter=plain_number(hole))
        if self.flow_facing_porosity is not None or porosity is not None:
            self.settle(surface_porosity=plain_number(self.open_area()))
        if self.cell_pitch is not None and (self.hole_diameter or 0.0) > self.cell_pitch:
            size = f"orifice_diameter is {self.hole_diameter:g} m, larger than cell_pitch, {self.cell_pitch:g} m"
            raise ValueError(f"{self.label}: {size}; both are in metres")

    def _front(self) -> Sheet:
        raise NotImplementedError

    def open_area(self) -> Any:
        """Of the whole surface, as its share."""
        own: Any = self.flow_facing_porosity
        return self.front.porosity * self.open_area_fraction if own is None else own

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
        reactance = self.impedance(grid).imag.detach()
        rising = torch.nonzero((reactance[:-1] < 0) & (reactance[1:] >= 0)).reshape(-1)
        if rising.numel() == 0:
            raise ValueError(f"{self.label} has no resonance in {lowest:g}-{highest:g} Hz")
        ends = grid[rising[0]].item(), grid[rising[0] + 1].item()
        return float(brentq(lambda f: plain_number(self.impedance(f).imag), *ends, xtol=1e-9))

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
