"""Temperature and pressure of a liner's gas, about which it is scaled as dry air is."""

from __future__ import annotations

import dataclasses
from typing import Any

from torchliner.checks import plain_number
from torchliner.fluid import GAS_CONSTANT_AIR, Fluid


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
