"""How high the jets of a liner's holes reach into a grazing flow: appendix A.2 of the paper."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from torchliner.checks import require_positive
from torchliner.conversions import REFERENCE_PRESSURE
from torchliner.duct.flow_profiles import Array, MeanFlow
from torchliner.fluid import Fluid

REACH = 10.0  # x_lim/d, where the paper reads the height off the jet's path
LOWEST = 1e-12  # of half the duct height: below any jet


def jet_velocity(level: float, porosity: float, impedance: complex, fluid: Fluid | None = None) -> float:
    r"""Velocity in the holes of a liner under a tone, :math:`U_j = p_{rms}/(\rho c \phi |Z|)`.

    Args:
        level: SPL, dB re 20 uPa rms.
        porosity: phi, open area over the whole surface, 0 to 1.
        impedance: Z, normalised; its size counts.
        fluid: gas; default air at 20 C.
    Returns:
        U_j, m/s, rms.
    Raises:
        ValueError: porosity outside 0 to 1, or Z = 0.
    Source: Roncen et al. (2026), eq. (A3). The print divides an rms pressure by sqrt(2) once more;
        its 120 m/s for 145 dB, 5 %, |Z| = 0.1 is that print (122 m/s); without it 172 m/s.
    """
    require_positive("porosity", porosity)
    require_positive("|impedance|", abs(impedance))
    if porosity > 1:
        raise ValueError(f"porosity is {porosity:g}; it is a fraction, at most 1 (5 % is 0.05)")
    pressure = REFERENCE_PRESSURE * 10 ** (level / 20)
    return pressure / ((fluid or Fluid()).characteristic_impedance * porosity * abs(impedance))


def penetration_height(velocity: ArrayLike, diameter: float, profile: MeanFlow) -> Array:
    r"""Height of a jet in a sheared cross-flow at x = 10 d downstream of its hole.

    :math:`H = L (x/L)^{1/3}` with :math:`L = \sqrt{\pi/4}\, d\, U_j/U(H)`: the cross-flow is that at the height
    reached, so that :math:`H^{3/2} U(H) = \sqrt{\pi/4}\, d\, U_j \sqrt{x}`. The left side rises with H: one answer,
    found by Brent's method on ln H, where the paper repeats the formula until it stays.

    Args:
        velocity: U_j, m/s, above 0, any shape.
        diameter: d of the hole, m.
        profile: cross-flow; read from the wall to the middle of the duct.
    Returns:
        H_j, m, of the shape of ``velocity``. Divided by d it is the paper's H_j/d.
    Raises:
        ValueError: a value not above 0, or a jet that reaches the middle of the duct.
    Source: Roncen et al. (2026), eq. (A2) after Mahesh (2013). The exponent -1/3 of (A2a) as printed would let the jet
        fall towards the wall downstream; it is +1/3.
    """
    require_positive("jet diameter (m)", diameter)
    speeds = np.asarray(velocity, np.float64)
    if not (np.isfinite(speeds) & (speeds > 0)).all():
        raise ValueError("jet velocity is in m/s; it must be finite and above 0")
    middle, found = profile.duct_height / 2, []
    ends = math.log(LOWEST * middle), math.log(middle)
    for speed in speeds.reshape(-1).tolist():
        wanted = math.log(math.sqrt(math.pi / 4 * REACH * diameter) * diameter * speed)

        def excess(log_height: float, wanted: float = wanted) -> float:
            return 1.5 * log_height + math.log(float(profile.velocity(math.exp(log_height)))) - wanted

        if excess(ends[1]) < 0:
            raise ValueError(
                f"a jet of {speed:g} m/s from a hole of {1e3 * diameter:g} mm reaches the middle of the duct, "
                f"{1e3 * middle:g} mm, where the scaling of A.2 ends; lower the jet velocity or raise the Mach number"
            )
        if excess(ends[0]) > 0:
            raise ValueError(f"a jet of {speed:g} m/s stays below {LOWEST * middle:.1g} m; raise its velocity")
        found.append(math.exp(brentq(excess, *ends, xtol=1e-13, rtol=1e-13)))
    return np.array(found).reshape(speeds.shape)
