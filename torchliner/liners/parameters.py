"""A liner as a function of named real numbers, for derivatives, tolerances and fits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import torch

from torchliner.checks import plain_number, require_choice
from torchliner.fluid import GAS_CONSTANT_AIR, Fluid
from torchliner.liners.sdof import SDoFLiner


@dataclass(frozen=True)
class Number:
    """What a parameter is.

    Args:
        quantity: kind of its units, as in ``io.units``.
        unit: SI, "1" if it has none.
        low, high: open lower and closed upper limit of what makes sense.
    """

    quantity: str
    unit: str
    low: float = 0.0
    high: float = math.inf


_LENGTH, _SHARE = Number("length", "m"), Number("number", "1", 0.0, 1.0)
_SIGNED = Number("number", "1", -math.inf)
NUMBERS: dict[str, Number] = {
    "facesheet_thickness": _LENGTH,
    "orifice_diameter": _LENGTH,
    "porosity": _SHARE,
    "cavity_depth": _LENGTH,
    "cavity_hydraulic_radius": _LENGTH,
    "cavity_porosity": _SHARE,
    "open_area_fraction": _SHARE,
    "vena_contracta": _SHARE,
    "velocity_gain": Number("number", "1"),
    "offset_resistance": _SIGNED,
    "offset_reactance": _SIGNED,
    "temperature": Number("temperature", "K", 150.0, 1500.0),
    "pressure": Number("pressure", "Pa"),
}
GROUPS = dict.fromkeys(("offset", "impedance_offset"), ("offset_resistance", "offset_reactance"))


def expand_names(names: Iterable[str]) -> tuple[str, ...]:
    """Names with ``offset`` as its two parts.

    Raises:
        ValueError: an unknown name (the nearest is given), or one that is named twice.
    """
    found: list[str] = []
    for name in names:
        if name not in GROUPS:
            require_choice("parameter", name, [*NUMBERS, "offset"])
        for each in GROUPS.get(name, (name,)):
            if each in found:
                raise ValueError(f"parameter {each} is named twice")
            found.append(each)
    return tuple(found)


def require_sdof(liner: Any) -> SDoFLiner:
    """Refuse liners without named parameters."""
    if not isinstance(liner, SDoFLiner):
        raise TypeError(
            f"liner is {type(liner).__name__}; only an SDoFLiner has parameters to vary (a table "
            "has none)"
        )
    return liner


def air_state(fluid: Fluid) -> tuple[float, float]:
    """Temperature (K) and pressure (Pa) of dry air with the sound speed and density of ``fluid``.

    For gases that are not air they are the state about which c, rho and eta are scaled as those
    of air: c as sqrt(T), rho as p/T, eta by Sutherland's law.
    """
    temperature = plain_number(fluid.sound_speed) ** 2 / (1.4 * GAS_CONSTANT_AIR)
    return temperature, plain_number(fluid.density) * GAS_CONSTANT_AIR * temperature


def value_of(liner: SDoFLiner, name: str) -> float:
    """The number of that name, SI."""
    if name in ("temperature", "pressure"):
        return air_state(liner.fluid)[name == "pressure"]
    if name.startswith("offset_"):
        offset = liner.impedance_offset
        value = complex(offset.detach() if isinstance(offset, torch.Tensor) else offset)
        return value.real if name == "offset_resistance" else value.imag
    return plain_number(getattr(liner, name))


def with_values(liner: SDoFLiner, values: Mapping[str, Any]) -> SDoFLiner:
    """A copy with other numbers.

    Args:
        liner: SDoF liner.
        values: by name, SI; floats or 0-d float64 tensors, through which derivatives pass.
    """
    changes = {name: value for name, value in values.items() if hasattr(liner, name)}
    parts = [values.get(name) for name in GROUPS["offset"]]
    if any(part is not None for part in parts):
        filled = [value_of(liner, name) if part is None else part
                  for name, part in zip(GROUPS["offset"], parts, strict=True)]  # fmt: skip
        tensors = [torch.as_tensor(part, dtype=torch.float64) for part in filled]
        changes["impedance_offset"] = torch.complex(*tensors)
    if "temperature" in values or "pressure" in values:
        changes["fluid"] = _fluid_at(liner.fluid, values)
    return liner.replace(**changes)


def _fluid_at(fluid: Fluid, values: Mapping[str, Any]) -> Fluid:
    """The gas at another temperature (K) or pressure (Pa); gamma and Pr stay."""
    here = air_state(fluid)
    base = Fluid.from_temperature(*here)
    moved = Fluid.from_temperature(
        values.get("temperature", here[0]), values.get("pressure", here[1])
    )
    scaled: dict[str, Any] = {
        name: getattr(fluid, name) * (getattr(moved, name) / getattr(base, name))
        for name in ("sound_speed", "density", "dynamic_viscosity")
    }
    return dataclasses.replace(fluid, **scaled)


def plain_liner(liner: SDoFLiner, values: Mapping[str, float]) -> SDoFLiner:
    """``with_values`` without tensors, to be kept and written."""
    moved = with_values(liner, values)
    return moved.replace(impedance_offset=complex(moved.impedance_offset))
