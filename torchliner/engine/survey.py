"""What is known of v itself, block by block, and which probes make up a cell."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import torch
from torch import Tensor

from torchliner.engine.blocks import Blocks
from torchliner.engine.intervals import replicates
from torchliner.records.cells import Cells

SAME = 1e-9  # relative: closer lines are one
HARMONICS = 8
STEADY = 1e-18  # of the mean square: less than rounding
ROUNDING = 1e-12  # of the mean square, in a variance


def lines_of(tone: float | None, sampling_rate: float, asked: Tensor | None = None) -> tuple[Tensor, int]:
    """Harmonics below half the sampling rate, then other frequencies asked for, Hz, (L,); number of harmonics."""
    lines = [] if tone is None else [tone * (1 + h) for h in range(HARMONICS)]
    lines = [line for line in lines if line < 0.5 * sampling_rate * (1 - 1e-6)]
    harmonics = len(lines)
    for f in [] if asked is None else asked.tolist():
        if all(abs(f / line - 1) > SAME for line in lines):
            lines.append(f)
    return torch.tensor(lines, dtype=torch.float64), harmonics


@dataclass(frozen=True, eq=False)
class Membership:
    """Probes by cell, for means over each of C cells, on the device of the work."""

    count: int  # C
    labels: Tensor  # cell of each probe, int64, (P,); C for probes of no cell
    places: Tensor  # probes of each cell side by side, padded with probe 0, int64, (C, M)
    inside: Tensor  # 0 at padding, else 1, (C, M)
    sizes: Tensor  # probes of each cell, float64, (C,)
    used: Tensor  # probes that count, bool, (P,)
    ordered: bool  # whether the probes already lie so in memory, all cells alike: no copy is needed

    @classmethod
    def of(cls, cells: Cells, used: Tensor, device: torch.device) -> Membership:
        """From cells that each hold a probe, and the probes that count, bool, (P,), on the host."""
        labels, count = cells.labels, len(cells.x)
        sizes = torch.bincount(labels[labels >= 0], minlength=count)
        most = int(sizes.max())
        order = torch.argsort(labels, stable=True)[int((labels < 0).sum()) :]
        places, inside = torch.zeros(count, most, dtype=torch.int64), torch.zeros(count, most, dtype=torch.float64)
        cell = labels[order]
        slot = torch.arange(len(order)) - (sizes.cumsum(0) - sizes)[cell]
        places[cell, slot], inside[cell, slot] = order, 1.0
        ordered = count * most == len(labels) and torch.equal(places.flatten(), torch.arange(count * most))
        outside = torch.where(labels < 0, count, labels)
        placed, sizes, used = (each.to(device) for each in (inside, sizes.double(), used))
        return cls(count, outside.to(device), places.to(device), placed, sizes, used, ordered)

    def mean(self, values: Tensor) -> Tensor:
        """Over the probes of each cell: (..., P) to (..., C)."""
        if self.ordered:
            return values.unflatten(-1, self.places.shape).mean(-1)
        members = values.index_select(-1, self.places.flatten()).unflatten(-1, self.places.shape)
        return members.mul_(self.inside.to(members)).sum(-1) / self.sizes.to(values)

    def spread(self, of_cells: Tensor) -> Tensor:
        """The value of its cell at each probe, 0 at probes of no cell: (..., C) to (..., P)."""
        return torch.nn.functional.pad(of_cells, (0, 1)).index_select(-1, self.labels)


@dataclass(frozen=True, eq=False)
class Survey:
    """Sums of v over S blocks of P columns, float64, and what follows from them over the record."""

    blocks: Blocks
    lines: Tensor  # Hz, (L,), on the host; the first ``harmonics`` of them, H, are those of the tone
    harmonics: int
    sums: Tensor  # of v times 1, cos and sin of the lines, m/s, (S, 1 + 2 L, P)
    squares: Tensor  # of v^2, m2/s2, (S, P)
    peaks: Tensor  # largest |v|, m/s, (S, P)
    # Of 1, cos and sin, (S, 1 + 2 L, 1 + 2 L), on the host.
    gram: Tensor = field(default_factory=lambda: torch.empty(0))
    waves: Tensor = field(init=False)  # sums of 1, cos and sin alone, on the device of the sums, (S, 1 + 2 L)
    lengths: Tensor = field(init=False)  # samples of each block, likewise, (S,)
    rows: list[int] = field(init=False)  # which of the 1 + 2 L rows are 1, cos and sin of the harmonics
    mean: Tensor = field(init=False)  # of v, m/s, (P,)
    mean_square: Tensor = field(init=False)  # m2/s2, (P,)
    rms: Tensor = field(init=False)  # of v with its mean removed, eq. (3.6), m/s, (P,)
    peak: Tensor = field(init=False)  # largest |v|, m/s, (P,)

    def __post_init__(self) -> None:
        gram = self.gram
        if not len(gram):  # in closed form, from sums of waves of the sums and differences of all lines
            lines = torch.cat([self.lines.new_zeros(1), self.lines])
            pairs = torch.stack([lines[:, None] - lines, lines[:, None] + lines])
            minus, plus = self.blocks.wave_sums(pairs.flatten()).unflatten(1, pairs.shape).unbind(1)
            cosines, sines = (minus.real + plus.real) / 2, (minus.real - plus.real) / 2
            mixed = (minus.imag - plus.imag)[:, :, 1:] / 2  # of cos (row) times sin (column)
            gram = torch.cat([torch.cat([cosines, mixed], 2), torch.cat([mixed.mT, sines[:, 1:, 1:]], 2)], 1)
        cosines, waves = range(1, 1 + self.harmonics), gram[:, 0].to(self.sums.device)
        lengths = waves[:, 0]
        mean, square = (each.sum(0) / lengths.sum() for each in (self.sums[:, 0], self.squares))
        self.__dict__.update(
            gram=gram,
            waves=waves,
            lengths=lengths,
            rows=[0, *cosines, *(row + len(self.lines) for row in cosines)],
            mean=mean,
            mean_square=square,
            rms=(square - mean**2).clamp(min=0).sqrt(),
            peak=self.peaks.amax(0),
        )

    @property
    def constant(self) -> Tensor:
        """Where v does not change, but for rounding, bool, (P,)."""
        return self.mean_square - self.mean**2 <= ROUNDING * self.mean_square

    def line_sums(self, frequency: Tensor, columns: slice = slice(None)) -> tuple[Tensor, Tensor]:
        """Sums of v e^{-j omega t}, complex128, (S, n, F), nan where not measured, and of e^{-j omega t}, (S, F)."""
        near = (self.lines[:, None] / frequency - 1).abs() < SAME * 10
        measured, place = near.any(0), near.int().argmax(0).tolist() if len(near) else [-1] * len(frequency)
        cosine, sine = [1 + i for i in place], [1 + len(self.lines) + i for i in place]
        part = self.sums[:, :, columns]
        of_v = torch.complex(part[:, cosine], -part[:, sine]).transpose(1, 2)
        if not bool(measured.all()):
            of_v = of_v * torch.where(measured, 1.0, torch.nan).to(part)
        return of_v, torch.complex(self.waves[:, cosine], -self.waves[:, sine])

    def coherence(self, frequency: Tensor, cells: Membership | None = None) -> Tensor:
        """Squared coherence of v with a steady tone, 0 to 1, (P, F); nan where not measured, or where a steady velocity
        has no line. With ``cells`` of the velocity averaged over each, power added, (F,): a single probe in turbulence
        hardly sees the sound that all holes of its cell pass."""
        of_v, of_one = self.line_sums(frequency)
        lines = (of_v - self.mean[:, None] * of_one[:, None]) / self.lengths[:, None, None]
        if cells is not None:
            lines = cells.mean(lines.transpose(1, 2))  # (S, F, C)
        power, coherent = lines.abs().square().mean(0), lines.mean(0).abs().square()
        if cells is None:
            return torch.where(power == 0, 0.0, coherent / power.clamp(min=1e-300))
        power, least = power.sum(-1), STEADY * self.mean_square.mean() * cells.count
        return torch.where(power <= least, torch.nan, coherent.sum(-1) / power.clamp(min=1e-300))

    def tone(self, frequency: Tensor, *, every: bool = False, columns: slice = slice(None)) -> Tensor:
        """Complex peak amplitude of v as stored at f, m/s, (B, n, F), its mean taken off: of the record, B = 1, or with
        ``every`` as ``intervals.replicates``."""
        of_v, of_one = self.line_sums(frequency, columns)
        means = partial(replicates, lengths=self.lengths, every=every)
        return 2 * (means(of_v) - means(self.sums[:, 0, columns])[..., None] * means(of_one)[:, None])


def coherence_by_chance(blocks: float, chance: float) -> float:
    """Squared coherence c that noise exceeds in this share of records of S independent blocks: (1 - c)^(S - 1)."""
    return 1 - chance ** (1 / (blocks - 1))


def survey_sums(weights: Tensor, columns: Tensor) -> Tensor:
    """Measure: sums of w v, then of w v^2 with the first row's w, then the largest |v|: (G, R + 2, 1, N)."""
    squares = weights[:, :1] @ columns.square()
    return torch.cat([weights @ columns, squares, columns.abs().amax(1, keepdim=True)], 1)[:, :, None]


def survey_of(found: Tensor, blocks: Blocks, lines: Tensor, harmonics: int) -> Survey:
    """From what a job with ``survey_sums`` and ``largest=1`` found in all S blocks; ``lines`` on the host."""
    return Survey(blocks, lines, harmonics, found[:, :-2, 0], found[:, -2, 0], found[:, -1, 0])
