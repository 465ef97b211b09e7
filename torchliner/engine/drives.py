r"""Averagings, and what else may act on the liner, as drives: functions of a slab that give the columns whose |v| acts.

Sound passes the holes of a whole cell; turbulence acts where it is. So ``phase-locked`` averaging drives a probe with

.. math:: v^*(x, t) = \langle v_p \rangle_\text{cell}(t) + [v(x, t) - v_p(x, t)] = v(x, t) - d(x, t),

where :math:`v_p` are the mean and the first harmonics of the tone, fitted over the record, and
:math:`d = v_p - \langle v_p \rangle` is all that is taken off. A fit over N periods keeps 1/N of the turbulence. How
much of d is that follows from its scatter over the blocks, and each harmonic of a cell is taken off by the share

.. math:: g = 1 - \frac{\text{variance of the mean over the blocks}}{\text{mean square of } d} \ge 0,

both over the cell's probes: the least mean square error of an estimate with such noise. (The variance is that of the
blocks over S - 1, times (1 + rho)/(1 - rho) where neighbours correlate by rho.) Without turbulence g = 1 and v* is
the velocity averaged over the cell; without sound d is noise, g is near 0 and v* is v.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.engine.blocks import waves
from torchliner.engine.intervals import correlation
from torchliner.engine.membership import Membership
from torchliner.engine.sums import Drive, of_columns
from torchliner.engine.survey import Survey, gram_of

FEWEST_BLOCKS = 3  # from which the scatter of a fit can be known


@dataclass(frozen=True)
class AsMeasured:
    """Averaging ``admittance``, the paper's: each probe is driven by its own velocity, (t, P)."""

    def __call__(self, v: Tensor, begin: int) -> Tensor:
        """Of a slab."""
        return v

    def of_columns(self, part: slice) -> Drive:
        """Of some probes."""
        return self


as_measured = AsMeasured()


@dataclass(frozen=True, eq=False)
class CellMean:
    """Averaging ``velocity``: the mean over the probes of each cell, (t, C)."""

    cells: Membership

    def __call__(self, v: Tensor, begin: int) -> Tensor:
        """Of a slab."""
        return self.cells.mean(v)


@dataclass(frozen=True, eq=False)
class LessMean:
    """Another drive less its mean over the record, m/s, (N,)."""

    drive: Drive
    mean: Tensor

    def __call__(self, v: Tensor, begin: int) -> Tensor:
        """Of a slab."""
        return self.drive(v, begin) - self.mean.to(v)

    def of_columns(self, part: slice) -> Drive | None:
        """Of some probes."""
        drive = of_columns(self.drive, part)
        return None if drive is None else LessMean(drive, self.mean[part])


@dataclass(frozen=True, eq=False)
class RunningRms:
    """rms of another drive over a window centred on each sample and cut at the ends of the record, m/s.

    Args:
        drive: whose rms.
        window: samples.
        samples: of the record.
    """

    drive: Drive
    window: int
    samples: int

    @property
    def reach(self) -> int:
        """Samples before and after a slab that it needs."""
        return self.window // 2 + 1

    def __call__(self, v: Tensor, begin: int) -> Tensor:
        """Of a slab; right for samples at least ``reach`` from its ends, or at the ends of the record."""
        squares = self.drive(v, begin).double().square()
        running = torch.nn.functional.pad(squares.cumsum(0), (0, 0, 1, 0))
        step = torch.arange(begin, begin + len(v), device=v.device) - self.window // 2
        first = (step.clamp(min=0) - begin).clamp(min=0)
        after = ((step + self.window).clamp(max=self.samples) - begin).clamp(max=len(v))
        mean = (running[after] - running[first]) / (after - first)[:, None]
        return mean.clamp(min=0).sqrt().to(v.dtype)

    def of_columns(self, part: slice) -> Drive | None:
        """Of some probes."""
        drive = of_columns(self.drive, part)
        return None if drive is None else RunningRms(drive, self.window, self.samples)


@dataclass(frozen=True, eq=False)
class PhaseLocked:
    """Averaging ``phase-locked``: v* = s v - rows @ taken, (t, P); see the head of this file.

    Args:
        lines: Hz, of the harmonics, (H,), on the device of the data.
        sampling_rate: Hz.
        taken: coefficients of 1, cos and sin of the lines, m/s, (1 + 2 H, P).
        scale: s, (P,); None for 1: no background is stated.
        share: g of the mean and of each harmonic, by cell, (1 + H, C).
        known: whether there were blocks enough to tell g; else it is 1.
    """

    lines: Tensor
    sampling_rate: float
    taken: Tensor
    scale: Tensor | None
    share: Tensor
    known: bool

    def __call__(self, v: Tensor, begin: int) -> Tensor:
        """Of a slab."""
        rows = waves(self.lines, self.sampling_rate, begin, begin + len(v)).T.to(v)
        scaled = v if self.scale is None else v * self.scale.to(v)
        return torch.addmm(scaled, rows, self.taken.to(v), alpha=-1)

    def of_columns(self, part: slice) -> Drive:
        """Of some probes."""
        scale = None if self.scale is None else self.scale[part]
        return dataclasses.replace(self, taken=self.taken[:, part], scale=scale)

    def survey(self, of_v: Survey, place: list[int] | None = None) -> Survey:
        """Of v*, from that of v; |v*| is a bound. With the lines at these places alone the squares are nan."""
        rows = of_v.rows_of_harmonics()
        scale = torch.ones_like(self.taken[0]) if self.scale is None else self.scale
        gram, kept, squares = of_v.gram[:, :, rows], of_v, torch.full_like(of_v.squares, torch.nan)
        if place is None:
            squares = scale**2 * of_v.squares
            for row, taken in zip(rows, self.taken, strict=True):  # one after another, in little memory
                change = torch.addcmul(gram[:, row] @ self.taken, of_v.sums[:, row], scale, value=-2)
                squares.addcmul_(taken, change)
        else:
            gram, kept = gram[:, of_v.rows_of(place)], of_v.of_lines(place)
        count = len(self.lines)
        largest = self.taken[0].abs() + torch.hypot(self.taken[1 : 1 + count], self.taken[1 + count :]).sum(0)
        sums = scale * kept.sums - gram @ self.taken
        return kept.select(sums, squares.clamp(min=0), scale * of_v.peaks + largest)


def phase_locked(seen: Survey, cells: Membership, background_rms: float | None = None) -> PhaseLocked:
    """The drive ``phase-locked`` from a survey of the whole record.

    Args:
        seen: of the probes; probes of no cell keep their own velocity.
        cells: of the probes.
        background_rms: rms of the turbulence without the sound, m/s: the incoherent velocity of each cell is brought
            down to it, never up.
    """
    rows = seen.rows_of_harmonics()
    count, harmonics = len(seen.sums), seen.harmonics
    gram = _gram_of_fit(seen)
    whole, each = _fit(gram.sum(0)).to(seen.sums), _fit(gram).to(seen.sums)
    fit = whole @ seen.sums.sum(0)[rows]
    # What deviates from the cell, 0 outside of cells.
    away = fit * (cells.labels < cells.count) - cells.spread(cells.mean(fit))

    def deviation(block: int) -> Tensor:
        """The same of one block, by cell, (R, C, M)."""
        members = cells.members(each[block] @ seen.sums[block, rows])
        return members - (members.sum(-1) / cells.sizes)[..., None]

    def by_line(rows: Tensor) -> Tensor:
        """Sums over cosine and sine of each line: (1 + 2 H, C) to (1 + H, C)."""
        return torch.cat([rows[:1], rows[1 : 1 + harmonics] + rows[1 + harmonics :]])

    known = count >= FEWEST_BLOCKS
    share = torch.ones(1 + harmonics, cells.count).to(fit)
    if known:
        blocks = _Scatter.of(map(deviation, range(count)))
        parts = ((part * cells.inside).sum(-1) for part in (blocks.power, blocks.neighbours))
        variance, neighbours = (by_line(part) for part in parts)
        rho = correlation(variance, neighbours, count)
        noise = variance / count / (count - 1) * (1 + rho) / (1 - rho)
        power = by_line(cells.sum(away.square()))
        share = (1 - noise / power.clamp(min=1e-300)).clamp(min=0)
    taken = cells.spread(torch.cat([share, share[1:]])) * away
    lines = seen.lines[:harmonics].to(fit.device)
    drive = PhaseLocked(lines, seen.blocks.sampling_rate, taken, None, share, known)
    return drive if background_rms is None else _with_background(drive, seen, fit, away, cells, background_rms)


def _gram_of_fit(seen: Survey) -> Tensor:
    """Of 1 and the harmonics in each block, (S, R, R), made again on the host: nothing is read back."""
    rows = seen.rows_of_harmonics()
    return gram_of(seen.blocks, seen.lines)[:, rows][:, :, rows]


def _fit(gram: Tensor) -> Tensor:
    """Pseudo-inverse that turns sums of v into coefficients, (..., R, R)."""
    return torch.linalg.pinv(gram, hermitian=True, rtol=1e-9)


@dataclass(frozen=True, eq=False)
class _Scatter:
    """Sums over blocks of the squares of what deviates from their mean, and of products of neighbours."""

    power: Tensor
    neighbours: Tensor

    @classmethod
    def of(cls, blocks: Iterable[Tensor]) -> _Scatter:
        """One block after another, so that they are never held together."""
        total = squares = cross = first = last = torch.zeros(())
        count = 0
        for block in blocks:
            if count == 0:
                first, total, squares, cross = block, block.clone(), block.square(), torch.zeros_like(block)
            else:
                total, squares = total + block, torch.addcmul(squares, block, block)
                cross = torch.addcmul(cross, block, last)
            last = block
            count += 1
        mean = total / count
        power = (squares - count * mean**2).clamp(min=0)
        return cls(power, cross + mean * (first + last - (count + 1) * mean))


def _with_background(
    drive: PhaseLocked, seen: Survey, fit: Tensor, away: Tensor, cells: Membership, rms: float
) -> PhaseLocked:
    """v* = v - g d - (1 - s)(v - v'), v' = v_p - (1 - g) d: what a fit keeps of the turbulence is scaled with it."""
    rows = seen.rows_of_harmonics()
    coherent = (fit * seen.sums.sum(0)[rows]).sum(0) / seen.lengths.sum()
    incoherent = (seen.mean_square - coherent).clamp(min=0)
    of_cell = cells.spread(cells.mean(incoherent))
    inside = cells.labels < cells.count
    own = torch.where(inside, of_cell, incoherent)
    scale = (rms / own.sqrt().clamp(min=1e-300)).clamp(max=1)
    return dataclasses.replace(drive, scale=scale, taken=drive.taken - (1 - scale) * (fit - away + drive.taken))


def tone_variances(drive: PhaseLocked, seen: Survey, cells: Membership) -> tuple[Tensor, Tensor, Tensor]:
    """Mean of v, m/s, variance of what is periodic with the tone, and of the rest of v*, m2/s2, over all cells, 0-d."""
    rows, samples = seen.rows_of_harmonics(), seen.lengths.sum()
    gram, sums = _gram_of_fit(seen).sum(0), seen.sums.sum(0)[rows]
    fit = _fit(gram).to(sums) @ sums
    gram = gram.to(sums)
    of_cells = cells.mean(fit)
    periodic = (of_cells * (gram @ of_cells)).sum(0) / samples - of_cells[0] ** 2
    scale = 1.0 if drive.scale is None else drive.scale**2
    rest = (seen.mean_square - (fit * sums).sum(0) / samples).clamp(min=0) * scale
    return of_cells[0].mean(), periodic.clamp(min=0).mean(), cells.mean(rest).mul(cells.sizes).sum() / cells.sizes.sum()
