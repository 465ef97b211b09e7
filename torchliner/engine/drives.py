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
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.engine.blocks import waves
from torchliner.engine.intervals import correlation
from torchliner.engine.survey import Membership, Survey, gram_of

FEWEST_BLOCKS = 3  # from which the scatter of a fit can be known
NOTHING = torch.empty(0, dtype=torch.float64)


@dataclass(frozen=True, eq=False)
class Drive:
    """v, or its mean over each cell, times ``scale`` less ``waves(lines).T @ taken``; or the running rms of that.

    ``Drive()`` is averaging ``admittance``, the paper's, ``Drive(cells)`` is ``velocity``.

    Args:
        cells: whose means are the columns; None: the probes are.
        taken: coefficients of 1, cos and sin of the lines, m/s, (1 + 2 H, N); None takes nothing off.
        lines: Hz, of the harmonics, (H,), on the device of ``taken``; none for the mean alone.
        sampling_rate: Hz.
        scale: s, (N,); None for 1.
        share: g of the mean and of each harmonic, by cell, (1 + H, C), from which ``taken`` follows; for the record.
        window: samples of the running rms, centred on each sample and cut at the ends of the record; 0: none.
        samples: of the record, for the running rms.
    """

    cells: Membership | None = None
    taken: Tensor | None = None
    lines: Tensor = NOTHING
    sampling_rate: float = 1.0
    scale: Tensor | None = None
    share: Tensor = NOTHING
    window: int = 0
    samples: int = 0

    @property
    def reach(self) -> int:
        """Samples before and after a slab that it needs, but at the ends of the record."""
        return self.window // 2 + 1 if self.window else 0

    def __call__(self, v: Tensor, begin: int) -> Tensor:
        """Columns (t, N) of a slab (t, P) that begins with this sample of the record."""
        found = v if self.cells is None else self.cells.mean(v)
        if self.scale is not None:
            found = found * self.scale.to(v)
        if self.taken is not None:
            lines = self.lines if len(self.lines) else self.taken.new_empty(0)
            rows = waves(lines, self.sampling_rate, begin, begin + len(v)).T.to(v)
            found = torch.addmm(found, rows, self.taken.to(v), alpha=-1)
        return self._running(found, begin) if self.window else found

    def less(self, mean: Tensor) -> Drive:
        """The same less a mean over the record, m/s, (N,)."""
        taken = mean[None] if self.taken is None else torch.cat([self.taken[:1] + mean, self.taken[1:]])
        return dataclasses.replace(self, taken=taken)

    def _running(self, found: Tensor, begin: int) -> Tensor:
        running = torch.nn.functional.pad(found.double().square().cumsum(0), (0, 0, 1, 0))
        step = torch.arange(begin, begin + len(found), device=found.device) - self.window // 2
        first = (step.clamp(min=0) - begin).clamp(min=0)
        after = ((step + self.window).clamp(max=self.samples) - begin).clamp(max=len(found))
        mean = (running[after] - running[first]) / (after - first)[:, None]
        return mean.clamp(min=0).sqrt().to(found.dtype)


def phase_locked(seen: Survey, cells: Membership, scale: Tensor | None = None) -> Drive:
    """The drive ``phase-locked`` from a survey of the whole record.

    Args:
        seen: of the probes; probes of no cell keep their own velocity.
        cells: of the probes.
        scale: s, of the incoherent velocity of each probe, (P,); default 1.
    """
    fit, away, share = _coherent(seen, cells)
    taken = cells.spread(torch.cat([share, share[1:]])) * away
    lines = seen.lines[: seen.harmonics].to(fit.device)
    if scale is not None:  # v* = v - g d - (1 - s)(v - v'), v' = v_p - (1 - g) d: the turbulence in a fit is scaled too
        taken = taken - (1 - scale) * (fit - away + taken)
    return Drive(None, taken, lines, seen.blocks.sampling_rate, scale, share)


def _coherent(seen: Survey, cells: Membership) -> tuple[Tensor, Tensor, Tensor]:
    """Mean and harmonics of each probe, what of them deviates from its cell, (1 + 2 H, P), and of that the share g that
    is no turbulence, by cell, (1 + H, C); 1 where there are too few blocks to tell."""
    rows = seen.rows_of_harmonics()
    count, harmonics = len(seen.sums), seen.harmonics
    gram = _gram_of_fit(seen)
    whole, each = _fit(gram.sum(0)).to(seen.sums), _fit(gram).to(seen.sums)
    fit = whole @ seen.sums.sum(0)[rows]
    # What deviates from the cell, 0 outside of cells.
    away = fit * (cells.labels < cells.count) - cells.spread(cells.mean(fit))

    def by_line(rows: Tensor) -> Tensor:
        """Sums over cosine and sine of each line: (1 + 2 H, C) to (1 + H, C)."""
        return torch.cat([rows[:1], rows[1 : 1 + harmonics] + rows[1 + harmonics :]])

    share = torch.ones(1 + harmonics, cells.count).to(fit)
    if count >= FEWEST_BLOCKS:
        variance, neighbours = (by_line(part) for part in _scatter(seen, cells, each, rows))
        rho = correlation(variance, neighbours, count)
        noise = variance / count / (count - 1) * (1 + rho) / (1 - rho)
        power = by_line(cells.sum(away.square()))
        share = (1 - noise / power.clamp(min=1e-300)).clamp(min=0)
    return fit, away, share


def incoherent_power(seen: Survey, cells: Membership) -> Tensor:
    """Sums over each block of the square of v - v', all that is not in step with the tone, m2/s2, (S, P).

    What a fit over N periods keeps of the turbulence, 1/N of it, belongs to it, as in the drive.
    """
    rows, gram = seen.rows_of_harmonics(), _gram_of_fit(seen).to(seen.sums)
    fit, away, share = _coherent(seen, cells)
    kept = fit - (1 - cells.spread(torch.cat([share, share[1:]]))) * away
    return (seen.squares + ((gram @ kept - 2 * seen.sums[:, rows]) * kept).sum(1)).clamp(min=0)


def incoherent_square(seen: Survey, cells: Membership) -> Tensor:
    """Its mean over the record, and over the cell where a probe has one, m2/s2, (P,)."""
    own = incoherent_power(seen, cells).sum(0) / seen.lengths.sum()
    return torch.where(cells.labels < cells.count, cells.spread(cells.mean(own)), own)


def _gram_of_fit(seen: Survey) -> Tensor:
    """Of 1 and the harmonics in each block, (S, R, R), made again on the host: nothing is read back."""
    rows = seen.rows_of_harmonics()
    return gram_of(seen.blocks, seen.lines)[:, rows][:, :, rows]


def _fit(gram: Tensor) -> Tensor:
    """Pseudo-inverse that turns sums of v into coefficients, (..., R, R)."""
    return torch.linalg.pinv(gram, hermitian=True, rtol=1e-9)


def _scatter(seen: Survey, cells: Membership, fits: Tensor, rows: list[int]) -> tuple[Tensor, Tensor]:
    """Sums over blocks and the probes of each cell, (R, C), of the squares of what deviates in a block from the cell,
    less its mean over the blocks, and of products of neighbours; one block after another, never held together."""
    count = len(fits)
    total = squares = cross = first = last = torch.zeros(())
    for block in range(count):
        members = cells.members(fits[block] @ seen.sums[block, rows])
        now = members - (members.sum(-1) / cells.sizes)[..., None]
        if block == 0:
            first, total, squares, cross = now, now.clone(), now.square(), torch.zeros_like(now)
        else:
            total, squares = total + now, torch.addcmul(squares, now, now)
            cross = torch.addcmul(cross, now, last)
        last = now
    mean = total / count
    power = (squares - count * mean**2).clamp(min=0)
    neighbours = cross + mean * (first + last - (count + 1) * mean)
    return (power * cells.inside).sum(-1), (neighbours * cells.inside).sum(-1)


def survey_of_locked(drive: Drive, of_v: Survey) -> Survey:
    """Survey of v*, from that of v; |v*| is a bound."""
    assert drive.taken is not None
    rows, count = of_v.rows_of_harmonics(), of_v.harmonics
    scale = torch.ones_like(drive.taken[0]) if drive.scale is None else drive.scale
    gram, squares = of_v.gram[:, :, rows], scale**2 * of_v.squares
    for row, taken in zip(rows, drive.taken, strict=True):  # one after another, in little memory
        change = torch.addcmul(gram[:, row] @ drive.taken, of_v.sums[:, row], scale, value=-2)
        squares.addcmul_(taken, change)
    largest = drive.taken[0].abs() + torch.hypot(drive.taken[1 : 1 + count], drive.taken[1 + count :]).sum(0)
    return dataclasses.replace(
        of_v,
        sums=scale * of_v.sums - gram @ drive.taken,
        squares=squares.clamp(min=0),
        peaks=scale * of_v.peaks + largest,
    )


def tone_variances(drive: Drive, seen: Survey, cells: Membership) -> tuple[Tensor, Tensor, Tensor]:
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
