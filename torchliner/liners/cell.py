"""What liners made of cells share: walls in parallel, a reading of |v|, an offset, a gas."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Self

import torch
from torch import Tensor

from torchliner.checks import (
    frequency_tensor,
    plain_number,
    real_tensor,
    require_choice,
    require_positive,
)
from torchliner.fluid import GAS_CONSTANT_AIR, Fluid
from torchliner.liners.model import LinerModel, Number
from torchliner.names import VELOCITY_READINGS

Parameter = float | Tensor
PLATE, DEPTH, SHARE = ("m", 0.1), ("m", 10.0), ("1", 1.0)  # unit and highest value
CELL = {"open_area_fraction": SHARE, "velocity_gain": ("1", math.inf)}  # unit and highest value
OFFSET = ("offset_resistance", "offset_reactance")


def omega_of(frequency: Any) -> Tensor:
    """rad/s, from Hz above 0, of its shape."""
    wanted = real_tensor(frequency)
    frequency_tensor(wanted)
    return 2 * torch.pi * wanted


def speed_of(speed: Any) -> Tensor:
    """|v|, m/s, of its shape.

    Raises:
        ValueError: negative or not finite.
    """
    values = real_tensor(speed)
    if not bool(torch.isfinite(values).all() and (values >= 0).all()):
        raise ValueError("speed is |v| in m/s; it must be finite and not negative")
    return values


class CellLiner(LinerModel):
    """Base of the models whose cells see a share of the surface: fields, checks, numbers.

    A model is a frozen dataclass with the fields below and its own; ``_arguments`` and ``_changes``
    are its own ``numbers`` and ``with_numbers``.
    """

    groups = dict.fromkeys(("offset", "impedance_offset"), OFFSET)

    open_area_fraction: Parameter
    velocity_reading: str
    velocity_gain: Parameter
    impedance_offset: complex | Tensor
    flow_facing_porosity: float | None
    fluid: Fluid
    name: str

    def _arguments(self) -> dict[str, Number]:
        """Numbers without offset and gas."""
        raise NotImplementedError

    def _changes(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Arguments of ``replace`` for those of ``values`` that are among ``_arguments``."""
        raise NotImplementedError

    @property
    def _facing(self) -> float | None:
        """Porosity of what faces the flow, of a cell."""
        raise NotImplementedError

    def _check(self, numbers: Mapping[str, tuple[str, float]]) -> None:
        """Arguments above 0, by unit and highest value; reading, pitch."""
        stated = {} if self.flow_facing_porosity is None else {"flow_facing_porosity": SHARE}
        for name, (unit, high) in {**numbers, **stated}.items():
            value = getattr(self, name)
            require_positive(f"liner {name} (m)" if unit == "m" else f"liner {name}", value)
            if plain_number(value) > high:
                most = f"in m, at most {high:g} (1 mm is 0.001 m)"
                if unit != "m":
                    most = "a fraction, at most 1 (5.5 % is 0.055)"
                raise ValueError(f"liner {name} is {plain_number(value):g}; it is {most}")
        require_choice("velocity_reading", self.velocity_reading, VELOCITY_READINGS)
        if self.cell_pitch is not None:
            require_positive("liner cell_pitch (m)", self.cell_pitch)
            diameter = self.hole_diameter
            if diameter is not None and diameter > self.cell_pitch:
                raise ValueError(
                    f"liner orifice_diameter is {diameter:g} m, larger than cell_pitch, "
                    f"{self.cell_pitch:g} m; both are in metres"
                )

    def _named(self, numbers: Mapping[str, tuple[str, float]]) -> dict[str, Number]:
        return {
            name: Number(plain_number(getattr(self, name)), unit, high=high) for name, (unit, high) in numbers.items()
        }

    def _gain(self) -> Tensor:
        """|v| at the cell over |v| as measured."""
        alpha, gain = real_tensor(self.open_area_fraction), real_tensor(self.velocity_gain)
        return gain / alpha if self.velocity_reading == "conserved" else gain

    @property
    def surface_porosity(self) -> float | None:
        """Open area over the whole surface, for eq. (2.7)."""
        if self.flow_facing_porosity is not None or self._facing is None:
            return self.flow_facing_porosity
        return self._facing * plain_number(self.open_area_fraction)

    def resonance(self, lowest: float = 100.0, highest: float = 6000.0) -> float:
        """First frequency (Hz) in the given range where the linear reactance is 0.

        Raises:
            ValueError: there is none.
        """
        from scipy.optimize import brentq  # takes a quarter of a second to import

        grid = torch.linspace(lowest, highest, 2000, dtype=torch.float64)
        reactance = self.impedance(grid).imag.detach()
        rising = torch.nonzero((reactance[:-1] < 0) & (reactance[1:] >= 0)).reshape(-1)
        if rising.numel() == 0:
            raise ValueError(f"liner {self.name!r} has no resonance in {lowest:g}-{highest:g} Hz")
        i = int(rising[0])

        def at(frequency: float) -> float:
            return plain_number(self.impedance(frequency).imag)

        return float(brentq(at, float(grid[i]), float(grid[i + 1]), xtol=1e-9))

    def facts(self) -> dict[str, Any]:
        """All arguments, and the resonance, None where there is none."""
        try:
            return {**self.describe(), "resonance_hz": self.resonance()}
        except ValueError:
            return {**self.describe(), "resonance_hz": None}

    def numbers(self) -> dict[str, Number]:
        """Arguments, both parts of the offset, and the state of the gas."""
        offset = self.impedance_offset
        offset = complex(offset.detach() if isinstance(offset, Tensor) else offset)
        temperature, pressure = air_state(self.fluid)
        return {
            **self._arguments(),
            "offset_resistance": Number(offset.real, low=-math.inf),
            "offset_reactance": Number(offset.imag, low=-math.inf),
            "temperature": Number(temperature, "K", 150.0, 1500.0),
            "pressure": Number(pressure, "Pa"),
        }

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """See ``LinerModel``; temperature and pressure move the gas as dry air."""
        changes = self._changes(values)
        if any(name in values for name in OFFSET):
            numbers = self.numbers()
            parts = [values.get(name, numbers[name].value) for name in OFFSET]
            tensors = [torch.as_tensor(part, dtype=torch.float64) for part in parts]
            offset = torch.complex(*tensors)
            tensor = any(isinstance(part, Tensor) for part in parts)
            changes["impedance_offset"] = offset if tensor else complex(offset)
        state = {name: values[name] for name in ("temperature", "pressure") if name in values}
        if state:
            changes["fluid"] = fluid_at(self.fluid, **state)
        return self.replace(**changes)


def air_state(fluid: Fluid) -> tuple[float, float]:
    """Temperature (K) and pressure (Pa) of dry air with the sound speed and density of ``fluid``.

    For gases that are not air they are the state about which c, rho and eta are scaled as those
    of air: c as sqrt(T), rho as p/T, eta by Sutherland's law.
    """
    temperature = plain_number(fluid.sound_speed) ** 2 / (1.4 * GAS_CONSTANT_AIR)
    return temperature, plain_number(fluid.density) * GAS_CONSTANT_AIR * temperature


def fluid_at(fluid: Fluid, temperature: Any = None, pressure: Any = None) -> Fluid:
    """The gas at another temperature (K) or pressure (Pa); gamma and Pr stay."""
    here = air_state(fluid)
    base = Fluid.from_temperature(*here)
    moved = Fluid.from_temperature(
        here[0] if temperature is None else temperature, here[1] if pressure is None else pressure
    )
    scaled: dict[str, Any] = {
        name: getattr(fluid, name) * (getattr(moved, name) / getattr(base, name))
        for name in ("sound_speed", "density", "dynamic_viscosity")
    }
    return dataclasses.replace(fluid, **scaled)
