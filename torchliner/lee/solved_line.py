"""A solved field at the microphones of its duct, as measured lines are kept."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchliner.checks import tell
from torchliner.duct.presets import DuctSetup
from torchliner.lee.field import DuctField
from torchliner.records import MicrophoneLine


def microphones_of(setup: DuctSetup) -> np.ndarray:
    """x of the microphones, or of 50 places along the duct where the file states none, m."""
    if len(setup.microphones):
        return setup.microphones.numpy()
    return np.linspace(setup.case.start, setup.case.end, 50)


def solved_line(setup: DuctSetup, field: DuctField, **known: Any) -> MicrophoneLine:
    """The field at the microphones as measured lines are kept, in the order of x.

    Args:
        setup, field: solved.
        known: what else its provenance states, by name; its energy is always there.

    Warns:
        DataWarning: several lined patches, of which a line can name one: it names none.
    """
    places = np.sort(microphones_of(setup))
    pressure = field.wall_pressure(places, setup.wall).detach().movedim(-1, -2)
    liner = setup.case.liner if len(setup.case.liner) == 1 else ()
    if len(setup.case.liner) > 1:
        tell(
            f"{setup.name} has {len(setup.case.liner)} lined patches, a line of microphones names "
            "one; it names none, and methods of one liner take all microphones"
        )
    return MicrophoneLine(
        places, pressure, setup.frequency, duct_height=setup.case.height,
        mach=setup.case.profile.bulk_mach, source_side=field.source,
        liner_start=liner[0][0] if liner else None, liner_end=liner[0][1] if liner else None,
        fluid=setup.fluid, title=f"{setup.name}, linearised Euler equations",
        provenance={"solved": setup.facts, "energy": field.energy.rows(), **known}, name=setup.name,
    )  # fmt: skip
