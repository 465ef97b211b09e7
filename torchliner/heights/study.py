"""Z against the height of the plane and the length the velocity is averaged over."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_positive, stated_frequency, tell
from torchliner.conversions import (
    admittance_from_reflection,
    impedance_from_admittance,
    mean_impedance,
)
from torchliner.heights.facts import Decay, HeightFacts, JetFlow, facts_of_plane, fit_decay
from torchliner.liners.model import Liner, as_liner
from torchliner.names import ORDERS
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.boxes import Grid, averaged_planes, grid_of, windows_of
from torchliner.records.same_case import planes_by_height
from torchliner.reduction.moments import Moments
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.educe import replay
from torchliner.tdibc.prepare import prepare

CELL_SHARES = (1 / 8, 1 / 4, 1 / 2)

Record = VelocityPlane | Moments
Educe = Callable[[Sequence[VelocityPlane]], list[ImpedanceMap]]
UNKNOWN = complex(math.nan, math.nan)


@dataclass(frozen=True)
class LengthRow:
    """Impedance of one plane at one averaging length, both orders.

    Args:
        height, length: m.  probes, windows: probes in a window, and windows.
        probes_first: 1/<Y> over windows, Y averaged over a window's probes.
        velocity_first: the same, v averaged over a window's probes and then replayed; nan of
            moments, but for windows of one probe.
        probes_first_spread, velocity_first_spread: standard deviation of R and of X over the
            windows; nan for one.
    """

    height: float
    length: float
    probes: int
    windows: int
    probes_first: complex
    velocity_first: complex
    probes_first_spread: complex
    velocity_first_spread: complex


@dataclass(frozen=True)
class HeightStudy:
    """Everything that speaks for or against a height.

    Args:
        title: what the planes share.  frequency: Hz.  pitch: L_c, m; None if there are no cells.
        lengths: m, rising.  rows: lowest plane first, then by length.  facts: lowest plane first.
        decay, first_decay: of the imprint of v'_rms relative to its mean, and of its first
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
    def order(self) -> str:
        """Of averaging, which the answer follows."""
        return str(self.choices.get("order", ""))

    def at_length(self, length: float) -> list[LengthRow]:
        """The rows of one averaging length, lowest first."""
        return [row for row in self.rows if row.length == length]


def study_heights(
    planes: Sequence[Record], liner: Liner, frequency: float | None = None, *,
    lengths: Sequence[float] | None = None, cell_pitch: float | None = None,
    flow: JetFlow | None = None, reference_phase: float | None = None,
    progress: Callable[[int], None] | None = None, **choices: Any,
) -> HeightStudy:  # fmt: skip
    """Z over height and averaging length, the cells' imprint, and the jets' height.

    Args:
        planes: of one case at different heights, each a line along x or a (z, x) plane with even
            spacing. Planes in files are read by slabs; the averaged velocities of one plane at
            all lengths are held in memory, 256 MB at most (fewer windows beyond that). Of the
            ``Moments`` of a plane everything is known but velocity first at these lengths.
        liner: as for ``educe``; its ``cell_pitch``, ``surface_porosity`` and ``orifice_diameter``
            are used where it has them.
        frequency: Hz, one; default the planes' own tone.
        lengths: averaging lengths along x (and z), m, from a spacing to the whole plane; default a
            spacing, 1/8, 1/4, 1/2, 1, 2, 4 ... cells and the whole plane.
        cell_pitch: L_c, m; default the liner's.  flow: mean flow for the jets' height.
        reference_phase: rad, for ``phase="given"``.  progress: called with 1 per plane.
        choices: see ``torchliner.tdibc.choices.Choices``; tones only. A ``wall_filter`` acts on
            the averages over probes.
    Returns:
        Rows by height and length, facts by height.
    Raises:
        ValueError: planes without or of equal height, of different cases or frequencies, or
            lengths that do not fit.
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
    if chosen.incident is not None:
        raise ValueError("heights are compared under a tone; leave the incident signal out")

    def educe(some: Sequence[Record], how: Choices) -> list[ImpedanceMap]:
        return [replay(ready).map(how.phase, reference_phase) for ready in prepare(some, model, wanted, how)]

    averaged = partial(educe, how=replace(chosen, order=ORDERS[0], oncoming_rms=None))
    given = [records[id(plane)] for plane in ordered]
    maps, rows = educe(given, chosen), []
    for record, grid, seen in zip(given, grids, maps, strict=True):
        rows += _rows_of(record, grid, long, seen, averaged)
        if progress is not None:
            progress(1)
    notes, facts = [note for seen in maps for note in seen.notes], []
    notes += [
        f"{each.plane.name} holds moments: velocity first is known of its cells alone, not over "
        "averaging lengths, for which v itself is averaged; name the plane that was reduced"
        for each in given if isinstance(each, Moments)
    ]  # fmt: skip
    for plane, seen in zip(ordered, maps, strict=True):
        one, unknown = facts_of_plane(plane, seen, model, pitch, flow or JetFlow())
        facts.append(one)
        notes += unknown
    notes = list(dict.fromkeys(notes))
    tell(notes)
    return HeightStudy(
        ordered[0].title.split(", y =")[0], wanted, pitch, tuple(long),
        tuple(sorted(rows, key=lambda row: (row.height, row.length))), tuple(facts),
        *_decays(facts, pitch), maps[0].reference_at(0), dict(maps[0].choices),
        tuple(notes), ordered[0].source_side,
    )  # fmt: skip


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


def _rows_of(record: Record, grid: Grid, lengths: Sequence[float], seen: ImpedanceMap, educe: Educe) -> list[LengthRow]:
    """One plane at every averaging length, for which it is read once."""
    plane, shape = _stated(record), (grid.rows, grid.columns)
    reflection = seen.reflection[..., 0].detach().cpu().reshape(shape)
    used = torch.isfinite(reflection.real)
    cut = [windows_of(grid, length, used, plane.samples * len(lengths)) for length in lengths]
    replies: list[Tensor | None]
    if isinstance(record, Moments):
        replies = [each.mean(reflection) if each.width * each.height == 1 else None for each in cut]
    else:
        replies = [found.reflection[..., 0] for found in educe(averaged_planes(plane, cut))]
    over_probes = seen.averaged_admittance[..., 0].detach().cpu().reshape(shape)
    return [
        LengthRow(
            plane.height or 0.0, length, windows.width * windows.height, windows.count,
            *_averages(windows.mean(over_probes), reply),
        )
        for length, windows, reply in zip(lengths, cut, replies, strict=True)
    ]  # fmt: skip


def _averages(over_probes: Tensor, reply: Tensor | None) -> tuple[complex, complex, complex, complex]:
    """Of both orders, then the spreads, from Y and R of windows."""
    velocity, spread = UNKNOWN, UNKNOWN
    if reply is not None:
        velocity, spread = _average(admittance_from_reflection(reply.detach().cpu()))
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
