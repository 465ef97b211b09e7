"""Single-degree-of-freedom liners: the perforate over a cavity of the paper, and the same with factors of ours."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

import torch
from torch import Tensor

from torchliner.checks import plain_number, real_tensor
from torchliner.liners.cavity import cavity_impedance
from torchliner.liners.cell import CellLiner, omega_of, speed_of
from torchliner.liners.parameters import Coefficient, Depth, Factor, FactorFrom0, Length, Mach, Share
from torchliner.liners.sheets.perforate import SpeedLaw, coefficients, end_correction, linear_impedance, require_mass

SAME_MACH = 0.01


@dataclass(frozen=True)
class SDoFLiner(CellLiner):
    r"""Perforated plate over a closed cavity: eqs (2.2)-(2.4) of the paper.

    :math:`Z = [Z_0(\omega) + G_{NL}(\omega, |v_c|)]/\alpha + \text{offset}`, normalised by rho c. Every numeric
    argument may be a tensor that requires a gradient.

    Args:
        facesheet_thickness: L_p, m.
        orifice_diameter: d = 2 r_p, m. For a slit its width: r_p is then half the slit.
        porosity: phi_p of the facesheet the orifices see, 0 to 1: local if ``open_area_fraction`` carries the walls,
            global otherwise.
        cavity_depth: H_c, m.  cavity_hydraulic_radius: r_c, m; D/2 for a square cavity of side D.
        cavity_porosity: phi_c, 0 to 1.  vena_contracta: C_vc.
        open_area_fraction, velocity_reading, velocity_gain, impedance_offset, cell_pitch, flow_facing_porosity, fluid,
            name: by keyword, see ``CellLiner``.
    Raises:
        ValueError: a length or porosity outside its range, a hole larger than the pitch, or a thin plate so open that
            it would feed sound.
    Source: Roncen et al. (2026), section 2 and section 5.3, with the departures named in ``liners/cavity.py`` and
        ``fluid.py``.
    """

    model = "sdof"

    facesheet_thickness: Length
    orifice_diameter: Length
    porosity: Share
    cavity_depth: Depth
    cavity_hydraulic_radius: Depth
    cavity_porosity: Share = 1.0
    vena_contracta: Share = 0.8

    def __post_init__(self) -> None:
        super().__post_init__()
        plate = (self.facesheet_thickness, self.orifice_diameter, self.porosity)
        require_mass(f"liner {self.name!r}", *map(plain_number, plate))

    @property
    def hole_diameter(self) -> float:
        """d, m."""
        return plain_number(self.orifice_diameter)

    @property
    def facing(self) -> float:
        """See ``CellLiner``."""
        return plain_number(self.porosity)

    def speed_law(self, frequency: Any) -> SpeedLaw:
        """Z(|v|) at fixed frequencies as coefficients, each of the shape of ``frequency`` (Hz)."""
        omega = omega_of(frequency)
        number = self.tensors(omega.device)
        radius, porosity = number["orifice_diameter"] / 2, number["porosity"]
        alpha, k = number["open_area_fraction"], self.gain().to(omega.device)
        linear = linear_impedance(omega, number["facesheet_thickness"], radius, porosity, self.fluid)
        cavity = cavity_impedance(omega, number["cavity_depth"], number["cavity_hydraulic_radius"], self.fluid)
        linear = (linear + cavity / number["cavity_porosity"]) / alpha + self.impedance_offset
        a, b, c, d = coefficients(omega, radius, porosity, number["vena_contracta"], self.fluid)
        # |v_c| = k |v|: v_c^2/(v_c + b) = k v^2/(v + b/k), v_c^2.5/(v_c^2.5 + d) likewise.
        return SpeedLaw(linear.real, linear.imag, a * k / alpha, b / k, c / alpha, d / k**2.5)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Tensor:
        """Normalised impedance at |v| = ``speed``, complex128, of the broadcast shape.

        Args:
            frequency: Hz, > 0, any shape.
            speed: |v| m/s, >= 0, any shape that broadcasts with ``frequency``. The formula is built on rms velocities;
                the replay puts the instantaneous one in (section 3.1).
        Raises:
            ValueError: a frequency not above 0, or a negative or non-finite speed.
        """
        law = self.speed_law(frequency)
        return torch.complex(*law.parts(speed_of(speed).to(law.a.device)))


@dataclass(frozen=True)
class FlowSDoFLiner(SDoFLiner):
    """Base of ``SDoFLiner``s whose own ``speed_law`` takes the Mach number of the flow over the plane.

    Args:
        mach: 0 to 1; None: that which the data state, 0 where they state none.
    """

    mach: Mach = None

    def in_flow(self, mach: float | None) -> Self:
        """See ``LinerModel``."""
        if mach is None:
            return self
        if self.mach is None:
            return self.replace(mach=mach)
        stated = plain_number(self.mach)
        if abs(stated - mach) > SAME_MACH:
            raise ValueError(
                f"liner {self.name!r} states mach {stated:g}, and the data {mach:g}; leave mach out of the liner, "
                "which then takes that of the data"
            )
        return self

    @classmethod
    def of(cls, liner: SDoFLiner, **further: Any) -> Self:
        """The same liner with further parameters, SI; those it has already stay otherwise."""
        own = {each.name: getattr(liner, each.name) for each in fields(liner)}
        return cls(**own | further)


@dataclass(frozen=True)
class AdjustedSDoFLiner(FlowSDoFLiner):
    r"""``SDoFLiner`` with factors on the terms that the resolved cases find wrong; neutral by default.

    With the reactance of both ends :math:`E = 2\varepsilon_e \omega/(c \varphi_p \alpha)` of eq. (2.2b) and the flow's
    Mach number M::

        X = X_2.2 + (end_correction - 1) E - mass_loss c |v|^2.5/(|v|^2.5 + s^2.5 d)
            - mach_mass_loss M end_correction E,
        R = R_2.4 + mach_resistance M/sigma,       sigma the open area of the whole surface.

    Args:
        mach: see ``FlowSDoFLiner``; given, not fitted.
        end_correction: factor on the mass of both ends, at least 0.
        mass_loss: factor on c of (2.4b), the mass that is lost at high |v|, at least 0.
        mass_loss_speed: factor s on the |v| at which half of it is lost, above 0.
        mach_resistance: resistance over mach/open area of the surface.
        mach_mass_loss: share of the ends' mass that is lost, over mach.
    Raises:
        ValueError: as ``SDoFLiner``, and a factor outside its range.
    Source: eqs (2.2b), (2.4) of Roncen et al. (2026); the factors are this package's. Resistance in M/sigma is the form
        of eq. (2.7) with its boundary layer in the coefficient.
    """

    model = "adjusted-sdof"

    end_correction: FactorFrom0 = 1.0
    mass_loss: FactorFrom0 = 1.0
    mass_loss_speed: Factor = 1.0
    mach_resistance: Coefficient = 0.0
    mach_mass_loss: Coefficient = 0.0

    @property
    def lacks_mach(self) -> bool:
        """See ``LinerModel``."""
        return self.mach is None and any(map(plain_number, (self.mach_resistance, self.mach_mass_loss)))

    def speed_law(self, frequency: Any) -> SpeedLaw:
        """See ``SDoFLiner``."""
        law = super().speed_law(frequency)
        number = self.tensors(law.a.device)
        porosity, alpha = number["porosity"], number["open_area_fraction"]
        facing = self.flow_facing_porosity
        open_area = porosity * alpha if facing is None else real_tensor(facing)
        length = 2 * end_correction(number["orifice_diameter"] / 2, porosity)
        ends = omega_of(frequency) * length / (self.fluid.sound_speed * porosity * alpha)
        factor, mach = number["end_correction"], number.get("mach", 0.0)
        gained = factor - 1 - number["mach_mass_loss"] * mach * factor
        return SpeedLaw(
            law.resistance + number["mach_resistance"] * mach / open_area,
            law.reactance + gained * ends,
            law.a,
            law.b,
            law.c * number["mass_loss"],
            law.d * number["mass_loss_speed"] ** 2.5,
        )
