"""The laws of sheets, each a class whose fields state units and ranges; ``LAWS`` lists them.

F is that of ``plates.tube_impedance``, C_D a discharge coefficient, M a Mach number (bulk in eq. (2.7) of the paper).
Articles that could not be opened are named as such, with the text that their formula was read in.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import torch
from torch import Tensor

from torchliner.checks import plain_number
from torchliner.fluid import Fluid
from torchliner.liners.model import Mach, Number, Share
from torchliner.liners.plates import Plate, Sheet, goodrich_resistance, tube_impedance

LARGEST_EXPONENT = 700.0  # exp of more overflows float64; the resistance is 0 long before


@dataclass(frozen=True, kw_only=True)
class Perforate(Plate):
    r"""The plate of the paper: eqs (2.2a-c) and (2.4), of L_p t, 2 r_p d, phi_p sigma and C_vc ``vena_contracta`` (0.8
    in the paper, 0.75 for sharp edges).

    Eq. (2.4) in a form exact at v = 0: Re G = a |v|^2/(|v| + b), Im G = -c |v|^2.5/(|v|^2.5 + d).

    Range: porosity below 0.77, above which eq. (2.2b) makes the ends of a thin plate negative.

    Source: Roncen et al. (2026), after Atalla & Sgard (2007), Temiz et al. (2016), Shah et al. (2024). The exponential
        is capped where it would overflow, below about 3e-4 Hz.
    """

    kind = "perforate"
    shading: ClassVar[float] = 1.14  # eq. (2.2b)
    vena_contracta: Share = 0.8

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        return self.at_rest(omega, fluid) + self.in_motion(omega, speed, fluid)

    def at_rest(self, omega: Tensor, fluid: Fluid) -> Tensor:
        """First two terms of eq. (2.2a), normalised."""
        length, share = self.thickness + self.ends(), fluid.sound_speed * self.porosity
        viscous = torch.sqrt(2 * fluid.kinematic_viscosity * omega) * 2 * length / (self.orifice_diameter * share)
        return torch.complex(viscous, viscous + omega * length / share)

    def in_motion(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """G, eq. (2.4): what the jets resist, and the reactance that they take."""
        d, sigma, c = self.orifice_diameter, self.porosity, fluid.sound_speed
        shear = d / 2 * torch.sqrt(omega / fluid.kinematic_viscosity)  # S_h
        growth = 1 + 0.06 * torch.exp((3.74 / shear).clamp(max=LARGEST_EXPONENT))
        a = 2**0.5 / (2 * self.vena_contracta**2 * sigma**2 * c)
        jets = a * (speed * speed / (speed + 2**0.5 * omega * d * growth * sigma))
        most = omega / c * d / 2 / sigma * (0.6 + 1.6 / shear + 0.015 * shear)
        half = (2**0.5 * omega * d / 2 * sigma) ** 2.5 / (0.013 * shear**2)
        power = speed * speed * speed.clamp(min=1e-30).sqrt()  # quicker than **; a slope of 0, not infinity, at rest
        return torch.complex(jets, -most * (power / (power + half)))


@dataclass(frozen=True, kw_only=True)
class Guess(Plate):
    r"""Friction and radiation, an amplitude and a flow that add as Mach numbers.

    .. math::
        R &= \frac{\sqrt{8\nu\omega}}{c\sigma}\Big(1 + \frac td\Big) + \frac{(kd)^2}{8\sigma}
             + \frac{1-\sigma^2}{\sigma}(M_0 + 0.3 M), \qquad M_0 = \frac{|v|}{\sigma c}, \\
        X &= \frac{\omega (t + \delta)}{c\sigma} + \frac{\sqrt{8\nu\omega}}{c\sigma}
             \Big(1 + \frac td\Big), \qquad
        \delta = \frac{8d}{3\pi}(1 - 0.7\sqrt\sigma)\,
             \frac{1 + 5\cdot10^3 M_0^2}{1 + 10^4 M_0^2}\, \frac{1}{1 + 305 M^3}.

    Range: d sqrt(omega/(4 nu)) above 10 (below it friction is too small) and k d below 1. M_0 is taken as the rms in
    the hole, which the texts leave open.

    Source: Guess (1975), J. Sound Vib. 40, 119-137, not opened; as in the code VictorZaia/Impedance-calculation on
        GitHub (0.71 there for 0.7), but for the factor in M_0 of delta, which is as commonly quoted.
    """

    kind = "guess"
    mach: Mach = 0.0

    @property
    def flow_resistance(self) -> float:
        """See ``Sheet``."""
        return plain_number(0.3 * self.mach * (1 - self.porosity**2) / self.porosity)

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        d, share = self.orifice_diameter, self.porosity * fluid.sound_speed
        friction = torch.sqrt(8 * fluid.kinematic_viscosity * omega) * (1 + self.thickness / d)
        radiation = (omega * d / fluid.sound_speed) ** 2 / (8 * self.porosity)
        jets = (1 - self.porosity**2) / self.porosity * (speed / share + 0.3 * self.mach)
        sound = (speed / share) ** 2
        end = 8 / (3 * math.pi) / 0.85 * self.ends(self.mach) * (1 + 5e3 * sound) / (1 + 1e4 * sound)
        return friction / share + radiation + jets + 1j * (friction + omega * (self.thickness + end)) / share


@dataclass(frozen=True, kw_only=True)
class Goodrich(Plate):
    r"""Yu, Ruiz & Kwan: Crandall's tube, slopes in |v| of resistance and mass, grazing flow of M ``mach`` with delta*
    ``displacement_thickness``.

    .. math::
        Z &= \frac{j\omega (t + \epsilon d)}{c\sigma F}
             + 1.336541\,\frac{1-\sigma^2}{2c\,C_D^2\sigma^2}|v|
             + \frac{M}{\sigma(2 + 1.256\,\delta^*/d)} - j\,\frac{2.07\cdot10^{-5}\,k}{\sigma^2}|v|,
        \\ \epsilon &= \frac{0.85 (1 - 0.7\sqrt\sigma)}{1 + 305 M^3}, \qquad
        C_D = 0.80695\,\sigma^{0.05}\, e^{0.2536\, t/d}.

    S_m = -0.0000207 k/sigma^2 of the source, k in 1/cm, keeps its value in seconds.

    Range: C_D at most 1, |v| below sigma (t + epsilon d)/2.07e-5 m/s, above which the mass is negative.

    Source: Yu, Ruiz & Kwan (2008), AIAA 2008-2930, not opened; terms as in a public code (function impedanceUTAS of an
        eduction), there without the 0.85 of epsilon, which is Ingard's; flow as in Roncen et al. (2026), eq. (2.7).
    """

    kind = "goodrich"
    mach: Mach = 0.0
    displacement_thickness: Annotated[Any, Number(unit="m", high=0.1, low_included=True)] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        found, mach = plain_number(self.discharge()), plain_number(self.mach)
        if found > 1:
            text = f"{self.label}: this thickness over diameter and porosity make a discharge coefficient of"
            raise ValueError(f"{text} {found:.3g}; the correlation holds to 1")
        if mach > 0 and plain_number(self.displacement_thickness) == 0:
            both = f"mach is {mach:g} and displacement_thickness is 0 m"
            raise ValueError(f"{self.label}: {both}; state it, 1e-3 to 5e-3 m in most ducts")

    @property
    def flow_resistance(self) -> float:
        """See ``Sheet``."""
        return plain_number(self.grazing())

    def grazing(self) -> Any:
        """``goodrich_resistance``."""
        return goodrich_resistance(self.mach, self.porosity, self.displacement_thickness, self.orifice_diameter)

    def discharge(self) -> Any:
        """C_D."""
        return 0.80695 * self.porosity**0.05 * math.e ** (0.2536 * self.thickness / self.orifice_diameter)

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        tube = tube_impedance(omega, self.thickness + self.ends(self.mach), self.orifice_diameter, fluid)
        jets = 1.336541 * self.jet(speed, self.discharge(), fluid)
        mass = 2.07e-5 * omega / fluid.sound_speed / self.porosity**2 * speed
        return tube / self.porosity + jets + self.grazing() - 1j * mass


@dataclass(frozen=True, kw_only=True)
class Maa(Plate):
    r"""Micro-perforated plate of Maa, the exact tube and not his approximation to it.

    .. math::
        Z = \frac{j\omega t}{c\sigma F} + \frac{\alpha\sqrt{2\omega\rho\eta}}{\sigma\rho c}
            + j\,\frac{0.85\,\omega d}{c\sigma}\,\frac{1}{1 + |v|/(\sigma^2 c)}
            + \frac{1.6}{\pi}\,\frac{1-\sigma^2}{c\,C_D^2\sigma^2}|v|,

    alpha the ``edge_factor``: 0.5 is Maa (1998), 2 his earlier form, for sharp edges.

    Range: perforate constant K = d sqrt(omega/(4 nu)) of 1 to 10, holes below 1 mm, sigma of a few percent.

    Source: Maa (1998), J. Acoust. Soc. Am. 104, 2861, as in the theory page of acoustipy. The terms in |v|: Laly et al.
        (2018), J. Sound Vib., S0022-460X(17)30674-0, as in public MATLAB classes. Neither paper was opened.
    """

    kind = "maa"
    discharge_coefficient: Share = 0.76  # of sharp-edged holes
    edge_factor: Annotated[Any, Number(high=10.0, low_included=True)] = 0.5

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        c = fluid.sound_speed
        edges = self.edge_factor * torch.sqrt(2 * omega * fluid.kinematic_viscosity) / c
        end = 0.85 * self.orifice_diameter / (1 + speed / (self.porosity**2 * c))
        linear = tube_impedance(omega, self.thickness, self.orifice_diameter, fluid) + edges
        jets = 2 * 1.6 / math.pi * self.jet(speed, self.discharge_coefficient, fluid)
        return (linear + 1j * omega * end / c) / self.porosity + jets


@dataclass(frozen=True, kw_only=True)
class Mesh(Sheet):
    r"""Wire mesh or felt as its maker states it: :math:`Z = (R_0 + R_1 |v| + j\omega m)/(\rho c)`.

    R_0 in MKS rayl (1 cgs rayl is 10 of them); R_1 from steady flow, dp = (R_0 + R_1 v) v, of which a tone sees 1.2
    times as much; m of the air that moves in it. Range: that of the flow rig for |v|.

    Source: definition. Forchheimer's law for R_0 and R_1.
    """

    kind = "mesh"
    resistance_rayl: Annotated[Any, Number(unit="Pa s/m", low_included=True)]
    resistance_slope_rayl: Annotated[Any, Number(unit="Pa s2/m2", low_included=True)] = 0.0
    surface_mass: Annotated[Any, Number(unit="kg/m2", low_included=True)] = 0.0

    def impedance(self, omega: Tensor, speed: Tensor, fluid: Fluid) -> Tensor:
        """See ``Sheet``."""
        resistance = self.resistance_rayl + self.resistance_slope_rayl * speed
        found: Tensor = (resistance + 1j * omega * self.surface_mass) / fluid.characteristic_impedance
        return found


# By the ``kind`` of a layer in liner files.
LAWS: dict[str, type[Sheet]] = {law.kind: law for law in (Perforate, Guess, Goodrich, Maa, Mesh)}
