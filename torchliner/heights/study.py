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
from torchliner.engine.nodes import choose_nodes
from torchliner.heights.facts import Decay, HeightFacts, JetFlow, facts_of_plane, fit_decay
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.boxes import Grid, grid_of, windows_of
from torchliner.records.same_case import planes_by_height
from torchliner.studies.source import Further, Source, average_of
from torchliner.velocity.answer import answer
from torchliner.velocity.choices import Choices

CELL_SHARES = (1 / 8, 1 / 4, 1 / 2)

Record = VelocityPlane | Moments
UNKNOWN = complex(math.nan, math.nan)


@dataclass(frozen=True)
class LengthRow:
    """Impedance of one plane at one averaging length.

    Args:
        height, length: m.  probes, windows: probes in a window, and windows.
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
        title: what the planes share.  frequency: Hz.  pitch: L_c, m; None if there are no cells.
        lengths: m, rising.  rows: lowest plane first, then by length.  facts: lowest plane first.
        decay, first_decay: of the cell-periodic part of v'_rms relative to its mean, and of its first
            harmonic in m/s; None with fewer than three heights.
        reference: independent impedances, for comparison alone.  choices: of the eduction.
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
    planes: Sequence[Record],
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
    model, stated = as_liner(liner), [_stated(each) for each in planes]
    records = {id(plane): each for plane, each in zip(stated, planes, strict=True)}
    ordered = planes_by_height(stated)
    wanted = _one_frequency(ordered, frequency)
    pitch = model.cell_pitch if cell_pitch is None else cell_pitch
    if pitch is not None:
        require_positive("cell_pitch (m)", pitch)
    grids = [grid_of(plane) for plane in ordered]
    long = _checked_lengths(lengths, grids) if lengths else _default_lengths(grids, pitch)
    # What stands beside the heights are spreads; no interval is shown.
    chosen = Choices(**{"interval": None, **choices})
    maps: list[ImpedanceMap] = []
    rows: list[LengthRow] = []
    for plane, grid in zip(ordered, grids, strict=True):
        work = _Height(records[id(plane)], model, wanted, chosen, reference_phase)
        maps.append(work.seen)
        rows += work.rows(grid, long)
        if progress is not None:
            progress(1)
    notes, facts = [note.text for seen in maps for note in seen.notes], []
    notes += [
        f"{plane.name} holds moments: the averaged velocity is known of its cells alone, not over averaging lengths; "
        "name the plane that was reduced"
        for plane in ordered
        if isinstance(records[id(plane)], Moments)
    ]
    for plane, seen in zip(ordered, maps, strict=True):
        one, unknown = facts_of_plane(plane, seen, model, pitch, flow or JetFlow())
        facts.append(one)
        notes += unknown
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
        reference=maps[0].reference_at(0),
        choices=dict(maps[0].choices),
        notes=tuple(notes),
        source_side=ordered[0].source_side,
    )


def _stated(record: Record) -> VelocityPlane:
    return record.plane if isinstance(record, Moments) else record


def _one_frequency(planes: Sequence[VelocityPlane], frequency: float | None) -> float:
    if frequency is None:
        stated = {plane.frequency for plane in planes}
        if len(stated) > 1:
            raise ValueError(f"the planes state different frequencies, {sorted(map(str, stated))}; give one")
    values = stated_frequency(frequency, planes[0].frequency, planes[0].name)
    if len(values) != 1:
        raise ValueError(f"heights are compared at one frequency; {len(values)} are given")
    return float(values[0])


def _default_lengths(grids: Sequence[Grid], pitch: float | None) -> list[float]:
    """A spacing, shares of a cell, whole cells by doubling, the whole plane."""
    shortest, longest = max(g.spacing for g in grids), min(g.length for g in grids)
    unit = pitch or longest
    steps = [shortest, *(share * unit for share in CELL_SHARES)]
    steps += [unit * 2**k for k in range(math.ceil(math.log2(max(longest / unit, 1))) + 1)]
    kept = [shortest]
    for length in [*steps[1:], longest]:
        # Lengths that come to the same number of probes are one.
        if kept[-1] + 0.5 * shortest < length <= longest + 0.5 * shortest:
            kept.append(length)
    return kept


def _checked_lengths(lengths: Sequence[float], grids: Sequence[Grid]) -> list[float]:
    shortest, longest = max(g.spacing for g in grids), min(g.length for g in grids)
    for length in lengths:
        require_positive("averaging length (m)", length)
        if length < shortest * (1 - 1e-3):
            raise ValueError(
                f"averaging length {1e3 * length:.4g} mm is below the spacing of the probes, {1e3 * shortest:.4g} mm"
            )
        if length > longest + 0.5 * shortest:
            raise ValueError(
                f"averaging length {1e3 * length:.4g} mm is above the plane's length, {1e3 * longest:.4g} mm"
            )
    return sorted(set(lengths))


class _Height:
    """One plane."""

    def __init__(
        self, record: Record, model: LinerModel, frequency: float, chosen: Choices, reference_phase: float | None
    ) -> None:
        self.plane, self.model, self.phase = _stated(record), model, reference_phase
        self.frequency = self.plane.asked(frequency)
        self.chosen, self.source = chosen, None
        if isinstance(record, Moments):
            known = record
        else:
            nodes = choose_nodes([model], self.frequency, chosen.tolerance(record.velocity.dtype))
            self.source = Source(record, model, self.frequency, nodes, self.chosen)
            known = self.source.known
        with torch.no_grad():
            self.seen = answer(known, model, self.frequency, self.chosen, reference_phase)

    def rows(self, grid: Grid, lengths: Sequence[float]) -> list[LengthRow]:
        """At every averaging length, for which it is read once more."""
        reflection = self.seen.probes["admittance"].reflection[..., 0].flatten()
        over_probes = self.seen.probes["admittance"].admittance[..., 0].flatten()
        if self.seen.wall is not None:
            over_probes = torch.where(self.seen.wall[..., 0].flatten(), 0, over_probes)
        used = torch.isfinite(reflection.real).reshape(grid.rows, grid.columns)
        cut = [windows_of(grid, length, used) for length in lengths]
        over_velocity: list[Tensor | None]
        if self.source is None:
            alone = self.seen.probes["admittance"].admittance[..., 0].flatten()
            over_velocity = [alone if each.width * each.height == 1 else None for each in cut]
        else:
            rules = replace(self.chosen, averaging="velocity", background_rms=None, interval=None)
            others = self.source.others([Further(rules, each) for each in cut])
            over_velocity = [
                average_of(each, self.model, self.frequency, rules, "velocity", self.phase).cells.admittance[:, 0].cpu()
                for each in others
            ]
        return [
            LengthRow(
                self.plane.height or 0.0,
                length,
                windows.width * windows.height,
                windows.count,
                *_averages(windows.mean(over_probes), velocity),
            )
            for length, windows, velocity in zip(lengths, cut, over_velocity, strict=True)
        ]


def _averages(over_probes: Tensor, over_velocity: Tensor | None) -> tuple[complex, complex, complex, complex]:
    """Of both averagings, then the spreads, from the admittances of windows."""
    velocity, spread = (UNKNOWN, UNKNOWN) if over_velocity is None else _average(over_velocity)
    probes, between = _average(over_probes)
    return probes, velocity, between, spread


def _average(admittance: Tensor) -> tuple[complex, complex]:
    """1/<Y> over windows, and the spread of R and X over them."""
    known = admittance.reshape(-1)
    known = known[torch.isfinite(known.real)]
    impedance = impedance_from_admittance(known)
    spread = UNKNOWN
    if len(known) > 1:
        spread = complex(float(impedance.real.std()), float(impedance.imag.std()))
    return complex(mean_impedance(known)), spread


def _decays(facts: Sequence[HeightFacts], pitch: float | None) -> tuple[Decay | None, Decay | None]:
    known = [(one.height, one.imprint) for one in facts if one.imprint is not None]
    if pitch is None or len(known) < len(facts):
        return None, None
    heights = [height for height, _ in known]
    whole = fit_decay(heights, [imprint.relative for _, imprint in known], pitch)
    return whole, fit_decay(heights, [imprint.first for _, imprint in known], pitch)
