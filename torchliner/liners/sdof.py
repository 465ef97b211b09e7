"""Single-degree-of-freedom liner: perforate over a cavity, with its nonlinear response."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import (
    frequency_tensor,
    make_plain,
    plain_number,
    real_tensor,
    require_choice,
    require_positive,
)
from torchliner.fluid import GAS_CONSTANT_AIR, Fluid
from torchliner.liners.cavity import cavity_impedance
from torchliner.liners.facesheet import SpeedLaw, facesheet_impedance, speed_law_coefficients
from torchliner.liners.model import LinerModel, Number
from torchliner.names import VELOCITY_READINGS

Parameter = float | Tensor
LENGTH, SHARE = ("m", math.inf), ("1", 1.0)
NUMBERS = {  # arguments above 0: unit and highest value
    "facesheet_thickness": LENGTH,
    "orifice_diameter": LENGTH,
    "porosity": SHARE,
    "cavity_depth": LENGTH,
    "cavity_hydraulic_radius": LENGTH,
    "cavity_porosity": SHARE,
    "open_area_fraction": SHARE,
    "vena_contracta": SHARE,
    "velocity_gain": ("1", math.inf),
}
OFFSET = ("offset_resistance", "offset_reactance")


@dataclass(frozen=True)
class SDoFLiner(LinerModel):
    r"""Perforated plate over a closed cavity: eqs (2.2)-(2.4) of the paper.

    :math:`Z = [Z_0(\omega) + G_{NL}(\omega, |v_c|)]/\alpha + \text{offset}`, normalised by rho c.
    Every numeric argument may be a tensor that requires a gradient.

    Args:
        facesheet_thickness: L_p, m.
        orifice_diameter: d = 2 r_p, m. For a slit its width: r_p is then half the slit.
        porosity: phi_p of the facesheet the orifices see, 0 to 1: local if ``open_area_fraction``
            carries the walls, global otherwise.
        cavity_depth: H_c, m.  cavity_hydraulic_radius: r_c, m; D/2 for a square cavity of side D.
        cavity_porosity: phi_c, 0 to 1.
        open_area_fraction: alpha, the share of the surface that is cell and not rigid wall in
            parallel (section 5.3), 0 to 1.
        vena_contracta: C_vc.
        velocity_reading: which |v| the cell sees: ``as_measured``, |v_c| = |v|, or ``conserved``,
            |v_c| = |v|/alpha. The paper leaves it open.
        velocity_gain: factor on |v|, for a measured velocity that is not that of the cell: |v_c| is
            this times the reading above. 1 in the paper.
        impedance_offset: constant added to Z, normalised (a correction fixed by a measurement).
        cell_pitch: L_c, m, for averages over cells; None if there are no cells.
        flow_facing_porosity: porosity of the whole surface for eq. (2.7);
            default porosity x open_area_fraction.
        fluid: gas.  name: for labels.
    Raises:
        ValueError: a length or porosity outside its range, or a hole larger than the pitch.
    Source: Roncen et al. (2026), section 2 and section 5.3, with the departures named in
        ``liners/cavity.py`` and ``fluid.py``.
    """

    model = "sdof"
    groups = dict.fromkeys(("offset", "impedance_offset"), OFFSET)

    facesheet_thickness: Parameter
    orifice_diameter: Parameter
    porosity: Parameter
    cavity_depth: Parameter
    cavity_hydraulic_radius: Parameter
    cavity_porosity: Parameter = 1.0
    open_area_fraction: Parameter = 1.0
    vena_contracta: Parameter = 0.8
    velocity_reading: str = "as_measured"
    impedance_offset: complex | Tensor = 0j
    cell_pitch: float | None = None
    flow_facing_porosity: float | None = None
    fluid: Fluid = field(default_factory=Fluid)
    name: str = "sdof"
    velocity_gain: Parameter = 1.0

    def __post_init__(self) -> None:
        make_plain(self, tensors=True)
        stated = {} if self.flow_facing_porosity is None else {"flow_facing_porosity": SHARE}
        for name, (unit, high) in {**NUMBERS, **stated}.items():
            value = getattr(self, name)
            require_positive(f"liner {name} (m)" if unit == "m" else f"liner {name}", value)
            if plain_number(value) > high:
                raise ValueError(
                    f"liner {name} is {plain_number(value):g}; it is a fraction, at most 1 (5.5 % "
                    "is 0.055)"
                )
        require_choice("velocity_reading", self.velocity_reading, VELOCITY_READINGS)
        if self.cell_pitch is not None:
            require_positive("liner cell_pitch (m)", self.cell_pitch)
            diameter = plain_number(self.orifice_diameter)
            if diameter > self.cell_pitch:
                raise ValueError(
                    f"liner orifice_diameter is {diameter:g} m, larger than cell_pitch, "
                    f"{self.cell_pitch:g} m; both are in metres"
                )

    @property
    def surface_porosity(self) -> float:
        """Open area over the whole surface, for eq. (2.7)."""
        if self.flow_facing_porosity is not None:
            return self.flow_facing_porosity
        return plain_number(self.porosity) * plain_number(self.open_area_fraction)

    @property
    def hole_diameter(self) -> float:
        """d, m."""
        return plain_number(self.orifice_diameter)

    def speed_law(self, frequency: Any) -> SpeedLaw:
        """Z(|v|) at fixed frequencies as coefficients, each of the shape of ``frequency`` (Hz)."""
        wanted = real_tensor(frequency)
        frequency_tensor(wanted)
        omega = 2 * torch.pi * wanted
        number = {n: real_tensor(getattr(self, n)).to(omega.device) for n in NUMBERS}
        radius, porosity = number["orifice_diameter"] / 2, number["porosity"]
        alpha, k = number["open_area_fraction"], number["velocity_gain"]
        linear = facesheet_impedance(
            omega, number["facesheet_thickness"], radius, porosity, self.fluid
        )
        cavity = cavity_impedance(
            omega, number["cavity_depth"], number["cavity_hydraulic_radius"], self.fluid
        )
        linear = (linear + cavity / number["cavity_porosity"]) / alpha + self.impedance_offset
        a, b, c, d = speed_law_coefficients(
            omega, radius, porosity, number["vena_contracta"], self.fluid
        )
        # |v_c| = k |v|: v_c^2/(v_c + b) = k v^2/(v + b/k), v_c^2.5/(v_c^2.5 + d) likewise.
        k = k / alpha if self.velocity_reading == "conserved" else k
        return SpeedLaw(linear.real, linear.imag, a * k / alpha, b / k, c / alpha, d / k**2.5)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Tensor:
        """Normalised impedance at |v| = ``speed``.

        Args:
            frequency: Hz, > 0, any shape.
            speed: |v| m/s, >= 0, any shape that broadcasts with ``frequency``. The formula is
                built on rms velocities; the replay puts the instantaneous one in (section 3.1).
        Returns:
            Z, complex128, of the broadcast shape.
        Raises:
            ValueError: a frequency not above 0, or a negative or non-finite speed.
        """
        law = self.speed_law(frequency)
        values = real_tensor(speed).to(law.a.device)
        if not bool(torch.isfinite(values).all() and (values >= 0).all()):
            raise ValueError("speed is |v| in m/s; it must be finite and not negative")
        return torch.complex(*law.parts(values))

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
        """Lengths, shares, gain, both parts of the offset, and the state of the gas."""
        offset = self.impedance_offset
        offset = complex(offset.detach() if isinstance(offset, Tensor) else offset)
        temperature, pressure = air_state(self.fluid)
        arguments = {
            name: Number(plain_number(getattr(self, name)), unit, high=high)
            for name, (unit, high) in NUMBERS.items()
        }
        return {
            **arguments,
            "offset_resistance": Number(offset.real, low=-math.inf),
            "offset_reactance": Number(offset.imag, low=-math.inf),
            "temperature": Number(temperature, "K", 150.0, 1500.0),
            "pressure": Number(pressure, "Pa"),
        }

    def with_numbers(self, values: Mapping[str, Any]) -> SDoFLiner:
        """See ``LinerModel``; temperature and pressure move the gas as dry air."""
        changes = {name: value for name, value in values.items() if name in NUMBERS}
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
