"""Which height? Z against height, what else speaks of a height, and the lowest that each averaging can be taken at."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from torchliner.checks import tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.case import planes_by_height
from torchliner.studies.variants import Row, Study, plane_of
from torchliner.velocity.educe import educe

DRIFT = 25.0 + 30.0j  # per m of height, eq. (A1), for sound at grazing incidence
LIMIT = 0.1  # of modulation, difference of averagings, change with height, 1 - coherence: a choice of this program
FEWEST_PROBES, MOST_HARMONICS = 4, 8  # to a cell
WHOLE = 0.01  # of a cell or spacing, by which probes may miss a whole number of cells or an even step


def study_heights(
    planes: Sequence[VelocityPlane | Moments],
    liner: Liner,
    frequency: float | None = None,
    *,
    progress: Callable[[int], object] | None = None,
    **choices: Any,
) -> Study:
    """Z over height, the cell-periodic modulation of v'_rms, and for each averaging the lowest height that holds.

    Where the level check was made it decides alone. Else Z must have settled, so that the highest plane never
    qualifies; ``velocity`` also needs a velocity in step with the tone, and ``admittance`` must agree with ``velocity``
    where v is in step, and needs little cell-periodic modulation where it is not. No reference impedance is used, and
    none of this says that Z is right.

    Args:
        planes: of one case at different heights, or their ``Moments``.
        liner, choices: as for ``educe``; no intervals by default.
        frequency: Hz, one; default the planes' own tone.
        progress: called with numbers of samples, 2 T per plane.
    Returns:
        title, frequency (Hz), averaging, choices, notes; reference (independent impedances, for comparison alone).
        ``rows``, the lowest first: height (m); impedance, level_check (dB), by averaging; level_limit (dB); coherence
        (squared, of v with the tone, median over probes); velocity_rms (v', m/s); modulation (rms of the cell-periodic
        part of v'_rms along x over its mean; None without a whole cell); drift (of grazing sound by eq. (A1)). heights
        (m, by averaging; None where none qualifies), height (that of the averaging of the answer), and ``judged``,
        lowest first: height, averaging, name (``level check``, or of a limit), value (dB, or a share of 1; None where
        it could not be judged), limit, passed.
    Raises:
        ValueError: planes without or of equal height, of different cases or frequencies.
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
        try:
            rows[-1]["modulation"] = _modulation(plane, maps[-1], model.cell_pitch)
        except ValueError as reason:
            notes.append(f"{plane.name}: no cell-periodic modulation can be judged: {reason}")
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
        reference=first.reference_at(0),
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
        modulation=None,
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
        elif averaging == "admittance":
            found["modulation"] = here.modulation
    about = {"height": here.height, "averaging": averaging, "limit": limit}
    return [
        Row(about, name=name, value=value, passed=value is not None and value <= limit) for name, value in found.items()
    ]


def _modulation(plane: VelocityPlane, seen: ImpedanceMap, pitch: float | None) -> float:
    """Of v'_rms along x; ValueError where it cannot be judged."""
    if pitch is None or plane.x is None:
        raise ValueError("no cell pitch is known" if pitch is None else "the plane states no x")
    square = seen.velocity_rms.detach().cpu().double().square()
    profile = square.reshape(-1, square.shape[-1]).nanmean(0).sqrt()
    mean, harmonics = cell_modulation(plane.x.numpy(), profile.numpy(), pitch)
    return math.hypot(*harmonics) / 2**0.5 / mean


def cell_modulation(x: ArrayLike, values: ArrayLike, pitch: float) -> tuple[float, list[float]]:
    """Cell-periodic part of a profile along x, m/s at evenly rising x, m, (N,); ``pitch`` is L_c, m.

    Harmonics are fitted by least squares over whole cells, together with a mean and, from two cells on, a linear growth
    along x and the waves between the harmonics: no probe has to sit at the same place of every cell.

    Returns:
        The mean over whole cells; peak amplitudes of harmonics 1, 2, ... of the pitch.
    Raises:
        ValueError: uneven places, no whole cell, or fewer than four probes in one.
    """
    places, profile = np.asarray(x, np.float64), np.asarray(values, np.float64)
    steps = np.diff(places)
    if len(steps) < 1 or not abs(steps - steps.mean()).max() <= WHOLE * steps.mean():
        raise ValueError("the probes do not lie in even, rising steps along x")
    spacing = float(steps.mean())
    cells = math.floor(len(places) * spacing / pitch + WHOLE)
    most = math.ceil(pitch / (2 * spacing)) - (1 if cells == 1 else 2)
    if cells < 1 or most < 1 or pitch / spacing < FEWEST_PROBES - 1e-6:
        raise ValueError(
            f"the probes span {1e3 * len(places) * spacing:.4g} mm with {pitch / spacing:.3g} to a cell of "
            f"{1e3 * pitch:.4g} mm; a whole cell with {FEWEST_PROBES} is needed at least, of several cells more"
        )
    inside = places - places[0] < cells * pitch - (0.5 - WHOLE) * spacing
    phase = (places[inside] - places[0]) / pitch
    orders = np.arange(1.0, min(MOST_HARMONICS, most) + 0.5)
    count, steady = len(orders), [np.ones_like(phase)]
    if cells > 1:
        orders = np.concatenate([orders, orders + 0.5])
        steady.append(phase - phase.mean())
    turns = 2 * np.pi * np.outer(phase, orders)
    columns = np.concatenate([np.stack(steady, 1), np.cos(turns), np.sin(turns)], 1)
    found, *_ = np.linalg.lstsq(columns, profile[inside], rcond=None)
    sizes = np.hypot(*found[len(steady) :].reshape(2, -1))
    return float(found[0]), sizes[:count].tolist()
