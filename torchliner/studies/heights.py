"""Which height? Z against height and the length the velocity is averaged over, and what else speaks of a height."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import DataWarning, plain_number, require_positive, tell
from torchliner.conversions import impedance_from_admittance, mean_impedance
from torchliner.duct.flow_profiles import Array, TanhProfile
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.boxes import Grid, grid_of, windows_of
from torchliner.records.same_case import planes_by_height
from torchliner.studies.jets import jet_velocity, penetration_height
from torchliner.studies.modulation import Modulation, cell_modulation, fit_decay
from torchliner.studies.rows import Row, Study
from torchliner.studies.variants import Source, Variant, plane_of
from torchliner.velocity.answer import answer
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import time_moments

DRIFT = 25.0 + 30.0j  # per m of height, eq. (A1), for sound at grazing incidence
CELL_SHARES = (1 / 8, 1 / 4, 1 / 2)
UNKNOWN = complex(math.nan, math.nan)


def study_heights(
    planes: Sequence[VelocityPlane | Moments],
    liner: Liner,
    frequency: float | None = None,
    *,
    lengths: Sequence[float] | None = None,
    cell_pitch: float | None = None,
    duct_height: float = 50e-3,
    shear: float = 0.05,
    reference_phase: float | None = None,
    progress: Callable[[int], object] | None = None,
    **choices: Any,
) -> Study:
    """Z over height and averaging length, the cell-periodic modulation, and the height of the jets.

    Args:
        planes: of one case at different heights, each a line along x or a (z, x) plane with even spacing. Of the
            ``Moments`` of a plane everything is known but the velocity averaged over these lengths.
        liner: as for ``educe``; its ``cell_pitch``, ``surface_porosity`` and ``orifice_diameter`` are used where it has
            them.
        frequency: Hz, one; default the planes' own tone.
        lengths: averaging lengths along x (and z), m, from a spacing to the whole plane; default a spacing, 1/8, 1/4,
            1/2, 1, 2, 4 ... cells and the whole plane.
        cell_pitch: L_c, m; default the liner's.
        duct_height, shear: H, m, and shear of the ``TanhProfile`` that the jets stand in; default those of figure 22.
        reference_phase: rad, for ``phase="given"``.
        progress: called with 1 per plane.
        choices: as for ``educe``. A ``wall_filter`` acts on the averages over probes.
    Returns:
        title, frequency (Hz), pitch (L_c, m, or None), lengths (m, rising), source_side, averaging, choices, notes;
        reference (independent impedances, for comparison alone); decay, first_decay: ``Decay`` of the cell-periodic
        part of v'_rms relative to its mean, and of its first harmonic in m/s; None with fewer than three heights.

        ``rows``, the lowest plane first, then by length: height, length (m), probes (in a window), windows, admittance
        (1/<Y> over windows, Y averaged over a window's probes), velocity (the same, of the velocity averaged over a
        window's probes; nan of moments, but for windows of one probe), admittance_spread, velocity_spread (standard
        deviation of R and of X over the windows; nan for one).

        ``facts``, a row a height: height (m); coherence (squared, of v with the tone, median over probes); velocity_rms
        (v', m/s); modulation (rms of the cell-periodic part of v'_rms along x over its mean), first_harmonic and
        between (the parts of its first harmonic, and of waves that nothing periodic in the cell has),
        mean_modulation (of v_0, over the mean of v'_rms), streamwise_modulation (of u'_rms); None without a whole cell,
        or without u; jet_velocity, jet_height (m/s and m, eqs (A3) and (A2), with |Z| in the averaging of the answer;
        None where something is unknown); impedance (of the whole plane by averaging); level_check (dB by averaging;
        empty where it was not checked), level_limit (dB); drift (of grazing sound by eq. (A1); None of other sound).
    Raises:
        ValueError: planes without or of equal height, of different cases or frequencies, or lengths that do not fit.
    Warns:
        DataWarning: what is in ``notes``.
    Source: Roncen et al. (2026), sections 5.5.2 and 7.2, figures 11, 16 and 17, appendix A.
    """
    model, records = as_liner(liner), {id(plane_of(each)): each for each in planes}
    ordered = planes_by_height([plane_of(each) for each in planes])
    if frequency is None and len(tones := {plane.frequency for plane in ordered}) > 1:
        raise ValueError(f"the planes state different frequencies, {sorted(map(str, tones))}; give one")
    (wanted, *more) = ordered[0].asked(frequency).tolist()
    if more:
        raise ValueError(f"heights are compared at one frequency; {1 + len(more)} are given")
    pitch = model.cell_pitch if cell_pitch is None else cell_pitch
    if pitch is not None:
        require_positive("cell_pitch (m)", pitch)
    TanhProfile(0.1, duct_height, shear, 343.2)  # refuses what no profile can have
    grids = [grid_of(plane) for plane in ordered]
    long = _lengths(lengths, grids, pitch)
    # What stands beside the heights are spreads; no interval is shown.
    chosen = Choices(**{"interval": None, **choices})
    rows, facts, notes, known = list[Row](), list[Row](), list[str](), list[Modulation]()
    maps: list[ImpedanceMap] = []
    for plane, grid in zip(ordered, grids, strict=True):
        source = Source(records[id(plane)], [model], wanted, chosen)
        with torch.no_grad():
            seen = answer(source.known, model, source.frequency, chosen, reference_phase)
        maps.append(seen)
        rows += _rows(source, seen, grid, long, reference_phase)
        notes += [note.text for note in seen.notes]
        found = _modulations(plane, seen, pitch, notes)
        known += found[:1]
        facts.append(Row(_facts(plane, seen, found), **_jet(plane, seen, model, (duct_height, shear), notes)))
        if source.reading is None:
            notes.append(f"{plane.name} holds moments: velocity is known of its cells alone, not over other lengths")
        if progress is not None:
            progress(1)
    tell(dict.fromkeys(notes))
    heights = [one.height for one in facts] if len(known) == len(facts) else []
    return Study(
        title=ordered[0].title.split(", y =")[0],
        frequency=wanted,
        pitch=pitch,
        lengths=tuple(long),
        source_side=ordered[0].source_side,
        averaging=chosen.averaging,
        rows=tuple(sorted(rows, key=lambda row: (row.height, row.length))),
        facts=tuple(facts),
        decay=fit_decay(heights, [each.over_mean(each.rms) or 0.0 for each in known]),
        first_decay=fit_decay(heights, [each.harmonics[0] for each in known]),
        reference=maps[0].reference_at(0),
        choices=dict(maps[0].choices),
        notes=tuple(dict.fromkeys(notes)),
    )


def _lengths(asked: Sequence[float] | None, grids: Sequence[Grid], pitch: float | None) -> list[float]:
    """As asked for; else a spacing, shares of a cell, whole cells by doubling, the whole plane."""
    shortest, longest = max(g.spacing for g in grids), min(g.length for g in grids)
    for length in asked or ():
        require_positive("averaging length (m)", length)
        if not shortest * (1 - 1e-3) <= length <= longest + 0.5 * shortest:
            fault = f"below the spacing of the probes, {1e3 * shortest:.4g} mm"
            fault = fault if length < shortest else f"above the plane's length, {1e3 * longest:.4g} mm"
            raise ValueError(f"averaging length {1e3 * length:.4g} mm is {fault}")
    if asked:
        return sorted(set(asked))
    unit = pitch or longest
    steps = [share * unit for share in CELL_SHARES]
    steps += [unit * 2**k for k in range(math.ceil(math.log2(max(longest / unit, 1))) + 1)]
    kept = [shortest]
    for length in [*steps, longest]:
        # Lengths that come to the same number of probes are one.
        if kept[-1] + 0.5 * shortest < length <= longest + 0.5 * shortest:
            kept.append(length)
    return kept


def _rows(source: Source, seen: ImpedanceMap, grid: Grid, lengths: Sequence[float], psi: float | None) -> list[Row]:
    """One plane at every averaging length, for which it is read once more."""
    probes = seen.probes["admittance"]
    alone = probes.admittance[..., 0].flatten()
    walled = alone if seen.wall is None else torch.where(seen.wall[..., 0].flatten(), 0, alone)
    used = torch.isfinite(probes.reflection.real[..., 0]).reshape(grid.rows, grid.columns)
    cut = [windows_of(grid, length, used) for length in lengths]
    over_velocity = [_average(alone) if each.width * each.height == 1 else (UNKNOWN, UNKNOWN) for each in cut]
    if source.reading is not None:
        chosen = replace(source.chosen, averaging="velocity", background=None, interval=None)
        variants = [Variant({}, "velocity", chosen, windows=each, psi=psi) for each in cut]
        over_velocity = [(each.impedance, each.spread) for each in source.evaluate(variants)]
    rows = []
    for length, windows, velocity in zip(lengths, cut, over_velocity, strict=True):
        names = ("admittance", "admittance_spread", "velocity", "velocity_spread")
        values = dict(zip(names, (*_average(windows.mean(walled)), *velocity), strict=True))
        about = {"height": source.plane.height or 0.0, "length": length, "probes": windows.width * windows.height}
        rows.append(Row(about, windows=windows.count, **values))
    return rows


def _average(admittance: Tensor) -> tuple[complex, complex]:
    """1/<Y> over windows, and the spread of R and X over them."""
    known = admittance[torch.isfinite(admittance.real)]
    z = impedance_from_admittance(known)
    spread = complex(float(z.real.std()), float(z.imag.std())) if len(known) > 1 else UNKNOWN
    return complex(mean_impedance(known)), spread


def _facts(plane: VelocityPlane, seen: ImpedanceMap, found: list[Modulation]) -> Row:
    """What does not depend on the averaging length."""
    check = seen.level_check
    levels = {} if check is None else dict(zip(check.averagings, check.liner.level[:, 0].tolist(), strict=True))
    v, steady, u = [*found, None, None, None][:3]
    return Row(
        height=plane.height or 0.0,
        coherence=float(seen.coherence[..., 0].nanmedian()),
        velocity_rms=float((seen.velocity_rms**2).nanmean().sqrt()),
        modulation=v and v.over_mean(v.rms),
        first_harmonic=v and v.over_mean(v.harmonics[0] / math.sqrt(2)),
        between=v and v.over_mean(v.between),
        mean_modulation=v and steady and v.over_mean(steady.rms),
        streamwise_modulation=u and u.over_mean(u.rms),
        impedance={name: complex(each.impedance[0]) for name, each in seen.liner.items()},
        level_check={name: level for name, level in levels.items() if math.isfinite(level)},
        level_limit=math.nan if check is None else check.limit,
        drift=DRIFT * (plane.height or 0.0) if plane.source_side in ("upstream", "downstream") else None,
    )


def _modulations(plane: VelocityPlane, seen: ImpedanceMap, pitch: float | None, notes: list[str]) -> list[Modulation]:
    """Of v'_rms, v_0 and, if that is stored, u'_rms along x; ``notes`` gets why there are none."""
    if pitch is None:
        notes.append("no cell pitch is known; the cell-periodic modulation cannot be judged")
        return []
    profiles = [np.sqrt(_over_z(seen.velocity_rms**2)), _over_z(seen.mean_velocity)]
    if plane.streamwise is not None:
        u = VelocityPlane(plane.streamwise, sampling_rate=plane.sampling_rate, name=f"{plane.name}, streamwise")
        mean, square = time_moments(u)
        profiles.append(np.sqrt(_over_z((square - mean**2).clamp(min=0).reshape(plane.probe_shape))))
    try:
        found = [cell_modulation(plane.x, each, pitch) for each in profiles]
    except ValueError as error:
        notes.append(f"{plane.name}: no cell-periodic modulation can be judged: {error}")
        return []
    if found[0].cells == 1:
        notes.append(
            "the probes span a single cell: the cell-periodic modulation is the harmonics of the pitch in it, and "
            "nothing shows that they repeat"
        )
    return found


def _over_z(values: Tensor) -> Array:
    """Mean over z of (z, x); (x) as it is."""
    return values.detach().cpu().reshape(-1, values.shape[-1]).nanmean(0).to(torch.float64).numpy()


def _jet(
    plane: VelocityPlane, seen: ImpedanceMap, liner: LinerModel, duct: tuple[float, float], notes: list[str]
) -> Row:
    """jet_velocity and jet_height; ``notes`` gets why one of them is not known."""
    found, z = Row(jet_velocity=None, jet_height=None), complex(seen.answer[0])
    level, mach, porosity, diameter = plane.incident_level, plane.mach, liner.surface_porosity, liner.hole_diameter
    try:
        if plane.liner == "hard wall" or level is None or porosity is None or not 0 < abs(z) < math.inf:
            raise ValueError("it takes holes, the level of the sound, a porosity and an impedance")
        found["jet_velocity"] = jet_velocity(level, plain_number(porosity), z, plane.fluid)
        if mach == 0:
            raise ValueError("without a mean flow A.2 sets no limit to a jet")
        if mach is None or diameter is None:
            raise ValueError("it takes a Mach number and a hole diameter")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)  # of a thin shear layer: ``study_heights`` has warned
            profile = TanhProfile(mach, *duct, float(plane.fluid.sound_speed))
        found["jet_height"] = float(penetration_height(found.jet_velocity, diameter, profile))
    except ValueError as error:
        notes.append(f"no jet height: {error}")
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
    rows, facts = list[Row](), study.facts
    for averaging in facts[0].impedance:
        for here, above in itertools.zip_longest(facts, facts[1:]):
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
            for name, value in values.items():
                about = {"height": here.height, "averaging": averaging, "name": name, "value": value}
                limit = here.level_limit if name == "level check" else limits[name]
                rows.append(Row(about, limit=limit, passed=value is not None and value <= limit))
    heights = {
        averaging: next(
            (
                one.height
                for one in facts
                if all(row.passed for row in rows if (row.height, row.averaging) == (one.height, averaging))
            ),
            None,
        )
        for averaging in facts[0].impedance
    }
    return Study(height=heights[study.averaging], heights=heights, rows=rows)


def _relative(found: complex, wanted: complex) -> float:
    """|found - wanted| over |wanted|; infinite where one of them is."""
    known = abs(found) < math.inf and 0 < abs(wanted) < math.inf
    return abs(found - wanted) / abs(wanted) if known else math.inf
