"""What is known of v itself, block by block, and which probes make up a cell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.engine.blocks import Blocks

SAME = 1e-9  # relative: closer lines are one
HARMONICS = 8
STEADY = 1e-18  # of the mean square: less than rounding


def harmonics_of(tone: float | None, sampling_rate: float, count: int = HARMONICS) -> list[float]:
    """The first harmonics of a tone (Hz) below half the sampling rate; none without a tone."""
    found = [] if tone is None else [tone * h for h in range(1, count + 1)]
    return [line for line in found if line < 0.5 * sampling_rate * (1 - 1e-6)]


def merged_lines(harmonics: list[float], asked: list[float]) -> list[float]:
    """The harmonics, then the frequencies asked for that are none of them."""
    lines = list(harmonics)
    for f in asked:
        if all(abs(f / line - 1) > SAME for line in lines):
            lines.append(f)
    return lines


@dataclass(frozen=True, eq=False)
class Membership:
    """Probes by cell.

    Args:
        labels: cell of each probe, int64, (P,); C for probes of no cell.
        places, inside: probes of each cell side by side, padded with probe 0, int64, and 0 there, else 1, (C, M).
        sizes: probes of each cell, float64, (C,).
        ordered: whether the probes already lie so in memory, all cells alike: no copy is needed.
    """

    labels: Tensor
    places: Tensor
    inside: Tensor
    sizes: Tensor
    ordered: bool

    @classmethod
    def of(cls, labels: Tensor, count: int, device: torch.device) -> Membership:
        """From labels on the host, (P,), -1 for no cell, of ``count`` cells that each hold a probe."""
        sizes = torch.bincount(labels[labels >= 0], minlength=count)
        most = int(sizes.max())
        order = torch.argsort(labels, stable=True)[int((labels < 0).sum()) :]
        places, inside = torch.zeros(count, most, dtype=torch.int64), torch.zeros(count, most, dtype=torch.float64)
        cell = labels[order]
        slot = torch.arange(len(order)) - (sizes.cumsum(0) - sizes)[cell]
        places[cell, slot], inside[cell, slot] = order, 1.0
        ordered = count * most == len(labels) and torch.equal(places.flatten(), torch.arange(count * most))
        outside = torch.where(labels < 0, count, labels)
        return cls(outside.to(device), places.to(device), inside.to(device), sizes.double().to(device), ordered)

    @property
    def count(self) -> int:
        """C."""
        return len(self.places)

    def sum(self, values: Tensor) -> Tensor:
        """Over the probes of each cell: (..., P) to (..., C)."""
        if self.ordered:
            return values.unflatten(-1, self.places.shape).sum(-1)
        members = values.index_select(-1, self.places.flatten()).unflatten(-1, self.places.shape)
        return members.mul_(self.inside.to(members)).sum(-1)

    def mean(self, values: Tensor) -> Tensor:
        """Over the probes of each cell: (..., P) to (..., C)."""
        return self.sum(values) / self.sizes.to(values)

    def away(self, values: Tensor) -> Tensor:
        """What deviates from the mean over the cell, 0 at probes of no cell, (..., P)."""
        if self.ordered:
            members = values.unflatten(-1, self.places.shape)
            return (members - members.mean(-1, keepdim=True)).flatten(-2)
        return values * (self.labels < self.count) - self.spread(self.mean(values))

    def spread(self, of_cells: Tensor) -> Tensor:
        """The value of its cell at each probe, 0 at probes of no cell: (..., C) to (..., P)."""
        return torch.nn.functional.pad(of_cells, (0, 1)).index_select(-1, self.labels)


@dataclass(frozen=True, eq=False)
class Survey:
    """Sums of v over S blocks of P columns, float64.

    Args:
        blocks: of the record.
        lines: Hz, (L,), on the host; the first ``harmonics`` of them are those of the tone.
        harmonics: H.
        sums: of v times 1, cos and sin of the lines, m/s, (S, 1 + 2 L, P).
        squares: of v^2, m2/s2, (S, P).
        peaks: largest |v|, m/s, (S, P).
        gram: of products of 1, cos and sin, (S, 1 + 2 L, 1 + 2 L).
    """

    blocks: Blocks
    lines: Tensor
    harmonics: int
    sums: Tensor
    squares: Tensor
    peaks: Tensor
    gram: Tensor

    @property
    def lengths(self) -> Tensor:
        """Samples of each block, on the device of the sums, (S,)."""
        return self.gram[:, 0, 0]

    def mean_of(self, sums: Tensor) -> Tensor:
        """Over the record, from sums over its blocks: (S, ...) to (1, ...)."""
        return sums.sum(0, keepdim=True) / self.lengths.sum()

    @property
    def mean(self) -> Tensor:
        """m/s, (P,)."""
        return self.mean_of(self.sums[:, 0])[0]

    @property
    def mean_square(self) -> Tensor:
        """Of v, m2/s2, (P,)."""
        return self.mean_of(self.squares)[0]

    @property
    def rms(self) -> Tensor:
        """Of v with its mean removed, eq. (3.6), m/s, (P,)."""
        return (self.mean_square - self.mean**2).clamp(min=0).sqrt()

    @property
    def peak(self) -> Tensor:
        """Largest |v|, m/s, (P,)."""
        return self.peaks.amax(0)

    def rows_of_harmonics(self) -> list[int]:
        """Which of the 1 + 2 L rows are 1, cos and sin of the harmonics."""
        cosines = range(1, 1 + self.harmonics)
        return [0, *cosines, *(row + len(self.lines) for row in cosines)]

    def line_sums(self, frequency: Tensor, columns: slice = slice(None)) -> tuple[Tensor, Tensor]:
        """Sums of v e^{-j omega t}, complex128, (S, n, F), nan where not measured, and of e^{-j omega t}, (S, F)."""
        near = (self.lines[:, None] / frequency - 1).abs() < SAME * 10
        measured, place = near.any(0), near.int().argmax(0).tolist() if len(near) else [-1] * len(frequency)
        cosine, sine = [1 + i for i in place], [1 + len(self.lines) + i for i in place]
        part = self.sums[:, :, columns]
        of_v = torch.complex(part[:, cosine], -part[:, sine]).transpose(1, 2)
        if not bool(measured.all()):
            of_v = of_v * torch.where(measured, 1.0, torch.nan).to(part)
        return of_v, torch.complex(self.gram[:, 0, cosine], -self.gram[:, 0, sine])

    def coherence(self, frequency: Tensor, cells: Membership | None = None) -> Tensor:
        """Squared coherence of v with a steady tone, 0 to 1, (P, F); nan where not measured.

        With ``cells`` of the velocity averaged over each, (F,): a single probe in turbulence hardly sees the sound that
        all holes of its cell pass. Of several cells power is added, so that a grazing wave counts. nan where a steady
        velocity has no line.
        """
        of_v, of_one = self.line_sums(frequency)
        lines = (of_v - self.mean[:, None] * of_one[:, None]) / self.lengths[:, None, None]
        if cells is not None:
            lines = cells.mean(lines.transpose(1, 2))  # (S, F, C)
        power, coherent = lines.abs().square().mean(0), lines.mean(0).abs().square()
        if cells is None:
            return torch.where(power == 0, 0.0, coherent / power.clamp(min=1e-300))
        power, least = power.sum(-1), STEADY * self.mean_square.mean() * cells.count
        return torch.where(power <= least, torch.nan, coherent.sum(-1) / power.clamp(min=1e-300))

    def tone(self, frequency: Tensor, means: Callable[[Tensor], Tensor], columns: slice = slice(None)) -> Tensor:
        """Complex peak amplitude of v (as stored, away from the liner) at f, m/s, (B, n, F), its mean taken off.

        ``means``: from sums over blocks, (S, ...), to means, (B, ...), such as ``mean_of``.
        """
        of_v, of_one = self.line_sums(frequency, columns)
        return 2 * (means(of_v) - means(self.sums[:, 0, columns])[..., None] * means(of_one)[:, None])


def coherence_by_chance(blocks: int, chance: float) -> float:
    """Squared coherence c that noise exceeds in this share of records of S blocks: (1 - c)^(S - 1)."""
    return 1 - chance ** (1 / (blocks - 1))


def survey_sums(weights: Tensor, columns: Tensor) -> Tensor:
    """Measure: sums of w v, then of w v^2 with the first row's w, then the largest |v|: (G, R + 2, 1, N)."""
    squares = weights[:, :1] @ columns.square()
    return torch.cat([weights @ columns, squares, columns.abs().amax(1, keepdim=True)], 1)[:, :, None]


def survey_of(found: Tensor, blocks: Blocks, lines: Tensor, harmonics: int) -> Survey:
    """From what a job with ``survey_sums`` and ``largest=1`` found in all S blocks; ``lines`` on the host."""
    gram = gram_of(blocks, lines).to(found.device)
    return Survey(blocks, lines, harmonics, found[:, :-2, 0], found[:, -2, 0], found[:, -1, 0], gram)


def gram_of(blocks: Blocks, lines: Tensor) -> Tensor:
    """Sums of products of 1, cos and sin of lines (Hz, (L,)) over each block, in closed form: (S, 1 + 2 L, 1 + 2 L)."""
    with_zero = torch.cat([lines.new_zeros(1), lines])
    pairs = torch.stack([with_zero[:, None] - with_zero, with_zero[:, None] + with_zero])
    minus, plus = blocks.wave_sums(pairs.flatten()).unflatten(1, pairs.shape).unbind(1)
    cosines, sines = (minus.real + plus.real) / 2, (minus.real - plus.real) / 2
    mixed = (minus.imag - plus.imag) / 2  # of cos (row) times sin (column)
    upper = torch.cat([cosines, mixed[:, :, 1:]], 2)
    lower = torch.cat([mixed.transpose(1, 2)[:, 1:], sines[:, 1:, 1:]], 2)
    return torch.cat([upper, lower], 1)
