"""Single-degree-of-freedom liner: perforate over a cavity, with its nonlinear response."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import make_plain, plain_number, real_tensor
from torchliner.fluid import Fluid
from torchliner.liners.cavity import cavity_impedance
from torchliner.liners.cell import DEPTH, PLATE, SHARE, CellLiner, Parameter, omega_of, speed_of
from torchliner.liners.facesheet import (
    SpeedLaw,
    facesheet_impedance,
    require_mass,
    speed_law_coefficients,
)
from torchliner.liners.model import Number

NUMBERS = {  # arguments above 0: unit and highest value
    "facesheet_thickness": PLATE,
    "orifice_diameter": PLATE,
    "porosity": SHARE,
    "cavity_depth": DEPTH,
    "cavity_hydraulic_radius": DEPTH,
    "cavity_porosity": SHARE,
    "open_area_fraction": SHARE,
    "vena_contracta": SHARE,
    "velocity_gain": ("1", math.inf),
}


@dataclass(frozen=True)
class SDoFLiner(CellLiner):
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
        ValueError: a length or porosity outside its range, a hole larger than the pitch, or a thin
            plate so open that it would feed sound.
    Source: Roncen et al. (2026), section 2 and section 5.3, with the departures named in
        ``liners/cavity.py`` and ``fluid.py``.
    """

    model = "sdof"

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
        self._check(NUMBERS)
        plate = (self.facesheet_thickness, self.orifice_diameter, self.porosity)
        require_mass(f"liner {self.name!r}", *map(plain_number, plate))

    @property
    def hole_diameter(self) -> float:
        """d, m."""
        return plain_number(self.orifice_diameter)

    @property
    def _facing(self) -> float:
        return plain_number(self.porosity)

    def speed_law(self, frequency: Any) -> SpeedLaw:
        """Z(|v|) at fixed frequencies as coefficients, each of the shape of ``frequency`` (Hz)."""
        omega = omega_of(frequency)
        number = {n: real_tensor(getattr(self, n)).to(omega.device) for n in NUMBERS}
        radius, porosity = number["orifice_diameter"] / 2, number["porosity"]
        alpha, k = number["open_area_fraction"], self._gain().to(omega.device)
        linear = facesheet_impedance(omega, number["facesheet_thickness"], radius, porosity, self.fluid)
        cavity = cavity_impedance(omega, number["cavity_depth"], number["cavity_hydraulic_radius"], self.fluid)
        linear = (linear + cavity / number["cavity_porosity"]) / alpha + self.impedance_offset
        a, b, c, d = speed_law_coefficients(omega, radius, porosity, number["vena_contracta"], self.fluid)
        # |v_c| = k |v|: v_c^2/(v_c + b) = k v^2/(v + b/k), v_c^2.5/(v_c^2.5 + d) likewise.
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
        return torch.complex(*law.parts(speed_of(speed).to(law.a.device)))

    def _arguments(self) -> dict[str, Number]:
        return self._named(NUMBERS)

    def _changes(self, values: Mapping[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in values.items() if name in NUMBERS}
