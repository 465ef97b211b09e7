"""From sums over blocks to R of every probe, cell and the whole liner, each with its interval.

All of it is computed from all blocks and without each block in turn, along one axis of length B = 1 + S, so that the
intervals of probes, cells and liner come from the same lines of code as their values. Everything stays on the device.
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
from torchliner.engine.survey import Membership, Survey
from torchliner.liners.model import LinerModel, reflection_of
from torchliner.records.educed import Educed, Interval
from torchliner.velocity.choices import Choices

ELEMENTS = 1 << 17  # complex values that a thread works on at once on a CPU
Reflection = Callable[[slice], Tensor]  # R of some columns, from all blocks and without each of them, (B, n, F)


@dataclass(frozen=True, eq=False)
class Asked:
    """What Z is asked for.

    Args:
        liner: whose R.
        frequency: Hz, (F,), on the host.
        coefficients: of R in the sums that were kept, complex128, (F, J), on the device.
        chosen: all choices.
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
    chosen, frequency, lengths, seen = asked.chosen, asked.frequency, known.survey.lengths, None
    count = known.membership.count if averaging == "velocity" else known.plane.probes
    held = torch.ones(count, len(frequency), dtype=torch.bool, device=lengths.device)
    if chosen.drive == "rms" or chosen.phase == "self-consistent":
        seen = survey_of_columns(known, averaging)
        if chosen.phase == "self-consistent":
            held = seen.coherence(frequency) >= chosen.minimum_coherence
    bars = _interval(lengths, chosen) is not None

    def means(sums: Tensor) -> Tensor:
        """From sums over blocks: of all blocks and, if there are intervals, without each of them, (B, ...)."""
        return replicates(sums, lengths) if bars else known.survey.mean_of(sums)

    def reflection(part: slice) -> Tensor:
        if chosen.drive == "rms" and seen is not None:  # R at the rms over the record, and without each block
            square = means(seen.squares[:, part])
            if chosen.mean == "removed":
                square = square - means(seen.sums[:, 0, part]) ** 2
            speed = square.clamp(min=0).sqrt()
            return reflection_of(asked.liner, frequency, speed.cpu()[..., None]).to(speed.device)
        mean, turned = _mean_reflection(known, asked, known.sums[averaging][..., part], means)
        velocity = None if seen is None else -seen.tone(frequency, means, part) / 2
        phase = asked.phase
        if phase is not None and averaging == "velocity":
            phase = mean_direction(known.membership, phase).angle()
        sound = Sound(velocity, held[part], None if phase is None else phase[part])
        found = PHASE_RULES[chosen.phase](mean, turned, sound)
        if averaging == "phase-locked" and known.locked is not None and known.locked.scale is not None:
            # The record's own level of turbulence, which varies from block to block, was replaced by a stated one.
            found = torch.cat([found[:1], found[:1] + (found[1:] - found[:1]) / known.locked.scale[part, None]])
        return found

    return averages_of(known, asked, averaging, lengths, reflection, held)


def _mean_reflection(
    known: Moments, asked: Asked, sums: Tensor, means: Callable[[Tensor], Tensor]
) -> tuple[Tensor, Tensor]:
    """<R> and <R e^{-2 j omega t}> less what the mean of R leaves in it, (B, n, F); 0 where nobody asks for that."""
    coefficients = torch.view_as_real(asked.coefficients)  # (F, J, 2)
    of_all = coefficients.transpose(0, 1).flatten(1)
    mean = torch.view_as_complex((means(sums[:, 0]).transpose(1, 2) @ of_all).unflatten(2, (-1, 2)))
    if sums.shape[1] == 1:
        return mean, torch.zeros_like(mean)
    place = [int((known.turns - 2 * f).abs().argmin()) for f in asked.frequency.tolist()]
    cosine, sine = (
        torch.view_as_complex(means(sums[:, [first + i for i in place]]).transpose(2, 3) @ coefficients)
        for first in (1, 1 + len(known.turns))
    )
    waves = known.survey.blocks.wave_sums(2 * asked.frequency).to(mean.device)
    return mean, (cosine - 1j * sine).transpose(1, 2) - means(waves)[:, None] * mean


def survey_of_columns(known: Moments, averaging: str) -> Survey:
    """Of the columns that an averaging has: probes, cells, or probes with the phase-locked velocity of their cell."""
    seen, cells = known.survey, known.membership
    if averaging == "velocity":
        squares = known.sums.get("square of cells")
        of_cells = torch.full_like(cells.sum(seen.squares), torch.nan) if squares is None else squares[:, 0, 0]
        return dataclasses.replace(seen, sums=cells.mean(seen.sums), squares=of_cells, peaks=cells.mean(seen.peaks))
    if averaging == "phase-locked" and known.locked is not None:
        return survey_of_locked(known.locked, seen)
    return seen


def mean_direction(cells: Membership, phase: Tensor) -> Tensor:
    """Mean of e^{j psi} over each cell's probes, (C, F or 1)."""
    return cells.mean(torch.exp(1j * phase).T).T


def averages_of(
    known: Moments, asked: Asked, averaging: str, lengths: Tensor, reflection: Reflection, held: Tensor
) -> Averages:
    """Averages of the admittances of columns: probes or, of averaging ``velocity``, cells.

    Args:
        known, asked, averaging: what is asked of which moments.
        lengths: weights of the blocks, (S,).
        reflection: R of some columns.
        held: where the phase rule could be used, bool, (N, F).
    """
    cells, interval, share, x = known.membership, _interval(lengths, asked.chosen), None, None
    of_cells, device = averaging == "velocity", lengths.device
    if of_cells:
        labels, counted = torch.arange(cells.count, device=device), torch.ones_like(held[:, :1])
        share = None if known.cells.weight is None else known.cells.weight.to(device)
    else:
        labels, counted = cells.labels, known.counted[:, None]
        counted = counted if averaging == "admittance" else counted & (labels < cells.count)[:, None]
        shape = known.plane.probe_shape
        x = torch.arange(known.plane.probes, device=device) % shape[1] if len(shape) == 2 else None
    # Sums of admittances over each cell, the probes of no cell, and each x, side by side.
    groups = cells.count + 1 + (0 if x is None else known.plane.probe_shape[1])
    numbers, sums = torch.zeros(groups, dtype=torch.float64, device=device), torch.empty(0)
    found: list[Educed] = []

    def work(part: slice) -> tuple[slice, Tensor, Educed | None]:
        each = reflection(part)
        leave = ~counted[part]
        if asked.wall is not None and not of_cells:
            leave = leave | asked.wall[part]
        admittance = admittance_from_reflection(each).masked_fill(leave, 0)
        return part, admittance, None if of_cells else _educed(each, interval)

    parts = _parts(held, lengths)
    alone = is_differentiated(asked.coefficients)
    for part, admittance, educed in map(work, parts) if alone else in_order(work, parts, device):
        found += [] if educed is None else [educed]
        if not sums.numel():
            sums = admittance.new_zeros(len(admittance), groups, held.shape[1])
        weight = counted[part, 0].double() if share is None else share[part]
        admittance = admittance if share is None else admittance * weight[:, None]
        for place in [labels[part]] + ([] if x is None else [cells.count + 1 + x[part]]):
            sums.index_add_(1, place, admittance)
            numbers.index_add_(0, place, weight)
    every = slice(cells.count + 1)
    sums, number = (
        torch.cat([each[..., every, :].sum(-2, keepdim=True), each], -2) for each in (sums, numbers[:, None])
    )
    averaged = reflection_from_admittance(sums / torch.where(number > 0, number, torch.nan))
    joined = _educed(averaged, interval)
    return Averages(
        probes=None if of_cells else _joined(found, known.counted[:, None]),
        cells=joined.map(lambda value: value[1 : 1 + cells.count]),
        liner=joined.map(lambda value: value[0]),
        along_x=None if x is None else joined.map(lambda value: value[2 + cells.count :]),
        replicates=averaged[:, : 1 + cells.count],
        held=held,
    )


def _interval(lengths: Tensor, chosen: Choices) -> Callable[[Tensor], Interval] | None:
    """What makes the interval of R with all its replicates, (B, ...); None where there are none."""
    level = chosen.interval
    if level is None or len(lengths) < FEWEST_BLOCKS:
        return None
    return lambda reflection: jackknife(reflection, lengths / lengths.sum(), level)


def _parts(held: Tensor, lengths: Tensor) -> list[slice]:
    """Slices of columns: the bits of a column do not depend on them."""
    count = len(held)
    size = max(1, ELEMENTS // ((1 + len(lengths)) * held.shape[1])) if held.device.type == "cpu" else count
    return [slice(left, min(left + size, count)) for left in range(0, count, size)]


def _educed(reflection: Tensor, interval: Callable[[Tensor], Interval] | None) -> Educed:
    return Educed(reflection[0], None if interval is None else interval(reflection.detach()))


def _joined(parts: list[Educed], used: Tensor) -> Educed:
    """All probes; nan where a probe was left out."""
    intervals = [part.interval for part in parts if part.interval is not None]
    joined = Interval.joined(intervals) if intervals else None

    def mask(value: Tensor) -> Tensor:
        return torch.where(used, value, complex(math.nan, math.nan) if value.is_complex() else math.nan)

    return Educed(torch.cat([part.reflection for part in parts]), joined).map(mask)
