"""Z against the height of the plane and the length the velocity is averaged over."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_positive, stated_frequency, tell
from torchliner.conversions import impedance_from_admittance, mean_impedance
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.boxes import Grid, grid_of, windows_of
from torchliner.records.same_case import planes_by_height
from torchliner.studies.height_facts import HeightFacts, JetFlow, facts_of_plane
from torchliner.studies.modulation import Decay, fit_decay
from torchliner.studies.variants import Source, Variant, plane_of
from torchliner.velocity.answer import answer
from torchliner.velocity.choices import Choices

CELL_SHARES = (1 / 8, 1 / 4, 1 / 2)
UNKNOWN = complex(math.nan, math.nan)


@dataclass(frozen=True)
class LengthRow:
    """Impedance of one plane at one averaging length.

    Args:
        height, length: m.
        probes, windows: probes in a window, and windows.
        admittance: 1/<Y> over windows, Y averaged over a window's probes.
        velocity: the same, of the velocity averaged over a window's probes; nan of moments, but for windows of one
            probe.
        admittance_spread, velocity_spread: standard deviation of R and of X over the windows; nan for one.
    """

    height: float
    length: float
    probes: int
    windows: int
    admittance: complex
    velocity: complex
    admittance_spread: complex
    velocity_spread: complex


@dataclass(frozen=True)
class HeightStudy:
    """Everything that speaks for or against a height.

    Args:
        title: what the planes share.
        frequency: Hz.
        pitch: L_c, m; None if there are no cells.
        lengths: m, rising.
        rows: lowest plane first, then by length.
        facts: lowest plane first.
        decay, first_decay: of the cell-periodic part of v'_rms relative to its mean, and of its first harmonic in m/s;
            None with fewer than three heights.
        reference: independent impedances, for comparison alone.
        choices: of the eduction.
        notes: warnings, and what is not known.
        source_side: where the sound comes from, one of ``names.SOURCE_SIDES``.
    """

    title: str
    frequency: float
    pitch: float | None
    lengths: tuple[float, ...]
    rows: tuple[LengthRow, ...]
    facts: tuple[HeightFacts, ...]
    decay: Decay | None
    first_decay: Decay | None
    reference: dict[str, complex]
    choices: dict[str, Any]
    notes: tuple[str, ...]
    source_side: str = "unknown"

    @property
    def averaging(self) -> str:
        """Of the answer."""
        return str(self.choices["averaging"])

    def at_length(self, length: float) -> list[LengthRow]:
        """The rows of one averaging length, lowest first."""
        return [row for row in self.rows if row.length == length]


def study_heights(
    planes: Sequence[VelocityPlane | Moments],
    liner: Liner,
    frequency: float | None = None,
    *,
    lengths: Sequence[float] | None = None,
    cell_pitch: float | None = None,
    flow: JetFlow | None = None,
    reference_phase: float | None = None,
    progress: Callable[[int], object] | None = None,
    **choices: Any,
) -> HeightStudy:
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
        flow: mean flow for the jets' height.
        reference_phase: rad, for ``phase="given"``.
        progress: called with 1 per plane.
        choices: see ``torchliner.velocity.choices.Choices``. A ``wall_filter`` acts on the averages over probes.
    Returns:
        Rows by height and length, facts by height.
    Raises:
        ValueError: planes without or of equal height, of different cases or frequencies, or lengths that do not fit.
    Warns:
        DataWarning: what is in ``notes``.
    Source: Roncen et al. (2026), sections 5.5.2 and 7.2, figures 11, 16 and 17, appendix A.
    """
    model, records = as_liner(liner), {id(plane_of(each)): each for each in planes}
    ordered = planes_by_height([plane_of(each) for each in planes])
    wanted = _one_frequency(ordered, frequency)
    pitch = model.cell_pitch if cell_pitch is None else cell_pitch
    if pitch is not None:
        require_positive("cell_pitch (m)", pitch)
    grids = [grid_of(plane) for plane in ordered]
    long = _checked_lengths(lengths, grids) if lengths else _default_lengths(grids, pitch)
    # What stands beside the heights are spreads; no interval is shown.
    chosen = Choices(**{"interval": None, **choices})
    rows: list[LengthRow] = []
    facts: list[HeightFacts] = []
    notes: list[str] = []
    first: ImpedanceMap | None = None
    for plane, grid in zip(ordered, grids, strict=True):
        source = Source(records[id(plane)], [model], wanted, chosen)
        with torch.no_grad():
            seen = answer(source.known, model, source.frequency, chosen, reference_phase)
        rows += _rows(source, seen, grid, long, reference_phase)
        one, unknown = facts_of_plane(plane, seen, model, pitch, flow or JetFlow())
        facts.append(one)
        notes += [*(note.text for note in seen.notes), *unknown]
        if source.reading is None:
            notes.append(
                f"{plane.name} holds moments: the averaged velocity is known of its cells alone, not over averaging "
                "lengths; name the plane that was reduced"
            )
        first = first or seen
        if progress is not None:
            progress(1)
    assert first is not None
    notes = list(dict.fromkeys(notes))
    tell(notes)
    decay, first_decay = _decays(facts, pitch)
    return HeightStudy(
        title=ordered[0].title.split(", y =")[0],
        frequency=wanted,
        pitch=pitch,
        lengths=tuple(long),
        rows=tuple(sorted(rows, key=lambda row: (row.height, row.length))),
        facts=tuple(facts),
        decay=decay,
        first_decay=first_decay,
        reference=first.reference_at(0),
        choices=dict(first.choices),
        notes=tuple(notes),
        source_side=ordered[0].source_side,
    )


def _one_frequency(planes: Sequence[VelocityPlane], frequency: float | None) -> float:
    stated = {plane.frequency for plane in planes}
    if frequency is None and len(stated) > 1:
        raise ValueError(f"the planes state different frequencies, {sorted(map(str, stated))}; give one")
    values = stated_frequency(frequency, planes[0].frequency, planes[0].name)
    if len(values) != 1:
        raise ValueError(f"heights are compared at one frequency; {len(values)} are given")
    return float(values[0])


def _default_lengths(grids: Sequence[Grid], pitch: float | None) -> list[float]:
    """A spacing, shares of a cell, whole cells by doubling, the whole plane."""
    shortest, longest = max(g.spacing for g in grids), min(g.length for g in grids)
    unit = pitch or longest
    steps = [share * unit for share in CELL_SHARES]
    steps += [unit * 2**k for k in range(math.ceil(math.log2(max(longest / unit, 1))) + 1)]
    kept = [shortest]
    for length in [*steps, longest]:
        # Lengths that come to the same number of probes are one.
        if kept[-1] + 0.5 * shortest < length <= longest + 0.5 * shortest:
            kept.append(length)
    return kept


def _checked_lengths(lengths: Sequence[float], grids: Sequence[Grid]) -> list[float]:
    shortest, longest = max(g.spacing for g in grids), min(g.length for g in grids)
    for length in lengths:
        require_positive("averaging length (m)", length)
        fault = ""
        if length < shortest * (1 - 1e-3):
            fault = f"below the spacing of the probes, {1e3 * shortest:.4g} mm"
        elif length > longest + 0.5 * shortest:
            fault = f"above the plane's length, {1e3 * longest:.4g} mm"
        if fault:
            raise ValueError(f"averaging length {1e3 * length:.4g} mm is {fault}")
    return sorted(set(lengths))


def _rows(
    source: Source, seen: ImpedanceMap, grid: Grid, lengths: Sequence[float], psi: float | None
) -> list[LengthRow]:
    """One plane at every averaging length, for which it is read once more."""
    probes = seen.probes["admittance"]
    alone = probes.admittance[..., 0].flatten()
    walled = alone if seen.wall is None else torch.where(seen.wall[..., 0].flatten(), 0, alone)
    used = torch.isfinite(probes.reflection.real[..., 0]).reshape(grid.rows, grid.columns)
    cut = [windows_of(grid, length, used) for length in lengths]
    over_velocity = [_average(alone) if each.width * each.height == 1 else (UNKNOWN, UNKNOWN) for each in cut]
    if source.reading is not None:
        chosen = replace(source.chosen, averaging="velocity", background_rms=None, interval=None)
        variants = [Variant({}, "velocity", chosen, windows=each, psi=psi) for each in cut]
        over_velocity = [(each.impedance, each.spread) for each in source.evaluate(variants)]
    rows = []
    for length, windows, (velocity, spread) in zip(lengths, cut, over_velocity, strict=True):
        admittance, between = _average(windows.mean(walled))
        size = windows.width * windows.height
        height = source.plane.height or 0.0
        rows.append(LengthRow(height, length, size, windows.count, admittance, velocity, between, spread))
    return rows


def _average(admittance: Tensor) -> tuple[complex, complex]:
    """1/<Y> over windows, and the spread of R and X over them."""
    known = admittance[torch.isfinite(admittance.real)]
    z = impedance_from_admittance(known)
    spread = complex(float(z.real.std()), float(z.imag.std())) if len(known) > 1 else UNKNOWN
    return complex(mean_impedance(known)), spread


def _decays(facts: Sequence[HeightFacts], pitch: float | None) -> tuple[Decay | None, Decay | None]:
    known = [(one.height, one.modulation) for one in facts if one.modulation is not None]
    if pitch is None or len(known) < len(facts):
        return None, None
    heights = [height for height, _ in known]
    whole = fit_decay(heights, [each.relative for _, each in known], pitch)
    return whole, fit_decay(heights, [each.first for _, each in known], pitch)
