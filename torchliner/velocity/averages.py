"""From sums over blocks to R of every probe, cell and the whole liner, each with its interval.

All of it is computed from all blocks and without each block in turn, along one axis of length B (``replicates``), so
that the intervals of probes, cells and liner come from the same lines of code as their values. It stays on the device.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.conversions import admittance_from_reflection, reflection_from_admittance
from torchliner.engine.drives import survey_of_locked
from torchliner.engine.intervals import FEWEST_BLOCKS, jackknife, replicates
from torchliner.engine.moments import Moments
from torchliner.engine.phase import PHASE_RULES, Sound
from torchliner.engine.sums import in_order, is_differentiated
from torchliner.engine.survey import Survey
from torchliner.liners.model import LinerModel, reflection_of
from torchliner.records.educed import Educed, Interval
from torchliner.velocity.choices import Choices

ELEMENTS = 1 << 17  # complex values that a thread works on at once on a CPU
Reflection = Callable[[slice], Tensor]  # R of some columns, from all blocks and without each of them, (B, n, F)


@dataclass(frozen=True, eq=False)
class Asked:
    """What Z is asked for.

    Args:
        liner, frequency: whose R, at which Hz, (F,), on the host.
        coefficients: of R in the sums that were kept, complex128, (F, J), on the device.
        phase: psi of the incident tone, rad, (P, F or 1), for phase ``given``, on the device.
        wall: probes that count as wall, bool, (P, F), on the device; None without a wall filter.
    """

    liner: LinerModel
    frequency: Tensor
    coefficients: Tensor
    chosen: Choices
    phase: Tensor | None = None
    wall: Tensor | None = None

    @classmethod
    def of(
        cls, known: Moments, liner: LinerModel, frequency: Tensor, chosen: Choices, phase: Tensor | None = None
    ) -> Asked:
        """Of moments; ``phase`` may be on any device."""
        device, wall, liner = known.survey.sums.device, None, liner.in_flow(known.plane.mach)
        if chosen.wall_filter is not None:
            wall = (known.survey.coherence(frequency) < chosen.wall_filter) & known.counted[:, None]
        coefficients = known.coefficients(liner, frequency).to(device)
        return cls(liner, frequency, coefficients, chosen, None if phase is None else phase.to(device), wall)


@dataclass(frozen=True, eq=False)
class Averages:
    """R under one averaging.

    Args:
        probes: (P, F); None for ``velocity``, which knows cells only.
        cells: (C, F).
        liner: (F,).
        along_x: of the admittance averaged over z, (X, F); None for planes without rows and for ``velocity``.
        replicates: R of the liner and of the cells from all blocks and without each of them, (B, 1 + C, F).
        held: where the phase rule could be used, bool, (N, F); N probes or cells.
    """

    probes: Educed | None
    cells: Educed
    liner: Educed
    along_x: Educed | None
    replicates: Tensor
    held: Tensor


def average(known: Moments, asked: Asked, averaging: str) -> Averages:
    """R of probes, cells and liner under one averaging."""
    chosen, frequency, lengths, seen = asked.chosen, asked.frequency, known.survey.lengths, known.survey
    consistent, phase, locked = chosen.phase == "self-consistent", asked.phase, known.locked
    count = known.membership.count if averaging == "velocity" else known.plane.probes
    held = torch.ones(count, len(frequency), dtype=torch.bool, device=lengths.device)
    if chosen.drive == "rms" or consistent:
        seen = survey_of_columns(known, averaging)
    if consistent:
        held = seen.coherence(frequency) >= chosen.minimum_coherence
    if phase is not None and averaging == "velocity":
        phase = known.membership.mean(torch.exp(1j * phase).T).T.angle()
    bars = chosen.interval is not None and len(lengths) >= FEWEST_BLOCKS
    each = torch.view_as_real(asked.coefficients)  # (F, J, 2)
    of_all = each.transpose(0, 1).flatten(1)
    turns = [int((known.turns - 2 * f).abs().argmin()) for f in frequency.tolist()] if len(known.turns) else []

    def means(sums: Tensor) -> Tensor:
        """From sums over blocks: of all blocks and, if there are intervals, without each of them, (B, ...)."""
        return replicates(sums, lengths) if bars else known.survey.mean_of(sums)

    def reflection(part: slice) -> Tensor:
        if chosen.drive == "rms":  # R at the rms over the record, and without each block
            square = means(seen.squares[:, part])
            if chosen.mean == "removed":
                square = square - means(seen.sums[:, 0, part]) ** 2
            speed = square.clamp(min=0).sqrt()
            return reflection_of(asked.liner, frequency, speed.cpu()[..., None]).to(speed.device)
        sums = known.sums[averaging][..., part]
        a = torch.view_as_complex((means(sums[:, 0]).transpose(1, 2) @ of_all).unflatten(2, (-1, 2)))  # <R>
        b = torch.zeros_like(a)  # <R e^{-2 j omega t}> less what the mean of R leaves in it
        if turns and chosen.phase != "averaged":
            cosine, sine = (
                torch.view_as_complex(means(sums[:, [first + i for i in turns]]).transpose(2, 3) @ each)
                for first in (1, 1 + len(known.turns))
            )
            waves = known.survey.blocks.wave_sums(2 * frequency).to(a.device)
            b = (cosine - 1j * sine).transpose(1, 2) - means(waves)[:, None] * a
        velocity = -seen.tone(frequency, means, part) / 2 if consistent else None
        found = PHASE_RULES[chosen.phase](a, b, Sound(velocity, held[part], None if phase is None else phase[part]))
        if averaging == "phase-locked" and locked is not None and locked.scale is not None:
            # The record's own level of turbulence, which varies from block to block, was replaced by a stated one.
            found = torch.cat([found[:1], found[:1] + (found[1:] - found[:1]) / locked.scale[part, None]])
        return found

    return averages_of(known, asked, averaging, lengths, reflection, held)


def survey_of_columns(known: Moments, averaging: str) -> Survey:
    """Of the columns that an averaging has: probes, cells, or probes with the phase-locked velocity of their cell."""
    seen, cells = known.survey, known.membership
    if averaging == "velocity":
        squares = known.sums.get("square of cells")
        of_cells = torch.full_like(cells.mean(seen.squares), torch.nan) if squares is None else squares[:, 0, 0]
        return dataclasses.replace(seen, sums=cells.mean(seen.sums), squares=of_cells, peaks=cells.mean(seen.peaks))
    if averaging == "phase-locked" and known.locked is not None:
        return survey_of_locked(known.locked, seen)
    return seen


def averages_of(
    known: Moments, asked: Asked, averaging: str, lengths: Tensor, reflection: Reflection, held: Tensor
) -> Averages:
    """Averages of the admittances of columns: probes or, of averaging ``velocity``, cells.

    ``lengths``: weights of the blocks, (S,); ``held``: where the phase rule could be used, bool, (N, F).
    """
    cells, device, (columns, frequencies) = known.membership, lengths.device, held.shape
    of_cells, share, x, rows = averaging == "velocity", None, None, 0
    level = asked.chosen.interval if len(lengths) >= FEWEST_BLOCKS else None
    if of_cells:
        labels, counted = torch.arange(cells.count, device=device), torch.ones_like(held[:, :1])
        share = None if known.cells.weight is None else known.cells.weight.to(device)
    else:
        labels, counted = cells.labels, known.counted[:, None]
        if averaging == "phase-locked":
            counted = counted & (labels < cells.count)[:, None]
        if len(known.plane.probe_shape) == 2:
            rows = known.plane.probe_shape[1]
            x = torch.arange(columns, device=device) % rows
    # Sums of admittances over each cell, the probes of no cell, and each x, side by side.
    numbers, sums = torch.zeros(cells.count + 1 + rows, dtype=torch.float64, device=device), torch.empty(0)

    def educed(replicated: Tensor) -> Educed:
        own = None if level is None else jackknife(replicated.detach(), lengths / lengths.sum(), level)
        return Educed(replicated[0], own)

    def work(part: slice) -> tuple[slice, Tensor, Educed | None]:
        each = reflection(part)
        leave = ~counted[part]
        if asked.wall is not None and not of_cells:
            leave = leave | asked.wall[part]
        return part, admittance_from_reflection(each).masked_fill(leave, 0), None if of_cells else educed(each)

    # The bits of a column do not depend on how the columns are shared out.
    size = max(1, ELEMENTS // ((1 + len(lengths)) * frequencies)) if device.type == "cpu" else columns
    parts, found = [slice(left, min(left + size, columns)) for left in range(0, columns, size)], list[Educed]()
    for part, admittance, own in (
        map(work, parts) if is_differentiated(asked.coefficients) else in_order(work, parts, device)
    ):
        found += [] if own is None else [own]
        if not sums.numel():
            sums = admittance.new_zeros(len(admittance), len(numbers), frequencies)
        weight = counted[part, 0].double() if share is None else share[part]
        admittance = admittance if share is None else admittance * weight[:, None]
        for place in [labels[part]] + ([] if x is None else [cells.count + 1 + x[part]]):
            sums.index_add_(1, place, admittance)
            numbers.index_add_(0, place, weight)
    sums, number = (
        torch.cat([each[..., : cells.count + 1, :].sum(-2, keepdim=True), each], -2)
        for each in (sums, numbers[:, None])
    )
    averaged = reflection_from_admittance(sums / torch.where(number > 0, number, torch.nan))
    joined, probes = educed(averaged), None
    if found:
        intervals = [each.interval for each in found if each.interval is not None]
        of_all = Educed(torch.cat([e.reflection for e in found]), Interval.joined(intervals) if intervals else None)
        left_out, nan = ~known.counted[:, None], complex(math.nan, math.nan)
        probes = of_all.map(lambda value: value.masked_fill(left_out, nan if value.is_complex() else math.nan))
    return Averages(
        probes=probes,
        cells=joined.map(lambda value: value[1 : 1 + cells.count]),
        liner=joined.map(lambda value: value[0]),
        along_x=None if x is None else joined.map(lambda value: value[2 + cells.count :]),
        replicates=averaged[:, : 1 + cells.count],
        held=held,
    )
