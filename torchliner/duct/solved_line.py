"""A solved field at the microphones of its duct, as measured lines are kept."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.presets import DuctSetup
from torchliner.duct.solver import DuctField
from torchliner.fluid import Fluid
from torchliner.records import MicrophoneLine
from torchliner.version import __version__


def solved_line(setup: DuctSetup, field: DuctField, **known: Any) -> MicrophoneLine:
    """The field at the microphones as measured lines are kept, in the order of x.

    Args:
        setup: the duct.  field: solved, with its checks or without.
        known: what else its provenance states, by name; impedance, plane mode with its energy, mesh and its check are
            always there.
    Warns:
        DataWarning: several lined patches, of which a line can name one: it names none.
    """
    case, places = setup.case, np.sort(setup.places)
    start, end = case.liner[0] if len(case.liner) == 1 else (None, None)
    notes = (*setup.notes, *field.notes)
    if len(case.liner) > 1:
        several = (
            f"{setup.name} has {len(case.liner)} lined patches, a line of microphones names one; it names none, and "
            "methods of one liner take all microphones"
        )
        tell(several)
        notes = (*notes, several)
    walls = None
    if not callable(field.impedance):  # else Z varies along x
        z = field.impedance
        exact = z.detach().cpu() if isinstance(z, Tensor) else torch.as_tensor(np.asarray(z, np.complex128))
        walls = exact.to(torch.complex128).broadcast_to(len(field.frequency), len(case.liner))
    first = None if walls is None or walls.shape[1] != 1 else walls[:, 0]
    return MicrophoneLine(
        places,
        field.wall_pressure(places, setup.wall).detach().movedim(-1, -2),
        setup.frequency,
        duct_height=case.height,
        mach=case.profile.bulk_mach,
        source_side=field.source,
        liner_start=start,
        liner_end=end,
        wall_impedance=None if first is None else torch.where(first.isfinite(), first, complex(math.nan, math.nan)),
        fluid=setup.fluid,
        title=f"{setup.name}, linearised Euler equations",
        provenance={
            "solved": setup.facts,
            "plane_mode": field.rows(),
            "impedance": walls
            if walls is None
            else [[[z.real, z.imag] if np.isfinite(z) else "rigid" for z in row] for row in walls.tolist()],
            "wall": setup.wall,
            "unknowns": field.mesh.unknowns,
            "finer_unknowns": field.finer_unknowns,
            "version": __version__,
            **known,
        },
        notes=notes,
        name=setup.name,
    )


def setup_of(field: DuctField) -> DuctSetup:
    """What a field in memory says of its duct; places along all of it stand for microphones.

    Raises:
        ValueError: it has leading axes.
    """
    if field.waves.ndim != 2:
        raise ValueError(f"the field has the leading axes {tuple(field.waves.shape[:-2])}; a page has one field")
    case, profile = field.case, field.case.profile
    level = float(spl_from_pressure_amplitude(torch.as_tensor(complex(case.incident))))
    flow = {"profile": type(profile).__name__, "bulk_mach": profile.bulk_mach, "slip_condition": case.slip_condition}
    ends = {name: str(getattr(case, name)) for name in ("end_reflection", "source_reflection")}
    facts = {
        "duct": {"height": case.height, "start": case.start, "end": case.end, "liner": case.liner},
        "flow": flow,
        "sound": {"level": level, "source_side": field.source, **ends},
    }
    gas = Fluid(sound_speed=profile.sound_speed, density=case.density)
    known = (field.frequency, level, field.impedance, torch.empty(0), "opposite", facts, gas)
    return DuctSetup("duct in memory", case, *known)
