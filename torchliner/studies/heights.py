"""Which height? Z against height, what else speaks of a height, and the lowest that each averaging can be taken at."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

from torchliner.checks import tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.case import planes_by_height
from torchliner.studies.variants import Row, Study, plane_of
from torchliner.velocity.educe import educe
from torchliner.velocity.reading import Progress

DRIFT = 25.0 + 30.0j  # per m of height, eq. (A1), for sound at grazing incidence
LIMIT = 0.1  # of difference of averagings, change with height, 1 - coherence: a choice of this program


def study_heights(
    planes: Sequence[VelocityPlane | Moments],
    liner: Liner,
    frequency: float | None = None,
    *,
    progress: Progress | None = None,
    **choices: Any,
) -> Study:
    """Z over height, and for each averaging the lowest height that holds.

    Where the level check was made it decides alone. Else Z must have settled, so that the highest plane never
    qualifies; ``velocity`` also needs a velocity in step with the tone, and ``admittance`` must agree with ``velocity``
    where v is in step. No reference impedance is used, and none of this says that Z is right.

    Args:
        planes: of one case at different heights, or their ``Moments``.
        liner, frequency, progress, choices: as for ``educe``; one frequency, no intervals by default.
    Returns:
        ``rows``, the lowest first: height (m); impedance, level_check (dB), by averaging; level_limit (dB); coherence
        (squared, of v with the tone, median over probes); velocity_rms (v', m/s); drift (of grazing sound by eq.
        (A1)). heights (m, by averaging; None where none qualifies), height (that of the averaging of the answer), and
        ``judged``: height, averaging, name (``level check``, or of a limit), value (dB, or a share of 1), limit,
        passed.
    Source: Roncen et al. (2026), sections 5.5.2 and 7.2 (the trade-off), figures 11, 16 and 17, appendix A.
    """
    model, records = as_liner(liner), {id(plane_of(each)): each for each in planes}
    ordered = planes_by_height([plane_of(each) for each in planes])
    if frequency is None and len(tones := {plane.frequency for plane in ordered}) > 1:
        raise ValueError(f"the planes state different frequencies, {sorted(map(str, tones))}; give one")
    wanted = ordered[0].asked(frequency).tolist()
    if len(wanted) > 1:
        raise ValueError(f"heights are compared at one frequency; {len(wanted)} are given")
    maps, rows, notes = list[ImpedanceMap](), list[Row](), list[str]()
    for plane in ordered:
        maps.append(educe(records[id(plane)], model, wanted, **{"interval": None, "progress": progress, **choices}))
        rows.append(_row(plane, maps[-1]))
        notes += [note.text for note in maps[-1].notes]
    tell(notes := list(dict.fromkeys(notes)))
    first, heights = maps[0], dict[str, float | None]()
    judged = [
        row
        for averaging in rows[0].impedance
        for here, above in itertools.zip_longest(rows, rows[1:])
        for row in _judged(averaging, here, above)
    ]
    for name in rows[0].impedance:
        failed = {row.height for row in judged if row.averaging == name and not row.passed}
        heights[name] = next((row.height for row in rows if row.height not in failed), None)
    return Study(
        title=ordered[0].title.split(", y =")[0],
        frequency=wanted[0],
        averaging=first.choices["averaging"],
        rows=tuple(rows),
        reference=dict(first.reference) if first.tone == 0 else {},
        judged=judged,
        heights=heights,
        height=heights[first.choices["averaging"]],
        choices=dict(first.choices),
        notes=tuple(notes),
    )


def _row(plane: VelocityPlane, seen: ImpedanceMap) -> Row:
    """What is known of one height."""
    check, grazing = seen.level_check, plane.source_side in ("upstream", "downstream")
    levels = {} if check is None else dict(zip(check.averagings, check.liner.level[:, 0].tolist(), strict=True))
    return Row(
        height=plane.height or 0.0,
        impedance={name: complex(each.impedance[0]) for name, each in seen.liner.items()},
        level_check={name: level for name, level in levels.items() if math.isfinite(level)},
        level_limit=math.nan if check is None else check.limit,
        coherence=float(seen.coherence[..., 0].nanmedian()),
        velocity_rms=float((seen.velocity_rms**2).nanmean().sqrt()),
        drift=DRIFT * (plane.height or 0.0) if grazing else None,
    )


def _judged(averaging: str, here: Row, above: Row | None) -> list[Row]:
    """What an averaging is judged by at one height, with the next one above."""
    z, limit, found = here.impedance, LIMIT, dict[str, float | None]()
    if averaging in here.level_check:
        found, limit = {"level check": abs(here.level_check[averaging])}, here.level_limit
    else:
        found["change"] = None if above is None else abs(above.impedance[averaging] / z[averaging] - 1)
        if averaging == "velocity":
            found["turbulence"] = 1 - here.coherence if math.isfinite(here.coherence) else None
        elif averaging == "admittance" and here.coherence >= 1 - LIMIT:
            found["averagings"] = abs(z["admittance"] / z["velocity"] - 1)
    about = {"height": here.height, "averaging": averaging, "limit": limit}
    return [
        Row(about, name=name, value=value, passed=value is not None and value <= limit) for name, value in found.items()
    ]
