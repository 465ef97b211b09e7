"""Readings of one liner that the paper leaves open: its porosity, and the velocity its cells see.

The same geometry can be stated as holes over the whole surface (global) or as cells, with holes in them, beside a rigid
wall (local, section 5.3); with the global porosity the cavity may count as the whole surface (phi_c = 1) or as its
share of it.
"""

from __future__ import annotations

from typing import TypeVar

from torchliner.checks import plain_number
from torchliner.liners.cell import CellLiner
from torchliner.liners.sdof import SDoFLiner
from torchliner.names import VELOCITY_READINGS

Cells = TypeVar("Cells", bound=CellLiner)


def velocity_readings(liner: Cells) -> dict[str, Cells]:
    """The liner with the other reading of |v|; ValueError if both are the same here."""
    if plain_number(liner.open_area_fraction) == 1:
        raise ValueError("open_area_fraction is 1: |v| as measured and |v| conserved are the same there")
    others = [name for name in VELOCITY_READINGS if name != liner.velocity_reading]
    return {name: liner.replace(velocity_reading=name) for name in others}


def porosity_readings(liner: SDoFLiner) -> dict[str, SDoFLiner]:
    """The liner with its porosity read in the other ways.

    A square cavity of side D = 2 r_c in a cell of side L_c is assumed where the liner is global.

    Raises:
        ValueError: the geometry does not say, or a constant offset hangs on the reading.
    Source: Roncen et al. (2026), section 5.3 and table 1.
    """
    if complex(liner.impedance_offset) != 0:
        raise ValueError("the liner's impedance_offset was fixed under its own reading of the porosity")
    porosity, share = plain_number(liner.porosity), plain_number(liner.open_area_fraction)
    found, whole = {}, liner.replace(porosity=porosity * share, open_area_fraction=1.0)
    if share == 1:
        if liner.cell_pitch is None:
            raise ValueError("the liner states no cell_pitch, which the local reading needs")
        share = (2 * plain_number(liner.cavity_hydraulic_radius) / liner.cell_pitch) ** 2
        if not porosity < share < 1:
            raise ValueError(
                f"the square of cavity over pitch is {share:.3g}, which is no share of a cell with "
                f"square cavities and porosity {porosity:g}"
            )
        cells = liner.replace(porosity=porosity / share, open_area_fraction=share, cavity_porosity=1.0)
        found[f"local {100 * porosity / share:.3g} %, wall in parallel"] = cells
    others = {f"global, phi_c = {phi:.3g}": whole.replace(cavity_porosity=phi) for phi in (1.0, share)}
    return {**found, **{name: other for name, other in others.items() if other != liner}}
