"""From sums over blocks to R of every probe, cell and the whole liner, each with its interval.

All of it is computed from all blocks and without each block in turn, along one axis of length B = 1 + S, so that the
intervals of probes, cells and liner come from the same lines of code as their values. Everything stays on the device.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.conversions import admittance_from_reflection, reflection_from_admittance
from torchliner.engine.drives import survey_of_locked
from torchliner.engine.intervals import FEWEST_BLOCKS, QUARTERS, jackknife, replicates
from torchliner.engine.membership import Membership
from torchliner.engine.moments import Moments
from torchliner.engine.phase import PHASE_RULES, Sound
from torchliner.engine.survey import Survey
from torchliner.engine.threads import in_order, is_differentiated
from torchliner.liners.model import LinerModel, reflection_of
from torchliner.records.averaged import Educed
from torchliner.records.uncertainty import Interval
from torchliner.velocity.choices import Choices

ELEMENTS = 1 << 17  # complex values that a thread works on at once on a CPU


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
        of_liner, of_cells: R from all blocks and without each of them, (B, F) and (B, C, F), for the level check.
        held: where the phase rule could be used, bool, (N, F); N probes or cells.
    """

    probes: Educed | None
    cells: Educed
    liner: Educed
    along_x: Educed | None
    of_liner: Tensor
    of_cells: Tensor
    held: Tensor


def average(known: Moments, asked: Asked, averaging: str) -> Averages:
    """R of probes, cells and liner under one averaging."""
    return Columns.of(known, asked, averaging).averages()


@dataclass(frozen=True, eq=False)
class Columns:
    """R of the columns of one averaging, part by part.

    Args:
        known, asked, averaging: what is asked of which moments.
        lengths: samples of the blocks, (S,).
        held: where the phase rule can be used, bool, (N, F).
        survey: of the columns; None where neither phase rule nor drive needs one.
    """

    known: Moments
    asked: Asked
    averaging: str
    lengths: Tensor
    held: Tensor
    survey: Survey | None

    @classmethod
    def of(cls, known: Moments, asked: Asked, averaging: str) -> Columns:
        """From the sums of the moments."""
        chosen, frequency, lengths, seen = asked.chosen, asked.frequency, known.survey.lengths, None
        count = known.membership.count if averaging == "velocity" else known.plane.probes
        held = torch.ones(count, len(frequency), dtype=torch.bool, device=lengths.device)
        if chosen.drive == "rms" or chosen.phase == "self-consistent":
            seen = survey_of_columns(known, averaging)
            if chosen.phase == "self-consistent":
                held = seen.coherence(frequency) >= chosen.minimum_coherence
        return cls(known, asked, averaging, lengths, held, seen)

    def averages(self) -> Averages:
        """R of probes, cells and liner."""
        return _of_cell_velocity(self, self.known) if self.averaging == "velocity" else _of_probes(self, self.known)

    @property
    def count(self) -> int:
        """N."""
        return len(self.held)

    def means(self, sums: Tensor) -> Tensor:
        """From sums over blocks: of all blocks and, if there are intervals, without each of them, (B, ...)."""
        if self.interval is None:
            return self.known.survey.mean_of(sums)
        return replicates(sums, self.lengths)

    @property
    def interval(self) -> Callable[[Tensor], Interval] | None:
        """What makes the interval of R with all its replicates, (B, ...); None where there are none."""
        level = self.asked.chosen.interval
        if level is None or len(self.lengths) < FEWEST_BLOCKS:
            return None
        shares = self.lengths / self.lengths.sum()
        return lambda reflection: jackknife(reflection, shares, level)

    def parts(self) -> Iterator[slice]:
        """Slices of columns: the bits of a column do not depend on them."""
        size = self.count
        if self.lengths.device.type == "cpu":
            size = max(1, ELEMENTS // ((1 + len(self.lengths)) * len(self.asked.frequency)))
        return (slice(left, min(left + size, self.count)) for left in range(0, self.count, size))

    def reflection(self, part: slice) -> Tensor:
        """R from all blocks and without each of them, (B, n, F)."""
        if self.asked.chosen.drive == "rms" and self.survey is not None:
            return self._of_rms(part, self.survey)
        sums = self.known.sums[self.averaging][..., part]
        coefficients = torch.view_as_real(self.asked.coefficients)  # (F, J, 2)
        of_all = coefficients.transpose(0, 1).flatten(1)
        mean = torch.view_as_complex((self.means(sums[:, 0]).transpose(1, 2) @ of_all).unflatten(2, (-1, 2)))
        turned = self._turned(sums, coefficients, mean) if sums.shape[1] > 1 else torch.zeros_like(mean)
        found = PHASE_RULES[self.asked.chosen.phase](mean, turned, self._sound(part))
        locked = self.known.locked
        if self.averaging == "phase-locked" and locked is not None and locked.scale is not None:
            # The record's own level of turbulence, which varies from block to block, was replaced by a stated one.
            found = torch.cat([found[:1], found[:1] + (found[1:] - found[:1]) / locked.scale[part, None]])
        return found

    def _turned(self, sums: Tensor, coefficients: Tensor, mean: Tensor) -> Tensor:
        """<R e^{-2 j omega t}> less what the mean of R leaves in it, (B, n, F)."""
        place = [int((self.known.turns - 2 * f).abs().argmin()) for f in self.asked.frequency.tolist()]
        count = len(self.known.turns)
        cosine, sine = (
            torch.view_as_complex(self.means(sums[:, [first + i for i in place]]).transpose(2, 3) @ coefficients)
            for first in (1, 1 + count)
        )
        waves = self.known.survey.blocks.wave_sums(2 * self.asked.frequency).to(mean.device)
        return (cosine - 1j * sine).transpose(1, 2) - self.means(waves)[:, None] * mean

    def _sound(self, part: slice) -> Sound:
        velocity = None
        if self.survey is not None:
            velocity = -self.survey.tone(self.asked.frequency, self.means, part) / 2
        phase = self.asked.phase
        if phase is not None and self.averaging == "velocity":
            phase = mean_direction(self.known.membership, phase).angle()
        return Sound(velocity, self.held[part], None if phase is None else phase[part])

    def _of_rms(self, part: slice, seen: Survey) -> Tensor:
        """R at the rms of v over the record, and over the record without each block."""
        square = self.means(seen.squares[:, part])
        if self.asked.chosen.mean == "removed":
            square = square - self.means(seen.sums[:, 0, part]) ** 2
        speed = square.clamp(min=0).sqrt()
        return reflection_of(self.asked.liner, self.asked.frequency, speed.cpu()[..., None]).to(speed.device)


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


def _of_probes(columns: Columns, known: Moments) -> Averages:
    asked, cells, labels = columns.asked, known.membership, known.membership.labels
    interval, used = columns.interval, known.counted[:, None]
    counted = used if columns.averaging == "admittance" else used & (labels < cells.count)[:, None]
    x, count = _places_along_x(known)
    size = 1 + len(columns.lengths) + QUARTERS if interval is not None else 1
    # Sums of admittances over each cell, the probes of no cell, and each x, side by side.
    sums = counted.new_zeros(size, cells.count + 1 + count, len(asked.frequency), dtype=torch.complex128)
    numbers = counted.new_zeros(sums.shape[1], dtype=torch.float64)
    found: list[Educed] = []

    def work(part: slice) -> tuple[slice, Tensor, Educed]:
        reflection = columns.reflection(part)
        admittance = admittance_from_reflection(reflection)
        leave = ~counted[part]
        if asked.wall is not None:
            leave = leave | asked.wall[part]
        return part, admittance.masked_fill(leave, 0), _educed(reflection, interval)

    alone = is_differentiated(asked.coefficients)
    for part, admittance, educed in in_order(work, columns.parts(), sums.device, alone=alone):
        found.append(educed)
        for place in [labels[part]] + [cells.count + 1 + x[part]] * (count > 0):
            sums.index_add_(1, place, admittance)
            numbers.index_add_(0, place, counted[part, 0].double())
    every = slice(cells.count + 1)
    sums, numbers = (
        torch.cat([each[..., every, :].sum(-2, keepdim=True), each], -2) for each in (sums, numbers[:, None])
    )
    averaged = reflection_from_admittance(sums / torch.where(numbers > 0, numbers, torch.nan))
    joined = _educed(averaged, interval)
    of_cells = slice(1, 1 + cells.count)
    return Averages(
        probes=_joined(found, used),
        cells=joined.map(lambda value: value[of_cells]),
        liner=joined.map(lambda value: value[0]),
        along_x=joined.map(lambda value: value[2 + cells.count :]) if count else None,
        of_liner=averaged[:, 0],
        of_cells=averaged[:, of_cells],
        held=columns.held,
    )


def _of_cell_velocity(columns: Columns, known: Moments) -> Averages:
    found = torch.cat([columns.reflection(part) for part in columns.parts()], 1)
    weight = known.cells.weight
    share = torch.ones_like(found[0, :, 0]) if weight is None else weight.to(found)
    liner = torch.einsum("bcf,c->bf", admittance_from_reflection(found), share / share.sum())
    averaged = torch.cat([reflection_from_admittance(liner)[:, None], found], 1)
    every = _educed(averaged, columns.interval)
    return Averages(
        probes=None,
        cells=every.map(lambda value: value[1:]),
        liner=every.map(lambda value: value[0]),
        along_x=None,
        of_liner=averaged[:, 0],
        of_cells=found,
        held=columns.held,
    )


def _educed(reflection: Tensor, interval: Callable[[Tensor], Interval] | None) -> Educed:
    return Educed(reflection[0], None if interval is None else interval(reflection.detach()))


def _joined(parts: list[Educed], used: Tensor) -> Educed:
    """All probes; nan where a probe was left out."""
    one = parts[0]
    if len(parts) > 1:
        intervals = [part.interval for part in parts if part.interval is not None]
        joined = Interval.joined(intervals) if intervals else None
        one = Educed(torch.cat([part.reflection for part in parts]), joined)

    def mask(value: Tensor) -> Tensor:
        nothing = complex(math.nan, math.nan) if value.is_complex() else math.nan
        return torch.where(used, value, nothing)

    return one.map(mask)


def _places_along_x(known: Moments) -> tuple[Tensor, int]:
    """Which x each probe of a (z, x) plane has, and how many there are; 0 of other planes."""
    shape = known.plane.probe_shape
    count = shape[1] if len(shape) == 2 else 0
    return torch.arange(known.plane.probes, device=known.membership.labels.device) % max(count, 1), count
