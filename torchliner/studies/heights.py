"""Which height? Z against height, what else speaks of a height, and the lowest that each averaging can be taken at."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import torch

from torchliner.checks import require_positive, tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.boxes import grid_of
from torchliner.records.same_case import planes_by_height
from torchliner.studies.modulation import Modulation, cell_modulation, fit_decay
from torchliner.studies.rows import Row, Study
from torchliner.studies.variants import plane_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import educe

DRIFT = 25.0 + 30.0j  # per m of height, eq. (A1), for sound at grazing incidence


def study_heights(
    planes: Sequence[VelocityPlane | Moments],
    liner: Liner,
    frequency: float | None = None,
    *,
    cell_pitch: float | None = None,
    reference_phase: float | None = None,
    progress: Callable[[int], object] | None = None,
    **choices: Any,
) -> Study:
    """Z over height, and the cell-periodic modulation of v'_rms.

    Args:
        planes: of one case at different heights, each a line along x or a (z, x) plane with even spacing; or their
            ``Moments``.
        liner: as for ``educe``.
        frequency: Hz, one; default the planes' own tone.
        cell_pitch: L_c, m; default the liner's.
        reference_phase: rad, for ``phase="given"``.
        progress: called with 1 per plane.
        choices: as for ``educe``; no intervals by default.
    Returns:
        title, frequency (Hz), pitch (L_c, m, or None), source_side, averaging, choices, notes; reference (independent
        impedances, for comparison alone); decay, first_decay: ``Decay`` of the cell-periodic part of v'_rms relative to
        its mean, and of its first harmonic in m/s; None with fewer than three heights.

        ``rows``, a row a height, the lowest first: height (m); impedance (of the whole plane by averaging); level_check
        (dB by averaging; empty where it was not checked), level_limit (dB); coherence (squared, of v with the tone,
        median over probes); velocity_rms (v', m/s); modulation (rms of the cell-periodic part of v'_rms along x over
        its mean), first_harmonic and between (the parts of its first harmonic, and of waves that nothing periodic in
        the cell has), None without a whole cell; drift (of grazing sound by eq. (A1); None of other sound).
    Raises:
        ValueError: planes without or of equal height, of different cases or frequencies, scattered probes.
    Warns:
        DataWarning: what is in ``notes``.
    Source: Roncen et al. (2026), sections 5.5.2 and 7.2, figures 11, 16 and 17, appendix A.
    """
    model, records = as_liner(liner), {id(plane_of(each)): each for each in planes}
    ordered = planes_by_height([plane_of(each) for each in planes])
    if frequency is None and len(tones := {plane.frequency for plane in ordered}) > 1:
        raise ValueError(f"the planes state different frequencies, {sorted(map(str, tones))}; give one")
    wanted = ordered[0].asked(frequency).tolist()
    if len(wanted) > 1:
        raise ValueError(f"heights are compared at one frequency; {len(wanted)} are given")
    pitch = model.cell_pitch if cell_pitch is None else cell_pitch
    if pitch is not None:
        require_positive("cell_pitch (m)", pitch)
    for plane in ordered:
        grid_of(plane)  # refuses scattered probes before a long reading
    options = {"interval": None, **choices, "reference_phase": reference_phase}
    rows, notes, known, first = list[Row](), list[str](), list[Modulation](), None
    for plane in ordered:
        seen = educe(records[id(plane)], model, wanted, **options)
        first = first or seen
        found = _modulation(plane, seen, pitch, notes)
        known += [] if found is None else [found]
        rows.append(_row(plane, seen, found))
        notes += [note.text for note in seen.notes]
        if progress is not None:
            progress(1)
    assert first is not None
    notes = list(dict.fromkeys(notes))
    tell(notes)
    heights = [row.height for row in rows] if len(known) == len(rows) else []
    return Study(
        title=ordered[0].title.split(", y =")[0],
        frequency=wanted[0],
        pitch=pitch,
        source_side=ordered[0].source_side,
        averaging=Choices(**choices).averaging,
        rows=tuple(rows),
        decay=fit_decay(heights, [each.over_mean(each.rms) or 0.0 for each in known]),
        first_decay=fit_decay(heights, [each.harmonics[0] for each in known]),
        reference=first.reference_at(0),
        choices=dict(first.choices),
        notes=tuple(notes),
    )


def _row(plane: VelocityPlane, seen: ImpedanceMap, found: Modulation | None) -> Row:
    """What is known of one height."""
    check = seen.level_check
    levels = {} if check is None else dict(zip(check.averagings, check.liner.level[:, 0].tolist(), strict=True))
    return Row(
        height=plane.height or 0.0,
        impedance={name: complex(each.impedance[0]) for name, each in seen.liner.items()},
        level_check={name: level for name, level in levels.items() if math.isfinite(level)},
        level_limit=math.nan if check is None else check.limit,
        coherence=float(seen.coherence[..., 0].nanmedian()),
        velocity_rms=float((seen.velocity_rms**2).nanmean().sqrt()),
        modulation=found and found.over_mean(found.rms),
        first_harmonic=found and found.over_mean(found.harmonics[0] / math.sqrt(2)),
        between=found and found.over_mean(found.between),
        drift=DRIFT * (plane.height or 0.0) if plane.source_side in ("upstream", "downstream") else None,
    )


def _modulation(plane: VelocityPlane, seen: ImpedanceMap, pitch: float | None, notes: list[str]) -> Modulation | None:
    """Of v'_rms along x; ``notes`` gets why there is none."""
    if pitch is None:
        notes.append("no cell pitch is known; the cell-periodic modulation cannot be judged")
        return None
    square = seen.velocity_rms.detach().cpu().to(torch.float64).square()
    try:
        assert plane.x is not None  # ``grid_of`` saw to it
        profile = square.reshape(-1, square.shape[-1]).nanmean(0).sqrt()
        found = cell_modulation(plane.x.numpy(), profile.numpy(), pitch)
    except ValueError as error:
        notes.append(f"{plane.name}: no cell-periodic modulation can be judged: {error}")
        return None
    if found.cells == 1:
        notes.append(
            "the probes span a single cell: the cell-periodic modulation is the harmonics of the pitch in it, and "
            "nothing shows that they repeat"
        )
    return found


def recommend_height(
    study: Study, modulation: float = 0.1, averagings: float = 0.1, change: float = 0.1, turbulence: float = 0.1
) -> Study:
    """For each averaging, the lowest height where what it rests on holds. No reference impedance is used.

    Where the level check was made it decides alone. Else Z of that averaging must have settled, so that the highest
    plane, which has no next one, never qualifies, and besides:

    - ``velocity`` needs a velocity in step with the tone: turbulence averages out of it, and the resistance that it
      makes with it. Cell-periodic modulation does not matter to it: what passes the cell passes the holes.
    - ``phase-locked`` needs no more;
    - ``admittance`` must agree with ``velocity`` where v is in step (else a probe sees a jet and not the cell), and
      needs little cell-periodic modulation where it is not.

    None of this says that Z is right.

    Args:
        study: of ``study_heights``.
        modulation, averagings, change, turbulence: limits, a choice of this program (the paper gives none): rms of the
            cell-periodic part of v'_rms over its mean; |Z, admittance - Z, velocity| over the latter's |Z|; change of Z
            to the next height, over |Z|; share of v'^2 at the tone's frequency that keeps no step with it.
    Returns:
        heights (m, by averaging; None where no height qualifies), height (that of the averaging of the answer), and
        ``rows``, every height and averaging against what that averaging needs, lowest first: height, averaging, name
        (``level check``, or of a limit), value (dB, or a share of 1; None where it could not be judged), limit, passed.
    Source: Roncen et al. (2026), sections 5.5.2 and 7.2 (the trade-off) and appendix A.
    """
    limits = {"modulation": modulation, "averagings": averagings, "change": change, "turbulence": turbulence}
    for name, limit in limits.items():
        require_positive(f"limit on {name}", limit)
    rows, heights = list[Row](), dict[str, float | None]()
    for averaging in study.rows[0].impedance:
        heights[averaging] = None
        for here, above in itertools.zip_longest(study.rows, study.rows[1:]):
            gap, values = here.level_check.get(averaging), dict[str, float | None]()
            if gap is not None:
                values["level check"] = abs(gap)
            else:
                values["change"] = above and _relative(above.impedance[averaging], here.impedance[averaging])
                if averaging == "velocity":
                    values["turbulence"] = 1 - here.coherence if math.isfinite(here.coherence) else None
                elif averaging == "admittance" and here.coherence >= 1 - turbulence:
                    values["averagings"] = _relative(here.impedance["admittance"], here.impedance["velocity"])
                elif averaging == "admittance":
                    values["modulation"] = here.modulation
            judged = []
            for name, value in values.items():
                limit = here.level_limit if name == "level check" else limits[name]
                about = {"height": here.height, "averaging": averaging, "name": name, "value": value}
                judged.append(Row(about, limit=limit, passed=value is not None and value <= limit))
            if heights[averaging] is None and all(row.passed for row in judged):
                heights[averaging] = here.height
            rows += judged
    return Study(height=heights[study.averaging], heights=heights, rows=rows)


def _relative(found: complex, wanted: complex) -> float:
    """|found - wanted| over |wanted|; infinite where one of them is."""
    known = abs(found) < math.inf and 0 < abs(wanted) < math.inf
    return abs(found - wanted) / abs(wanted) if known else math.inf
