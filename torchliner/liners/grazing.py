"""The classical flow term: drawn beside educed values, in a replay only where a sheet states it."""

from __future__ import annotations

import math
from typing import TypeVar

from torch import Tensor

from torchliner.checks import real_tensor
from torchliner.liners.model import Number
from torchliner.liners.parameters import require_ranges

Real = TypeVar("Real", float, Tensor)


def goodrich_resistance(
    bulk_mach: Real, flow_facing_porosity: Real, displacement_thickness: Real, diameter: Real
) -> Real:
    r"""Resistance added by grazing flow, normalised: M/(phi (2 + 1.256 delta*/d)).

    Args:
        bulk_mach: M_b, 0 to 1.
        flow_facing_porosity: open area over the whole liner surface (the global porosity).
        displacement_thickness: delta*, m.  diameter: orifice diameter d, m.
    Raises:
        ValueError: a Mach number or porosity outside 0 to 1, a porosity or diameter of 0, what is
            negative or not finite.
    Source: Yu et al. (2008) as quoted in Roncen et al. (2026), eq. (2.7). Departure from print: M_b
        stands twice there; once reproduces the paper's own shift (1.03-1.22 for its 0.94-1.12
        between Mach 0.1 and 0.3), twice gives 0.41-0.49.

    >>> round(tl.goodrich_resistance(0.3, 0.0395, 1.73e-3, 0.7e-3), 3)
    1.488
    """
    for name, value, limits in (
        ("bulk_mach", bulk_mach, ("1", 0.0, 1.0, True)),
        ("flow_facing_porosity", flow_facing_porosity, ("1", 0.0, 1.0, False)),
        ("displacement_thickness", displacement_thickness, ("m", 0.0, math.inf, True)),
        ("diameter", diameter, ("m", 0.0, math.inf, False)),
    ):
        values = real_tensor(value).detach()
        for end in values.aminmax() if values.numel() else ():
            require_ranges({name: Number(float(end), *limits)}, "goodrich_resistance")
    return bulk_mach / (flow_facing_porosity * (2 + 1.256 * displacement_thickness / diameter))
