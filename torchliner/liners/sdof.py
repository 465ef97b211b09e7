"""Single-degree-of-freedom liner: perforate over a cavity, with its nonlinear response."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import torch
from scipy.optimize import brentq
from torch import Tensor

from torchliner.checks import (
    frequency_tensor,
    plain_number,
    real_tensor,
    require_choice,
    require_positive,
)
from torchliner.fluid import Fluid
from torchliner.liners.cavity import cavity_impedance
from torchliner.liners.facesheet import facesheet_impedance
from torchliner.liners.nonlinear import SpeedLaw, speed_law_coefficients
from torchliner.names import VELOCITY_READINGS

Parameter = float | Tensor


@dataclass(frozen=True)
class SDoFLiner:
    r"""Perforated plate over a closed cavity: eqs (2.2)-(2.4) of the paper.

    :math:`Z = [Z_0(\omega) + G_{NL}(\omega, |v_c|)]/\alpha + \text{offset}`, normalised by rho c.
    Every numeric argument may be a tensor that requires a gradient.

    Args:
        facesheet_thickness: L_p, m.
        orifice_diameter: d = 2 r_p, m. For a slit its width: r_p is then half the slit.
        porosity: phi_p of the facesheet the orifices see, 0 to 1: local if ``open_area_fraction``
            carries the walls, global otherwise.
        cavity_depth: H_c, m.
        cavity_hydraulic_radius: r_c, m; D/2 for a square cavity of side D.
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
        fluid: gas.
        name: for labels.
    Raises:
        ValueError: a length or porosity outside its range, or a hole larger than the pitch.
    Source: Roncen et al. (2026), section 2 and section 5.3, with the departures named in
        ``liners/bessel.py`` and ``fluid.py``.
    """

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
        for name in ("facesheet_thickness", "orifice_diameter", "cavity_depth"):
            require_positive(f"liner {name} (m)", getattr(self, name))
        require_positive("liner cavity_hydraulic_radius (m)", self.cavity_hydraulic_radius)
        require_positive("liner velocity_gain", self.velocity_gain)
        fractions = ["porosity", "cavity_porosity", "open_area_fraction", "vena_contracta"]
        if self.flow_facing_porosity is not None:
            fractions.append("flow_facing_porosity")
        for name in fractions:
            require_positive(f"liner {name}", getattr(self, name))
            share = plain_number(getattr(self, name))
            if share > 1:
                raise ValueError(
                    f"liner {name} is {share:g}; it is a fraction, at most 1 (5.5 % is 0.055)"
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

    def speed_law(self, frequency: Any) -> SpeedLaw:
        """Z(|v|) at fixed frequencies as coefficients, each of the shape of ``frequency`` (Hz)."""
        wanted = real_tensor(frequency)
        frequency_tensor(wanted)
        omega = 2 * torch.pi * wanted
        radius = real_tensor(self.orifice_diameter).to(omega.device) / 2
        porosity = real_tensor(self.porosity).to(omega.device)
        alpha = real_tensor(self.open_area_fraction).to(omega.device)
        depth = real_tensor(self.cavity_depth).to(omega.device)
        hydraulic = real_tensor(self.cavity_hydraulic_radius).to(omega.device)
        thickness = real_tensor(self.facesheet_thickness).to(omega.device)
        linear = facesheet_impedance(omega, thickness, radius, porosity, self.fluid)
        cavity = cavity_impedance(omega, depth, hydraulic, self.fluid)
        linear = (linear + cavity / self.cavity_porosity) / alpha + self.impedance_offset
        contraction = real_tensor(self.vena_contracta).to(omega.device)
        a, b, c, d = speed_law_coefficients(omega, radius, porosity, contraction, self.fluid)
        # |v_c| = k |v|: v_c^2/(v_c + b) = k v^2/(v + b/k), v_c^2.5/(v_c^2.5 + d) likewise.
        k = real_tensor(self.velocity_gain).to(omega.device)
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
        grid = torch.linspace(lowest, highest, 2000, dtype=torch.float64)
        reactance = self.impedance(grid).imag.detach()
        rising = torch.nonzero((reactance[:-1] < 0) & (reactance[1:] >= 0)).reshape(-1)
        if rising.numel() == 0:
            raise ValueError(f"liner {self.name!r} has no resonance in {lowest:g}-{highest:g} Hz")
        i = int(rising[0])

        def at(frequency: float) -> float:
            return plain_number(self.impedance(frequency).imag)

        return float(brentq(at, float(grid[i]), float(grid[i + 1]), xtol=1e-9))

    def replace(self, **changes: Any) -> SDoFLiner:
        """A copy with some arguments changed."""
        return dataclasses.replace(self, **changes)

    def describe(self) -> dict[str, Any]:
        """All arguments as plain values, for provenance."""
        plain: dict[str, Any] = {"model": "sdof"}
        for key, value in vars(self).items():
            if isinstance(value, Tensor):
                value = value.detach().item()
            if isinstance(value, Fluid):
                value = dataclasses.asdict(value)
            if isinstance(value, complex):
                value = [value.real, value.imag]
            plain[key] = value
        return plain
