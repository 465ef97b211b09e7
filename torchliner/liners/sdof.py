r"""Single-degree-of-freedom liners: the perforate over a cavity of the paper; the same with factors of ours, and with
one law of lost mass, ``EndLossSDoFLiner``: round holes and slits, with and without flow.

Of the reactance E of the plate's ends, all that is not the air inside the holes, the share

    s^p = a^p + (k M)^p,    a = A xi^2.5/(xi^2.5 + B^2.5),    xi = |v|/(phi_p omega D_h),

is lost: a to the jets and the turbulence that |v| stands for, once the air in a hole moves by some B hydraulic
diameters, and k M to grazing flow. A = 1/2, the end that the jet leaves by; B and k are fitted to resolved liners, and
p = 2 lies between their sum and the larger of the two (docs/mass_loss.md). The law takes the place of eq. (2.4b), whose
largest loss is half as large for a slit; resistance is that of eq. (2.4a).
"""

from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, Self

import torch
from torch import Tensor

from torchliner.checks import plain_number, real_tensor
from torchliner.liners.laws import Perforate
from torchliner.liners.layered import CellLiner
from torchliner.liners.model import Coefficient, Depth, Factor, FactorFrom0, Length, Mach, Number, Share, ShareFrom0
from torchliner.liners.plates import cavity_propagation
from torchliner.names import VELOCITY_READINGS

SAME_MACH = 0.01


@dataclass(frozen=True)
class SDoFLiner(CellLiner):
    r"""Perforated plate over a closed cavity: eqs (2.2)-(2.4) of the paper.

    :math:`Z = [Z_0(\omega) + G_{NL}(\omega, |v_c|)]/\alpha + \text{offset}`, normalised by rho c.

    Args:
        facesheet_thickness: L_p, m.  orifice_diameter: d = 2 r_p, m; of a slit its width.
        porosity: phi_p, 0 to 1: local if ``open_area_fraction`` carries the walls, global otherwise.
        cavity_depth: H_c, m.  cavity_hydraulic_radius: r_c, m; D/2 for a square cavity of side D.
        cavity_porosity: phi_c, 0 to 1.  vena_contracta: C_vc.
        open_area_fraction, ...: by keyword, see ``CellLiner``.
    Raises:
        ValueError: a value outside its range.
    Source: Roncen et al. (2026), sections 2 and 5.3, with the departures in ``liners/plates.py`` and ``fluid.py``.
    """

    model = "sdof"

    facesheet_thickness: Length
    orifice_diameter: Length
    porosity: Share
    cavity_depth: Depth
    cavity_hydraulic_radius: Depth
    cavity_porosity: Share = 1.0
    vena_contracta: Share = 0.8

    def _front(self) -> Perforate:
        shared = {name: getattr(self, name) for name in ("orifice_diameter", "porosity", "vena_contracta")}
        return Perforate(thickness=self.facesheet_thickness, **shared)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Tensor:
        """Normalised impedance, complex128, of the broadcast shape of frequency (Hz) and |v| (m/s); ValueError for a
        frequency not above 0, a negative or non-finite speed."""
        omega, speed = self.seen(frequency, speed)
        way = cavity_propagation(omega, self.cavity_hydraulic_radius, self.fluid) * self.cavity_depth
        cell = self.front.at_rest(omega, self.fluid) + 1 / torch.tanh(way) / self.cavity_porosity
        found: Tensor = (cell + self.in_motion(omega, speed)) / self.open_area_fraction + self.impedance_offset
        return found

    def in_motion(self, omega: Tensor, speed: Tensor) -> Any:
        """What |v_c| and flow add to the impedance of a cell."""
        return self.front.in_motion(omega, speed, self.fluid)


@dataclass(frozen=True)
class FlowSDoFLiner(SDoFLiner):
    """Base of ``SDoFLiner``s that take the Mach number of the flow over the plane.

    ``mach``: None takes that which the data state, 0 where they state none.
    """

    mach: Mach = None

    flow_factors: ClassVar[tuple[str, ...]]  # all 0 where the law does not depend on the flow

    def __post_init__(self) -> None:
        super().__post_init__()
        takes_mach = any(plain_number(getattr(self, name)) for name in self.flow_factors)
        self.settle(lacks_mach=self.mach is None and takes_mach)

    def in_flow(self, mach: float | None) -> Self:
        """See ``LinerModel``."""
        if mach is None or self.mach is None:
            return self if mach is None else self.replace(mach=mach)
        if abs(plain_number(self.mach) - mach) > SAME_MACH:
            both = f"states mach {plain_number(self.mach):g}, and the data {mach:g}"
            raise ValueError(f"{self.label} {both}; leave mach out of the liner, which then takes that of the data")
        return self

    @classmethod
    def of(cls, liner: SDoFLiner, **further: Any) -> Self:
        """The same liner with further parameters, SI."""
        return cls(**{each.name: getattr(liner, each.name) for each in fields(liner)} | further)


@dataclass(frozen=True)
class AdjustedSDoFLiner(FlowSDoFLiner):
    r"""``SDoFLiner`` with factors on the terms that the resolved cases find wrong; neutral by default.

    With the reactance of both ends :math:`E = 2\varepsilon_e \omega/(c \varphi_p \alpha)` of eq. (2.2b) and the flow's
    Mach number M::

        X = X_2.2 + (end_correction - 1) E - mass_loss c |v|^2.5/(|v|^2.5 + s^2.5 d)
            - mach_mass_loss M end_correction E,
        R = R_2.4 + mach_resistance M/sigma,       sigma the open area of the whole surface.

    Args:
        end_correction: factor on the mass of both ends.
        mass_loss: factor on c of (2.4b).  mass_loss_speed: factor s on the |v| at half the loss.
        mach_resistance: resistance over mach/open area of the surface.
        mach_mass_loss: share of the ends' mass that is lost, over mach.
    Source: eqs (2.2b), (2.4) of Roncen et al. (2026); the factors are this package's. Resistance in M/sigma is the form
        of eq. (2.7).
    """

    model = "adjusted-sdof"
    flow_factors = ("mach_resistance", "mach_mass_loss")

    end_correction: FactorFrom0 = 1.0
    mass_loss: FactorFrom0 = 1.0
    mass_loss_speed: Factor = 1.0
    mach_resistance: Coefficient = 0.0
    mach_mass_loss: Coefficient = 0.0

    def in_motion(self, omega: Tensor, speed: Tensor) -> Tensor:
        """See ``SDoFLiner``."""
        plate, gas, mach = self.front, self.fluid, 0.0 if self.mach is None else self.mach
        ends = omega * plate.ends() / (gas.sound_speed * self.porosity)
        gained = self.end_correction * (1 - self.mach_mass_loss * mach) - 1
        resistance = self.mach_resistance * mach * self.open_area_fraction / self.open_area()
        jets, lost = (plate.in_motion(omega, each, gas) for each in (speed, speed / self.mass_loss_speed))
        return torch.complex(jets.real + resistance, gained * ends + self.mass_loss * lost.imag)


@dataclass(frozen=True)
class EndLossSDoFLiner(FlowSDoFLiner):
    """``SDoFLiner`` with the module's law in place of eq. (2.4b), fitted up to Mach 0.3.

    Args:
        hydraulic_diameter: D_h of a hole, m: ``orifice_diameter`` (None) for round ones, twice the width for slits.
        end_loss: A.  loss_displacement: B.  mach_loss: k.
        combination: p, 1 for the sum; towards the larger one with p.
    Source: docs/mass_loss.md; the share of one half is Ingard's (1953) for strong jets.
    """

    model = "sdof-end-loss"
    flow_factors = ("mach_loss",)

    hydraulic_diameter: Annotated[Any, Number(unit="m", high=0.2)] = None
    end_loss: ShareFrom0 = 0.5
    loss_displacement: Factor = 0.29  # scripts/mass_loss.py
    mach_loss: FactorFrom0 = 1.54  # the same
    combination: Annotated[Any, Number(high=8.0)] = 2.0

    def __post_init__(self) -> None:
        if self.hydraulic_diameter is None:
            self.settle(hydraulic_diameter=self.orifice_diameter)
        super().__post_init__()

    def in_motion(self, omega: Tensor, speed: Tensor) -> Tensor:
        """See ``SDoFLiner``."""
        plate, gas, power = self.front, self.fluid, self.combination
        inside = omega * self.facesheet_thickness / (gas.sound_speed * self.porosity)
        offset = torch.as_tensor(self.impedance_offset, dtype=torch.complex128).imag
        ends = plate.at_rest(omega, gas).imag - inside + offset * self.open_area_fraction
        enough = self.loss_displacement * self.porosity * omega * self.hydraulic_diameter
        half, moved = (each * each * each.clamp(min=1e-30).sqrt() for each in (enough, speed))  # to the power of 2.5
        # From the larger one, so that neither power underflows; 1e-300 keeps slopes finite at 0.
        share = (self.end_loss * moved / (moved + half)).clamp(min=1e-300)
        floor = real_tensor(self.mach_loss * (0.0 if self.mach is None else self.mach)).to(share.device)
        larger = torch.maximum(share, floor)
        both = (share / larger) ** power + (floor / larger) ** power
        return torch.complex(plate.in_motion(omega, speed, gas).real, -ends * larger * both ** (1 / power))


def velocity_readings(liner: CellLiner) -> dict[str, CellLiner]:
    """The liner with the other reading of |v|; ValueError if both are the same here."""
    if plain_number(liner.open_area_fraction) == 1:
        raise ValueError("open_area_fraction is 1: |v| as measured and |v| conserved are the same there")
    return {name: liner.replace(velocity_reading=name) for name in VELOCITY_READINGS if name != liner.velocity_reading}


def porosity_readings(liner: SDoFLiner) -> dict[str, SDoFLiner]:
    """The liner with its porosity read in the other ways that the paper leaves open: holes over the whole surface
    (global, the cavity as all of it or as its share) or cells beside a rigid wall (local, square cavities of side 2 r_c
    in cells of side L_c); ValueError where the geometry does not say, or a constant offset hangs on the reading."""
    if complex(liner.impedance_offset) != 0:
        raise ValueError("the liner's impedance_offset was fixed under its own reading of the porosity")
    porosity, share = plain_number(liner.porosity), plain_number(liner.open_area_fraction)
    found, whole = {}, liner.replace(porosity=porosity * share, open_area_fraction=1.0)
    if share == 1:
        if liner.cell_pitch is None:
            raise ValueError("the liner states no cell_pitch, which the local reading needs")
        share = (2 * plain_number(liner.cavity_hydraulic_radius) / liner.cell_pitch) ** 2
        if not porosity < share < 1:
            raise ValueError(f"the square of cavity over pitch, {share:.3g}, is no share of a cell")
        cells = liner.replace(porosity=porosity / share, open_area_fraction=share, cavity_porosity=1.0)
        found[f"local {100 * porosity / share:.3g} %, wall in parallel"] = cells
    others = {f"global, phi_c = {phi:.3g}": whole.replace(cavity_porosity=phi) for phi in (1.0, share)}
    return found | {name: other for name, other in others.items() if other != liner}
