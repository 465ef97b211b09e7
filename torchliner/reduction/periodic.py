r"""The part of v that is periodic with the tone, and how it deviates from that of its cell.

Sound passes the holes of a whole cell, turbulence acts where it is. So a probe is driven by

    v*(x, t) = <v_per>_cell(t) + [v(x, t) - v_per(x, t)] = v(x, t) - d(x, t),

where v_per are the mean and the first harmonics of the tone, fitted over the whole record, and d =
v_per - <v_per>_cell is all that has to be taken off: the turbulence of the cell's mean never
matters, and that of a probe enters d alone. Of N periods a fit keeps 1/N of the turbulence. How
much of d is that is known from how it scatters from block to block, and each harmonic of a cell is
taken off by the share

    g = 1 - (variance of the mean of the blocks)/(mean square of d), at least 0,

over the cell's probes, the least mean square error of an estimate with such noise. (That variance
is the blocks' over S - 1, times (1 + rho)/(1 - rho) where neighbours correlate by rho.) Without
turbulence g = 1 and v* is the velocity averaged over the cell; without sound d is noise, g is next
to 0 and v* is v.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.compiled.threads import one_thread
from torchliner.records.cells import Cells
from torchliner.records.slabs import bounds_of
from torchliner.signals.bootstrap import correlation_of
from torchliner.signals.tones import BLOCK, waves

HARMONICS = 8
MOST_TONES = 3  # whose harmonics make up the periodic part
APART = 1e-6  # relative: closer lines are one
FEWEST_BLOCKS = 3  # for how the fit scatters
BEATS = 2.0  # of the closest two lines in a block
SLACK_SAMPLES = 1.0  # blocks of whole periods are rounded to samples


@dataclass(frozen=True)
class Harmonics:
    """Rows 1, cos and sin of the lines of a periodic velocity.

    Args:
        lines: Hz, (H,).
        sampling_rate: Hz.
    """

    lines: Tensor
    sampling_rate: float

    @classmethod
    def of(cls, tones: Sequence[float], sampling_rate: float) -> Harmonics:
        """The first ``HARMONICS`` of each tone (Hz), below half the sampling rate."""
        found: list[float] = []
        for line in sorted(tone * h for tone in tones for h in range(1, HARMONICS + 1)):
            distinct = not found or line > found[-1] * (1 + APART)
            if distinct and line < 0.5 * sampling_rate * (1 - APART):
                found.append(line)
        return cls(torch.tensor(found, dtype=torch.float64), sampling_rate)

    def rows(self, begin: int, end: int) -> Tensor:
        """At samples begin .. end - 1, float64, (K, t), K = 1 + 2 H."""
        turning = waves(self.lines, self.sampling_rate, begin, end)
        one = torch.ones(1, end - begin, dtype=torch.float64)
        return torch.cat([one, turning.real, -turning.imag])

    @property
    def owner(self) -> Tensor:
        """Which line each row belongs to, 0 for the mean, (K,)."""
        lines = torch.arange(1, len(self.lines) + 1)
        return torch.cat([torch.zeros(1, dtype=torch.int64), lines, lines])

    @property
    def period(self) -> float:
        """Samples after which all lines can be told apart, BEATS of the closest if several."""
        if len(self.lines) == 0:
            return 1.0
        gaps = torch.cat([self.lines[:1], self.lines.diff()])
        lowest, closest = float(self.lines[0]), float(gaps.min())
        single = closest > lowest * (1 - APART)
        return self.sampling_rate / lowest if single else BEATS * self.sampling_rate / closest


@dataclass(frozen=True)
class PeriodicPart:
    """What makes v* of v, by probe.

    Args:
        harmonics: the rows.
        fit: coefficients of v_per, m/s, (K, P).
        deviation: coefficients of what is taken off, g d, m/s, (K, P).
        share: g by line (the mean first) and cell, (1 + H, C).
        has_shares: whether the record is long enough to tell them; else they are 1.
        scale: factor of v before that, (P,); 1 unless the incoherent part is to be smaller.
        sums: of v times the rows, m/s, (K, P).
        gram: sums of products of the rows, (K, K).
    """

    harmonics: Harmonics
    fit: Tensor
    deviation: Tensor
    share: Tensor
    has_shares: bool
    scale: Tensor
    sums: Tensor
    gram: Tensor

    @property
    def samples(self) -> float:
        """n."""
        return float(self.gram[0, 0])

    def with_oncoming(self, rms: float, mean_square: Tensor, cells: Cells) -> PeriodicPart:
        """The same with the incoherent velocity of each cell brought down to a known rms.

        v* = v - g d - (1 - s)(v - v'), s the ratio of ``rms`` to that over the cell's probes, and
        v' = v_per - (1 - g) d its coherent part: what the fit keeps of the turbulence goes with it.

        Args:
            rms: of the turbulence that comes to the liner without the sound, m/s.
            mean_square: of v, m2/s2, (P,).
            cells: of the probes.
        """
        coherent = (self.fit * self.sums).sum(0) / self.samples
        incoherent = (mean_square - coherent).clamp(min=0)
        labels = cells.labels.to(incoherent.device)
        of_cells = cells.average(incoherent, cells.labels >= 0, 0)
        own = torch.where(labels >= 0, of_cells[labels.clamp(min=0)], incoherent)
        scale = (rms / own.sqrt().clamp(min=1e-300)).clamp(max=1)
        mean = cells.average(self.fit.T, cells.labels >= 0, 0).T
        away = torch.where(labels >= 0, self.fit - mean[:, labels.clamp(min=0)], 0)
        kept = self.fit - away + self.deviation
        return dataclasses.replace(self, scale=scale, deviation=self.deviation - (1 - scale) * kept)

    @property
    def mean(self) -> Tensor:
        """Of what is taken off over the record, m/s, (P,)."""
        return self.gram[0] @ self.deviation / self.samples

    def mean_square(self, of_velocity: Tensor) -> Tensor:
        """Of v*, m2/s2, (P,), from that of v."""
        own = (self.deviation * (self.gram @ self.deviation)).sum(0)
        both = (self.deviation * self.sums).sum(0)
        return self.scale**2 * of_velocity + (own - 2 * self.scale * both) / self.samples

    @property
    def largest(self) -> Tensor:
        """Bound of what is taken off, m/s, (P,)."""
        count = len(self.harmonics.lines)
        cosine, sine = self.deviation[1:].split(count) if count else (self.deviation[1:],) * 2
        return self.deviation[0].abs() + torch.hypot(cosine, sine).sum(0)


class PeriodicSums:
    """Of one group of columns, from the sums of v times the rows over blocks, in order of time."""

    def __init__(self, harmonics: Harmonics, width: int, device: torch.device) -> None:
        self.harmonics = harmonics
        rows = len(harmonics.owner)
        zeros = torch.zeros(rows, width, dtype=torch.float64, device=device)
        self.current, self.total = zeros, zeros.clone()
        # Coefficients of all blocks, their squares, their products with those of the block before;
        # those of the first block and of the last.
        self.fitted, self.squares, self.cross = zeros.clone(), zeros.clone(), zeros.clone()
        self.first = self.last = zeros.clone()
        self.gram = torch.zeros(rows, rows, dtype=torch.float64)
        self.current_gram = self.gram.clone()
        self.blocks = 0

    @one_thread()
    def add(self, low: int, high: int, sums: Tensor) -> None:
        """Those of samples ``low`` .. ``high`` - 1, (K, P); a block is as long as tells all lines
        apart."""
        for begin, end in bounds_of(high - low, BLOCK):
            rows = self.harmonics.rows(low + begin, low + end)
            self.current_gram += rows @ rows.T
        self.current += sums
        if float(self.current_gram[0, 0]) >= self.harmonics.period - SLACK_SAMPLES:
            found = solved(self.current_gram, self.current)
            self.fitted += found
            self.squares.addcmul_(found, found)
            self.cross.addcmul_(found, self.last)
            self.first, self.last = self.first if self.blocks else found, found
            self.blocks += 1
            self._close()

    def _close(self) -> None:
        self.total += self.current
        self.gram += self.current_gram
        self.current.zero_()
        self.current_gram.zero_()

    def finish(self) -> None:
        """After the last sample."""
        self._close()

    @property
    def neighbours(self) -> Tensor:
        """Sum over the blocks of the product with the next one, less their mean, (K, P)."""
        mean = self.fitted / self.blocks
        return self.cross + mean * (self.first + self.last - (self.blocks + 1) * mean)


def solved(gram: Tensor, sums: Tensor) -> Tensor:
    """Coefficients of a fit, (K, P)."""
    inverse = torch.linalg.pinv(gram / gram[0, 0], hermitian=True, rtol=1e-9) / gram[0, 0]
    return inverse.to(sums.device) @ sums


@one_thread()
def periodic_part(probes: PeriodicSums, of_cells: PeriodicSums, cells: Cells, used: Tensor) -> PeriodicPart:
    """What has to be taken off each probe.

    Args:
        probes, of_cells: sums of v, and of its averages over cells.
        cells: of the probes; those of no cell keep their own velocity.
        used: probes without faults, (P,).
    """
    device = probes.total.device
    inside = ((cells.labels >= 0) & used).to(device)
    labels = torch.where(inside, cells.labels.to(device), 0)
    fit, mean = (solved(probes.gram, each.total) for each in (probes, of_cells))
    away = torch.where(inside, fit - mean[:, labels], 0)
    share = _shares(probes, of_cells, (fit, mean), labels, inside)
    owner = probes.harmonics.owner.to(device)
    return PeriodicPart(
        probes.harmonics, fit, share[owner][:, labels] * away, share,
        probes.blocks >= FEWEST_BLOCKS, torch.ones_like(fit[0]), probes.total,
        probes.gram.to(device),
    )  # fmt: skip


def _shares(
    probes: PeriodicSums, of_cells: PeriodicSums, fits: tuple[Tensor, Tensor], labels: Tensor,
    inside: Tensor,
) -> Tensor:  # fmt: skip
    """g, (1 + H, C); 1 where there are too few blocks to know better.

    Over the probes of a cell the squares of what deviates from its mean are those of the probes
    less those of the mean, so that no block has to be looked at twice.
    """
    fit, mean = fits
    owner, count = probes.harmonics.owner.to(labels.device), mean.shape[1]
    lines, blocks = int(owner.max()) + 1, probes.blocks
    if blocks < FEWEST_BLOCKS:
        return probes.total.new_ones(lines, count)
    sizes = torch.bincount(labels[inside], minlength=count)

    def over_cells(of_probes: Tensor, of_means: Tensor) -> Tensor:
        """Sums over the probes of each cell, and over the rows of a line, (1 + H, C)."""
        own = of_probes.T[inside]
        total = own.new_zeros(count, len(owner)).index_add_(0, labels[inside], own)
        rows = total.T - sizes * of_means
        return rows.new_zeros(lines, count).index_add_(0, owner, rows)

    square = over_cells(probes.squares, of_cells.squares).clamp(min=0) / blocks
    means = over_cells((probes.fitted / blocks) ** 2, (of_cells.fitted / blocks) ** 2)
    variance = (square - means.clamp(min=0)).clamp(min=0)
    # Slow turbulence lasts from block to block, and scatters less than the mean of them varies.
    cross = over_cells(probes.neighbours, of_cells.neighbours)
    rho = correlation_of(torch.stack([blocks * variance, cross]), blocks)
    noise = variance / (blocks - 1) * (1 + rho) / (1 - rho)
    power = over_cells(fit**2, mean**2).clamp(min=1e-300)
    return (1 - noise / power).clamp(min=0)


def coherent_tones(tone: float | None, asked: Tensor) -> tuple[float, ...]:
    """Of which the periodic part is: the tone of the data (Hz), else the frequencies asked for,
    (F,), if they are few; else none, and the periodic part is the mean."""
    if tone is not None:
        return (tone,)
    return tuple(asked.tolist()) if len(asked) <= MOST_TONES else ()
