r"""Averagings, and what else may act on the liner, as drives: functions of a slab that give the columns whose |v| acts.

Sound passes the holes of a whole cell; turbulence acts where it is. So ``phase-locked`` averaging drives a probe with

.. math:: v^*(x, t) = \langle v_p \rangle_\text{cell}(t) + [v(x, t) - v_p(x, t)] = v(x, t) - d(x, t),

where :math:`v_p` are the mean and the first harmonics of the tone, fitted over the record. A fit over N periods keeps
1/N of the turbulence. So each harmonic of a cell is taken off only by the share g = 1 - (variance of its mean over the
blocks)/(mean square of d), at least 0, which makes the error least. Without turbulence g = 1 and v* is the velocity
averaged over the cell; without sound d is noise, g is near 0 and v* is v.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.engine.blocks import waves
from torchliner.engine.intervals import correlation
from torchliner.engine.survey import Membership, Survey

FEWEST_BLOCKS = 3  # from which the scatter of a fit can be known
NOTHING = torch.empty(0, dtype=torch.float64)


@dataclass(frozen=True, eq=False)
class Drive:
    """v, or its mean over each cell, times ``scale`` less ``waves(lines).T @ taken``; or the running rms of that.

    ``Drive()`` is averaging ``admittance``, the paper's, ``Drive(cells)`` is ``velocity``.
    """

    cells: Membership | None = None  # whose means are the columns; None: the probes are
    taken: Tensor | None = None  # coefficients of 1, cos and sin of the lines, m/s, (1 + 2 H, N)
    lines: Tensor = NOTHING  # Hz, of the harmonics, (H,), on the device of ``taken``; none for the mean alone
    sampling_rate: float = 1.0
    scale: Tensor | None = None  # s, (N,); None for 1
    share: Tensor = NOTHING  # g of the mean and of each harmonic, by cell, (1 + H, C), from which ``taken`` follows
    window: int = 0  # samples of the running rms, centred on each sample and cut at the ends of the record; 0: none
    samples: int = 0  # of the record, for the running rms

    def __call__(self, v: Tensor, begin: int) -> Tensor:
        """Columns (t, N) of a slab (t, P) that begins with this sample of the record."""
        found = v if self.cells is None else self.cells.mean(v)
        if self.scale is not None:
            found = found * self.scale.to(v)
        if self.taken is not None:
            rows = waves(self.lines.to(self.taken.device), self.sampling_rate, begin, begin + len(v)).T.to(v)
            found = torch.addmm(found, rows, self.taken.to(v), alpha=-1)
        if not self.window:
            return found
        running = torch.nn.functional.pad(found.double().square().cumsum(0), (0, 0, 1, 0))
        step = torch.arange(begin, begin + len(found), device=found.device) - self.window // 2
        first = (step.clamp(min=0) - begin).clamp(min=0)
        after = ((step + self.window).clamp(max=self.samples) - begin).clamp(max=len(found))
        mean = (running[after] - running[first]) / (after - first)[:, None]
        return mean.clamp(min=0).sqrt().to(found.dtype)

    def less(self, mean: Tensor) -> Drive:
        """The same less a mean over the record, m/s, (N,)."""
        taken = mean[None] if self.taken is None else torch.cat([self.taken[:1] + mean, self.taken[1:]])
        return dataclasses.replace(self, taken=taken)


def phase_locked(seen: Survey, cells: Membership, scale: Tensor | None = None) -> Drive:
    """The drive ``phase-locked`` from a survey of the whole record, with the incoherent velocity of each probe times
    ``scale``, (P,); probes of no cell keep their own velocity."""
    fit, away, share = _periodic(seen, cells)
    taken = cells.spread(torch.cat([share, share[1:]])) * away
    lines = seen.lines[: seen.harmonics].to(fit.device)
    if scale is not None:  # v* = v - g d - (1 - s)(v - v'), v' = v_p - (1 - g) d: the turbulence in a fit is scaled too
        taken = taken - (1 - scale) * (fit - away + taken)
    return Drive(None, taken, lines, seen.blocks.sampling_rate, scale, share)


def _periodic(seen: Survey, cells: Membership) -> tuple[Tensor, Tensor, Tensor]:
    """v_p and d of each probe, (1 + 2 H, P), and the share g by cell, (1 + H, C); 1 with too few blocks to tell."""
    rows, count, harmonics = seen.rows, len(seen.sums), seen.harmonics
    gram = seen.gram[:, rows][:, :, rows]
    whole, *each = torch.linalg.pinv(torch.cat([gram.sum(0)[None], gram]), hermitian=True, rtol=1e-9).to(seen.sums)
    fit = whole @ seen.sums.sum(0)[rows]
    inside = cells.labels < cells.count  # d is 0 at probes of no cell
    periodic = fit * inside - cells.spread(cells.mean(fit))
    if count < FEWEST_BLOCKS:
        return fit, periodic, fit.new_ones(1 + harmonics, cells.count)
    first = before = total = squares = products = torch.zeros_like(fit)
    for block in range(count):  # one after another, never held together
        now = each[block] @ seen.sums[block, rows]
        now = now * inside - cells.spread(cells.mean(now))
        first = first if block else now
        total, squares, products = total + now, torch.addcmul(squares, now, now), torch.addcmul(products, now, before)
        before = now
    mean = total / count  # of which blocks are to deviate
    squares, products = squares - count * mean**2, products + mean * (first + before - (count + 1) * mean)
    found = cells.mean(torch.stack([squares.clamp(min=0), products, periodic.square()]))  # (3, 1 + 2 H, C)
    # Cosine and sine of each line together.
    variance, products, power = torch.cat(
        [found[:, :1], found[:, 1 : 1 + harmonics] + found[:, 1 + harmonics :]], 1
    ).unbind()
    rho = correlation(variance, products, count)
    noise = variance / count / (count - 1) * (1 + rho) / (1 - rho)
    return fit, periodic, (1 - noise / power.clamp(min=1e-300)).clamp(min=0)


def incoherent_square(seen: Survey, cells: Membership) -> Tensor:
    """Mean square of all that is not in step with the tone, what a fit keeps of the turbulence included, as in the
    drive; over the cell where a probe has one, m2/s2, (P,)."""
    rows = seen.rows
    fit, away, share = _periodic(seen, cells)
    kept = fit - (1 - cells.spread(torch.cat([share, share[1:]]))) * away
    gram = seen.gram[:, rows][:, :, rows].to(kept)
    power = (seen.squares + ((gram @ kept - 2 * seen.sums[:, rows]) * kept).sum(1)).clamp(min=0)
    own = power.sum(0) / seen.lengths.sum()
    return torch.where(cells.labels < cells.count, cells.spread(cells.mean(own)), own)


def survey_of_locked(drive: Drive, of_v: Survey) -> Survey:
    """Survey of v*, from that of v; |v*| is a bound."""
    assert drive.taken is not None
    rows, count = of_v.rows, of_v.harmonics
    scale = torch.ones_like(drive.taken[0]) if drive.scale is None else drive.scale
    gram, squares = of_v.gram[:, :, rows].to(scale), scale**2 * of_v.squares
    for row, taken in zip(rows, drive.taken, strict=True):  # one after another, in little memory
        change = torch.addcmul(gram[:, row] @ drive.taken, of_v.sums[:, row], scale, value=-2)
        squares.addcmul_(taken, change)
    largest = drive.taken[0].abs() + torch.hypot(drive.taken[1 : 1 + count], drive.taken[1 + count :]).sum(0)
    sums, peaks = scale * of_v.sums - gram @ drive.taken, scale * of_v.peaks + largest
    return dataclasses.replace(of_v, sums=sums, squares=squares.clamp(min=0), peaks=peaks)
