"""The classical flow term: drawn beside educed values, in a replay only where a sheet states it."""

from __future__ import annotations

from typing import TypeVar

from torch import Tensor

Real = TypeVar("Real", float, Tensor)


def goodrich_resistance(
    bulk_mach: Real, flow_facing_porosity: Real, displacement_thickness: Real, diameter: Real
) -> Real:
    r"""Resistance added by grazing flow, normalised: M/(phi (2 + 1.256 delta*/d)).

    Args:
        bulk_mach: M_b.
        flow_facing_porosity: open area over the whole liner surface (the global porosity).
        displacement_thickness: delta*, m.  diameter: orifice diameter d, m.
    Source: Yu et al. (2008) as quoted in Roncen et al. (2026), eq. (2.7). Departure from print: M_b
        stands twice there; once reproduces the paper's own shift (1.03-1.22 for its 0.94-1.12
        between Mach 0.1 and 0.3), twice gives 0.41-0.49.

    >>> round(tl.goodrich_resistance(0.3, 0.0395, 1.73e-3, 0.7e-3), 3)
    1.488
    """
    return bulk_mach / (flow_facing_porosity * (2 + 1.256 * displacement_thickness / diameter))
