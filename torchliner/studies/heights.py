"""Which height? Z against height, what else speaks of a height, and the lowest that each averaging can be taken at."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from torchliner.checks import require_positive, tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.case import planes_by_height
from torchliner.studies.variants import Row, Study, plane_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import educe

DRIFT = 25.0 + 30.0j  # per m of height, eq. (A1), for sound at grazing incidence
FEWEST_PROBES, MOST_HARMONICS = 4, 8  # to a cell
WHOLE = 0.01  # of a cell or spacing, by which probes may miss a whole number of cells or an even step
MOST_SCATTER = 1.3  # of a decay


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
        planes: of one case at different heights, or their ``Moments``.
        liner, reference_phase, choices: as for ``educe``; no intervals by default.
        frequency: Hz, one; default the planes' own tone.
        cell_pitch: L_c, m; default the liner's.
        progress: called with 1 per plane.
    Returns:
        title, frequency (Hz), pitch (L_c, m, or None), averaging, choices, notes; reference (independent impedances,
        for comparison alone); decay, first_decay: ``Decay`` of modulation, and of its first harmonic in m/s; None with
        fewer than three heights. ``rows``, the lowest first: height (m); impedance, level_check (dB), by averaging;
        level_limit (dB); coherence (squared, of v with the tone, median over probes); velocity_rms (v', m/s);
        modulation (rms of the cell-periodic part of v'_rms along x over its mean), first_harmonic, between (of waves
        that nothing periodic in the cell has), None without a whole cell; drift (of grazing sound by eq. (A1)).
    Raises:
        ValueError: planes without or of equal height, of different cases or frequencies.
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
    options = {"interval": None, **choices, "reference_phase": reference_phase}
    maps, rows, notes, known = list[ImpedanceMap](), list[Row](), list[str](), list[Modulation]()
    for plane in ordered:
        seen, found = educe(records[id(plane)], model, wanted, **options), None
        try:
            if pitch is None or plane.x is None:
                raise ValueError("no cell pitch is known" if pitch is None else "the plane states no x")
            square = seen.velocity_rms.detach().cpu().double().square()
            profile = square.reshape(-1, square.shape[-1]).nanmean(0).sqrt()
            found = cell_modulation(plane.x.numpy(), profile.numpy(), pitch)
            known.append(found)
        except ValueError as reason:
            notes.append(f"{plane.name}: no cell-periodic modulation can be judged: {reason}")
        maps.append(seen)
        rows.append(_row(plane, seen, found))
        notes += [note.text for note in seen.notes]
        if progress is not None:
            progress(1)
    tell(notes := list(dict.fromkeys(notes)))
    heights = [row.height for row in rows] if len(known) == len(rows) else []
    return Study(
        title=ordered[0].title.split(", y =")[0],
        frequency=wanted[0],
        pitch=pitch,
        averaging=Choices(**choices).averaging,
        rows=tuple(rows),
        decay=fit_decay(heights, [each.rms / each.mean for each in known]),
        first_decay=fit_decay(heights, [each.harmonics[0] for each in known]),
        reference=maps[0].reference_at(0),
        choices=dict(maps[0].choices),
        notes=tuple(notes),
    )


def _row(plane: VelocityPlane, seen: ImpedanceMap, found: Modulation | None) -> Row:
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
        modulation=found and found.rms / found.mean,
        first_harmonic=found and found.harmonics[0] / math.sqrt(2) / found.mean,
        between=found and found.between and found.between / found.mean,
        drift=DRIFT * (plane.height or 0.0) if grazing else None,
    )


def recommend_height(
    study: Study, modulation: float = 0.1, averagings: float = 0.1, change: float = 0.1, turbulence: float = 0.1
) -> Study:
    """For each averaging, the lowest height where what it rests on holds. No reference impedance is used.

    Where the level check was made it decides alone. Else Z must have settled, so that the highest plane never
    qualifies; ``velocity`` also needs a velocity in step with the tone, and ``admittance`` must agree with ``velocity``
    where v is in step, and needs little cell-periodic modulation where it is not. None of this says that Z is right.

    Args:
        study: of ``study_heights``.
        modulation, averagings, change, turbulence: limits, a choice of this program: of the row's modulation; of
            |Z, admittance - Z, velocity| and the change of Z to the next height, over |Z|; of 1 - coherence.
    Returns:
        heights (m, by averaging; None where no height qualifies), height (that of the averaging of the answer), and
        ``rows``, lowest first: height, averaging, name (``level check``, or of a limit), value (dB, or a share of 1;
        None where it could not be judged), limit, passed.
    Source: Roncen et al. (2026), sections 5.5.2 and 7.2 (the trade-off) and appendix A.
    """
    limits = {"modulation": modulation, "averagings": averagings, "change": change, "turbulence": turbulence}
    for name, limit in limits.items():
        require_positive(f"limit on {name}", limit)
    rows, heights = list[Row](), dict.fromkeys(study.rows[0].impedance)
    for averaging in heights:
        for here, above in itertools.zip_longest(study.rows, study.rows[1:]):
            judged = []
            for name, value in _judged(averaging, here, above, turbulence).items():
                limit = here.level_limit if name == "level check" else limits[name]
                about = {"height": here.height, "averaging": averaging, "name": name, "value": value}
                judged.append(Row(about, limit=limit, passed=value is not None and value <= limit))
            if heights[averaging] is None and all(row.passed for row in judged):
                heights[averaging] = here.height
            rows += judged
    return Study(height=heights[study.averaging], heights=heights, rows=rows)


def _judged(averaging: str, here: Row, above: Row | None, turbulence: float) -> dict[str, float | None]:
    """What an averaging is judged by at one height, with the next one above."""
    if averaging in here.level_check:
        return {"level check": abs(here.level_check[averaging])}
    z, found = here.impedance, dict[str, float | None](change=None)
    if above is not None:
        found["change"] = _relative(above.impedance[averaging], z[averaging])
    if averaging == "velocity":
        found["turbulence"] = 1 - here.coherence if math.isfinite(here.coherence) else None
    elif averaging == "admittance" and here.coherence >= 1 - turbulence:
        found["averagings"] = _relative(z["admittance"], z["velocity"])
    elif averaging == "admittance":
        found["modulation"] = here.modulation
    return found


def _relative(found: complex, wanted: complex) -> float:
    """|found - wanted| over |wanted|; infinite where one of them is."""
    known = abs(found) < math.inf and 0 < abs(wanted) < math.inf
    return abs(found - wanted) / abs(wanted) if known else math.inf


class Modulation(NamedTuple):
    """Harmonics of the cell pitch in a profile along x.

    Args:
        mean: of the profile over whole cells, m/s.
        harmonics: peak amplitude of harmonics 1, 2, ... of the pitch, m/s.
        between: rms of the waves half way between them, m/s, which nothing periodic in the cell can have: what scatter
            alone gives. None for one cell.
    """

    mean: float
    harmonics: tuple[float, ...]
    between: float | None

    @property
    def rms(self) -> float:
        """Of the cell-periodic part, m/s."""
        return math.hypot(*self.harmonics) / math.sqrt(2)


def cell_modulation(x: ArrayLike, values: ArrayLike, pitch: float) -> Modulation:
    """Cell-periodic part of a profile along x, m/s at evenly rising x, m, (N,); ``pitch`` is L_c, m.

    Harmonics are fitted by least squares over whole cells, together with a mean and, from two cells on, a linear growth
    along x and the waves between the harmonics: no probe has to sit at the same place of every cell.

    Raises:
        ValueError: uneven places, no whole cell, or fewer than four probes in one.
    """
    places, profile = np.asarray(x, np.float64), np.asarray(values, np.float64)
    steps = np.diff(places)
    if places.shape != profile.shape or len(steps) < 1 or not abs(steps - steps.mean()).max() <= WHOLE * steps.mean():
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
    between = float(np.sqrt((sizes[count:] ** 2).sum() / 2)) if cells > 1 else None
    return Modulation(float(found[0]), tuple(sizes[:count].tolist()), between)


class Decay(NamedTuple):
    """a exp(-y/l): a at y = 0, l (m; negative where a grows with height), and the factor by which the heights stray
    from it (rms; 1 for none)."""

    amplitude: float
    length: float
    scatter: float

    @property
    def follows(self) -> bool:
        """Whether the amplitude falls, and strays from the fit by less than a factor 1.3."""
        return self.length > 0 and self.scatter <= MOST_SCATTER

    def at(self, height: Any) -> Any:
        """The fitted amplitude at a height, m."""
        return self.amplitude * np.exp(-np.asarray(height, np.float64) / self.length)


def fit_decay(heights: Sequence[float], amplitudes: Sequence[float]) -> Decay | None:
    """Least squares of ln(amplitude) over height, m; None with fewer than three heights or an amplitude not above 0."""
    if len(heights) < 3 or not all(a > 0 for a in amplitudes):
        return None
    places, logs = np.asarray(heights), np.log(amplitudes)
    slope, start = np.polyfit(places, logs, 1).tolist()
    stray = float(np.sqrt(np.mean((logs - slope * places - start) ** 2)))
    return Decay(math.exp(start), -1 / slope if slope else math.inf, math.exp(stray))
