"""The laws of sheets; ``table.py`` lists them.

A law gives the pressure drop over the velocity of a sheet, normalised by rho c, complex128, e^(j omega t), from

    omega: rad/s, above 0;  speed: |v| in front of the sheet, m/s, rms (the replay puts the instantaneous one in), of a
    shape that broadcasts with ``omega``;  fluid: the gas;

and its parameters, tensors, by keyword. Their types state units and ranges. Of plates they are t ``thickness``, d
``orifice_diameter`` and sigma ``porosity``, open area over that of the plate; in grazing flow M ``mach`` (bulk in eq.
(2.7) of the paper, on the centre line in NASA's use) and delta* ``displacement_thickness``; C_D
``discharge_coefficient``.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import torch
from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.liners.parameters import Length, Mach, Range, Share
from torchliner.liners.sheets.terms import (
    TONE,
    fok_sum,
    goodrich_resistance,
    ingard_end,
    jet_resistance,
    left_by_flow,
    tube_impedance,
)

Displacement = Annotated[Any, Range("m", high=0.1, low_included=True)]  # displacement thickness of a boundary layer
SHARP = 0.76  # C_D of sharp-edged holes, with which the two-parameter model is used


def guess(
    omega: Tensor,
    speed: Tensor,
    fluid: Fluid,
    *,
    thickness: Length,
    orifice_diameter: Length,
    porosity: Share,
    mach: Mach = 0.0,
) -> Tensor:
    r"""Plate of Guess: friction and radiation, an amplitude and a flow that add as Mach numbers.

    .. math::
        R &= \frac{\sqrt{8\nu\omega}}{c\sigma}\Big(1 + \frac td\Big) + \frac{(kd)^2}{8\sigma}
             + \frac{1-\sigma^2}{\sigma}(M_0 + 0.3 M), \qquad M_0 = \frac{|v|}{\sigma c}, \\
        X &= \frac{\omega (t + \delta)}{c\sigma} + \frac{\sqrt{8\nu\omega}}{c\sigma}
             \Big(1 + \frac td\Big), \qquad
        \delta = \frac{8d}{3\pi}(1 - 0.7\sqrt\sigma)\,
             \frac{1 + 5\cdot10^3 M_0^2}{1 + 10^4 M_0^2}\, \frac{1}{1 + 305 M^3}.

    Range: holes wide against the viscous layer, d sqrt(omega/(4 nu)) above 10 (below it friction
    is too small: it lacks Poiseuille's limit), and k d below 1. M_0 is that of the hole; whether Guess means rms or
    peak is not said where this was read, rms is taken: the jet of a discharge coefficient sqrt(TONE/2) = 0.775 (a peak
    would mean 0.65).

    Source: Guess (1975), J. Sound Vib. 40, 119-137, which could not be opened. All terms but one are as in the code
        VictorZaia/Impedance-calculation on GitHub (0.71 there for 0.7), after Malmary. The factor in M_0 of delta,
        which halves it in strong sound, is as commonly quoted and was found in no text that could be opened.
    """
    share = porosity * fluid.sound_speed
    sound = (speed / share) ** 2
    friction = torch.sqrt(8 * fluid.kinematic_viscosity * omega) * (1 + thickness / orifice_diameter)
    radiation = (omega * orifice_diameter / fluid.sound_speed) ** 2 / (8 * porosity)
    jets = (1 - porosity**2) / porosity * (speed / share + 0.3 * mach)
    end = 8 / (3 * math.pi) * orifice_diameter * (1 - 0.7 * torch.sqrt(porosity))
    end = end * (1 + 5e3 * sound) / (1 + 1e4 * sound) * left_by_flow(mach)
    reactance = (friction + omega * (thickness + end)) / share
    return friction / share + radiation + jets + 1j * reactance


def goodrich(
    omega: Tensor,
    speed: Tensor,
    fluid: Fluid,
    *,
    thickness: Length,
    orifice_diameter: Length,
    porosity: Share,
    mach: Mach = 0.0,
    displacement_thickness: Displacement = 0.0,
) -> Tensor:
    r"""Plate of Yu, Ruiz & Kwan: Crandall's tube, slopes in |v| of resistance and mass, grazing flow.

    .. math::
        Z &= \frac{j\omega (t + \epsilon d)}{c\sigma F}
             + 1.336541\,\frac{1-\sigma^2}{2c\,C_D^2\sigma^2}|v|
             + \frac{M}{\sigma(2 + 1.256\,\delta^*/d)} - j\,\frac{2.07\cdot10^{-5}\,k}{\sigma^2}|v|,
        \\ \epsilon &= \frac{0.85 (1 - 0.7\sqrt\sigma)}{1 + 305 M^3}, \qquad
        C_D = 0.80695\,\sigma^{0.05}\, e^{0.2536\, t/d},

    F that of ``tube_impedance``. Conversion of S_m = -0.0000207 k/sigma^2, k in 1/cm for |v| in cm/s: k |v| is 1/s in
    both systems, so the number keeps its value, in seconds.

    Range: C_D at most 1. The mass is a straight line in |v| and negative above |v| = sigma (t +
    epsilon d)/2.07e-5 m/s (3.7 m/s for t 0.8 mm, d 1 mm, sigma 5 %), where the law no longer holds; the sheet stays
    passive.

    Source: Yu, Ruiz & Kwan (2008), AIAA 2008-2930, which could not be opened. All terms as in a public code (function
        impedanceUTAS of an eduction), there without the 0.85 of epsilon, which is Ingard's and stands in the sources of
        ``two_parameter``; the flow term also as in Roncen et al. (2026), eq. (2.7).
    """
    length = thickness + ingard_end(orifice_diameter, porosity) * left_by_flow(mach)
    linear = tube_impedance(omega, length, orifice_diameter, fluid) / porosity
    mass = 2.07e-5 * omega / fluid.sound_speed / porosity**2 * speed
    discharge = goodrich_discharge(thickness / orifice_diameter, porosity)
    jets = 1.336541 * jet_resistance(speed, porosity, discharge, fluid)
    flow = goodrich_resistance(mach, porosity, displacement_thickness, orifice_diameter)
    return linear + jets + flow - 1j * mass


def goodrich_discharge(slenderness: Any, porosity: Any) -> Tensor:
    """C_D of Goodrich's plate, from t/d and sigma."""
    return 0.80695 * porosity**0.05 * torch.exp(0.2536 * torch.as_tensor(slenderness))


def two_parameter(
    omega: Tensor,
    speed: Tensor,
    fluid: Fluid,
    *,
    thickness: Length,
    orifice_diameter: Length,
    porosity: Share,
    mach: Mach = 0.0,
    displacement_thickness: Displacement = 0.0,
    discharge_coefficient: Share = SHARP,
) -> Tensor:
    r"""Two-parameter plate (GE): steady-flow resistance A + B |v|, Ingard's mass, grazing flow.

    .. math::
        Z = \frac{32\nu t}{c\,\sigma C_D d^2} + \frac{|v|}{2c(\sigma C_D)^2}
            + \frac{M}{\sigma(2 + 1.256\,\delta^*/d)} + j\,\frac{k (t + \epsilon d)}{\sigma},
        \qquad \epsilon = \frac{0.85 (1 - 0.7\sqrt\sigma)}{1 + 305 M^3}.

    It differs from ``goodrich`` in its friction, that of a steady flow at all frequencies, over C_D; in its C_D, which
    is stated; in the missing (1 - sigma^2); and in a mass that sound does not change.

    Range: friction is too small where the viscous layer is thin, d sqrt(omega/(4 nu)) above 3,
    that is in most plates, and small there beside the other terms.

    Source: Motsinger & Kraft (1991) with the flow terms of Rice & Heidelberg, as used by NASA (Jones et al. 2022). None
        could be opened; read in notes on them and, with Jones, Parrott & Watson (2008) as its source, in a code, both
        public on GitHub. The code divides the mass by C_D too, the notes do not; theirs is taken. The model of Kraft,
        Yu & Kwan (NASA CR-1999-209120), asked for as Yu (GE/Boeing), could not be opened; this is GE's form of it.
    """
    opened = porosity * discharge_coefficient
    friction = 32 * fluid.kinematic_viscosity * thickness / orifice_diameter**2
    resistance = (friction + speed / (2 * opened)) / (opened * fluid.sound_speed)
    length = thickness + ingard_end(orifice_diameter, porosity) * left_by_flow(mach)
    mass = omega * length / (fluid.sound_speed * porosity)
    flow = goodrich_resistance(mach, porosity, displacement_thickness, orifice_diameter)
    found: Tensor = resistance + flow + 1j * mass
    return found


def maa(
    omega: Tensor,
    speed: Tensor,
    fluid: Fluid,
    *,
    thickness: Length,
    orifice_diameter: Length,
    porosity: Share,
    discharge_coefficient: Share = SHARP,
    edge_factor: Annotated[Any, Range(high=10.0, low_included=True)] = 0.5,
) -> Tensor:
    r"""Micro-perforated plate of Maa, the exact tube and not his approximation to it.

    .. math::
        Z = \frac{j\omega t}{c\sigma F} + \frac{\alpha\sqrt{2\omega\rho\eta}}{\sigma\rho c}
            + j\,\frac{0.85\,\omega d}{c\sigma}\,\frac{1}{1 + |v|/(\sigma^2 c)}
            + \frac{1.6}{\pi}\,\frac{1-\sigma^2}{c\,C_D^2\sigma^2}|v|,

    F that of ``tube_impedance``, 1 - 2 J1(x)/(x J0(x)) with x = K sqrt(-j) and the perforate constant K = d
    sqrt(omega/(4 nu)); alpha the ``edge_factor``: 0.5 is Maa (1998), 2 his earlier form, for sharp edges.

    Range: K of 1 to 10, holes below 1 mm, sigma of a few percent (holes that do not see each
    other). Laly's V is that in the hole, |v|/sigma.

    Source: Maa (1998), J. Acoust. Soc. Am. 104, 2861, as in the theory page of acoustipy (whose 1/sqrt(1 + K^2/2) is
        1/sqrt(9 + K^2/2) here, the limit of the exact form). The terms in |v|: Laly et al. (2018), J. Sound Vib.,
        S0022-460X(17)30674-0, after Maa's of high intensities, with beta = 1.6 and C_D = 0.76, as in public MATLAB
        classes that name the paper's equations 20 to 23 and 27. Neither paper could be opened.
    """
    c = fluid.sound_speed
    edges = edge_factor * torch.sqrt(2 * omega * fluid.kinematic_viscosity) / c
    end = 0.85 * orifice_diameter / (1 + speed / (porosity**2 * c))
    linear = tube_impedance(omega, thickness, orifice_diameter, fluid) + edges
    jets = 2 * 1.6 / math.pi * jet_resistance(speed, porosity, discharge_coefficient, fluid)
    return (linear + 1j * omega * end / c) / porosity + jets


def melling(
    omega: Tensor,
    speed: Tensor,
    fluid: Fluid,
    *,
    thickness: Length,
    orifice_diameter: Length,
    porosity: Share,
    discharge_coefficient: Share = SHARP,
) -> Tensor:
    r"""Plate of Beranek & Ingard and of Melling: Crandall's tube, Fok's interaction, a jet.

    .. math::
        Z = \frac{j\omega}{c\sigma F}\Big(t + \frac{8d}{3\pi\,\psi(\sqrt\sigma)}\Big)
            + \frac{8\sqrt2}{3\pi}\,\frac{1-\sigma^2}{2c\,(\sigma C_D)^2}|v|,

    F that of ``tube_impedance``, 1/psi that of ``fok_sum``.

    Range: the jet is quasi-steady, the excursion in the hole |v|/(sigma omega) above d; in weaker
    sound the true resistance rises as |v|^2. 8 sqrt(2)/(3 pi), printed 1.2, is for a tone of rms |v| in front; with its
    peak velocity the same law reads 4/(3 pi) (``terms.py``).

    Source: Melling (1973), J. Sound Vib. 29, 1-65, which could not be opened; the nonlinear term and Fok's series as in
        OpenPulse (perforated_plate.py). Friction takes the gas's own viscosity, without Melling's larger one for walls
        that conduct heat, and acts on the end correction as on the tube.
    """
    end = 8 / (3 * math.pi) * orifice_diameter * fok_sum(porosity)
    tube = tube_impedance(omega, thickness + end, orifice_diameter, fluid)
    return tube / porosity + TONE * jet_resistance(speed, porosity, discharge_coefficient, fluid)


def mesh(
    omega: Tensor,
    speed: Tensor,
    fluid: Fluid,
    *,
    resistance_rayl: Annotated[Any, Range("Pa s/m", low_included=True)],
    resistance_slope_rayl: Annotated[Any, Range("Pa s2/m2", low_included=True)] = 0.0,
    surface_mass: Annotated[Any, Range("kg/m2", low_included=True)] = 0.0,
) -> Tensor:
    r"""Wire mesh or felt as its maker states it: :math:`Z = (R_0 + R_1 |v| + j\omega m)/(\rho c)`.

    R_0 in MKS rayl (1 cgs rayl is 10 of them); R_1 from steady flow, dp = (R_0 + R_1 v) v, of which a tone sees
    ``TONE`` times as much; m of the air that moves in it (and of a limp mesh beside it).

    Range: that of the flow rig for |v|; frequencies at which the layer around a wire is thick
    against its pores, as in most meshes used as liners.

    Source: definition. Forchheimer's law for R_0 and R_1.
    """
    resistance = resistance_rayl + resistance_slope_rayl * speed
    found: Tensor = (resistance + 1j * omega * surface_mass) / fluid.characteristic_impedance
    return found
