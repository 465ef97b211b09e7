"""A solved field at the microphones of its duct, as measured lines are kept."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.field import DuctField
from torchliner.duct.presets import DuctSetup
from torchliner.duct.settled import SettledField
from torchliner.fluid import Fluid
from torchliner.records import MicrophoneLine
from torchliner.version import __version__


def microphones_of(setup: DuctSetup) -> np.ndarray:
    """x of the microphones, or of 50 places along the duct where the file states none, m."""
    if len(setup.microphones):
        return setup.microphones.numpy()
    return np.linspace(setup.case.start, setup.case.end, 50)


def solved_line(setup: DuctSetup, found: DuctField | SettledField, **known: Any) -> MicrophoneLine:
    """The field at the microphones as measured lines are kept, in the order of x.

    Args:
        setup: the duct.  found: solved, with its checks or without.
        known: what else its provenance states, by name; impedance, plane mode, energy, mesh and its check are always
            there.
    Warns:
        DataWarning: several lined patches, of which a line can name one: it names none.
    """
    settled = found if isinstance(found, SettledField) else None
    field = found.field if isinstance(found, SettledField) else found
    case, places = setup.case, np.sort(microphones_of(setup))
    start, end = case.liner[0] if len(case.liner) == 1 else (None, None)
    notes = (*setup.notes, *(settled.notes if settled else ()))
    if len(case.liner) > 1:
        several = (
            f"{setup.name} has {len(case.liner)} lined patches, a line of microphones names one; it names none, and "
            "methods of one liner take all microphones"
        )
        tell(several)
        notes = (*notes, several)
    provenance = {
        "solved": setup.facts,
        "energy": field.energy.rows(),
        "plane_mode": found.rows(),
        "impedance": _asked(field),
        "wall": setup.wall,
        "unknowns": field.swept.mesh.unknowns,
        "finer_unknowns": settled.finer_unknowns if settled else None,
        "version": __version__,
        **known,
    }
    return MicrophoneLine(
        places,
        field.wall_pressure(places, setup.wall).detach().movedim(-1, -2),
        setup.frequency,
        duct_height=case.height,
        mach=case.profile.bulk_mach,
        source_side=field.source,
        liner_start=start,
        liner_end=end,
        wall_impedance=_known(provenance["impedance"]),
        fluid=setup.fluid,
        title=f"{setup.name}, linearised Euler equations",
        provenance=provenance,
        notes=notes,
        name=setup.name,
    )


def _known(walls: list[list[Any]] | None) -> Tensor | None:
    """Z of a single patch, nan where it is rigid, (F,); None of several patches, or where Z varies along x."""
    if walls is None or any(len(row) != 1 for row in walls):
        return None
    known = [complex(math.nan, math.nan) if row[0] == "rigid" else complex(*row[0]) for row in walls]
    return torch.tensor(known, dtype=torch.complex128)


def _asked(field: DuctField) -> list[list[Any]] | None:
    """Z of each frequency and patch as pairs or "rigid"; None where it varies along x."""
    if field.impedance is None or callable(field.impedance):
        return None
    shape = (len(field.frequency), len(field.case.liner))
    walls = torch.as_tensor(field.impedance).detach().broadcast_to(shape).tolist()
    return [[[z.real, z.imag] if np.isfinite(z) else "rigid" for z in map(complex, row)] for row in walls]


def setup_of(field: DuctField) -> DuctSetup:
    """What a field in memory says of its duct; places along all of it stand for microphones.

    Raises:
        ValueError: it has leading axes.
    """
    if field.waves.ndim != 2:
        raise ValueError(f"the field has the leading axes {tuple(field.waves.shape[:-2])}; a page has one field")
    case, profile = field.case, field.case.profile
    level = float(spl_from_pressure_amplitude(torch.as_tensor(complex(case.incident))))
    ends = {name: str(getattr(case, name)) for name in ("end_reflection", "source_reflection")}
    flow = {"profile": type(profile).__name__, "bulk_mach": profile.bulk_mach, "slip_condition": case.slip_condition}
    facts = {
        "duct": {"height": case.height, "start": case.start, "end": case.end, "liner": case.liner},
        "flow": flow,
        "sound": {"level": level, "source_side": field.source, **ends},
    }
    gas = Fluid(sound_speed=profile.sound_speed, density=case.density)
    known = (field.frequency, level, field.impedance, torch.empty(0), "opposite", facts, gas)
    return DuctSetup("duct in memory", case, *known)
