r"""Tones of a pressure record in blocks of time, and the statistical intervals that follow because it is finite.

A windowed amplitude is linear in the signal, :math:`A = \sum_t g_t y_t`. What is left of y when tone, conjugate and
mean are taken off adds :math:`c_s = \sum_{t \in s} g_t r_t` in block s of whole periods, so without block s of weight
W_s it is :math:`A - c_s/(1 - W_s)`, which the jackknife of ``engine.intervals`` takes. Of several segments these are
the blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS, frequency_tensor
from torchliner.engine.blocks import Blocks
from torchliner.engine.intervals import FEWEST_BLOCKS, FEWEST_RUNS, SMALLEST_WIDTH, Conversion, jackknife, replicates
from torchliner.pressure.spectra import segment_amplitudes, window_weights
from torchliner.records import Interval, PressureRecord
from torchliner.records.notes import Note

LEVEL = 0.95
NO_TONE = 1e-9  # of a signal's largest value

Quantities = dict[str, tuple[Tensor, Conversion]]  # of those that remain, (1 + S + 4, ..., 1), and how Z follows


@dataclass(frozen=True)
class Parts:
    """Tones of signals at one frequency in S parts of a record: segments, or blocks of one segment."""

    amplitudes: Sequence[Tensor]  # of each signal, (S, ..., 1)
    weights: Tensor  # of the parts, of sum 1, (S,)
    single: bool  # whether they are of one segment, whose amplitude is their mean

    @property
    def segments(self) -> list[Tensor]:
        """Amplitudes of the segments, one or several, of each signal."""
        return [self.remaining(each)[:1] if self.single else each for each in self.amplitudes]

    def h1(self, driver: Tensor, response: Tensor) -> Tensor:
        """H1 = response/driver, (S, ..., 1) each, linear in ``amplitudes``, of all ``remaining`` parts."""
        if self.single:  # H1 of one segment is the ratio of its amplitudes
            return self.remaining(response) / self.remaining(driver)
        return self.remaining(driver.conj() * response) / self.remaining(driver.abs().square())

    def remaining(self, values: Tensor) -> Tensor:
        """Weighted means of (S, ...) over all parts, without each and without each quarter, (1 + S + 4, ...)."""
        return replicates(torch.einsum("s,s...->s...", self.weights.to(values), values), self.weights)


@dataclass(frozen=True)
class Tones:
    """How tones are read from a record.

    Args:
        record: of pressures.
        frequency: Hz, one or several; default the record's own tone.
        window: any window of scipy.
        segment: s, overlapping by half; default the whole record, in which tones are exact.
        start: s at the beginning that are left out.
        allow_short: accept fewer than four periods.
        interval: level of the statistical intervals, 0 to 1; None for none.
    """

    record: PressureRecord
    frequency: Any = None
    window: Any = "hann"
    segment: float | None = None
    start: float = 0.0
    allow_short: bool = False
    interval: float | None = LEVEL

    def __post_init__(self) -> None:
        record = self.record
        if self.interval is not None and not 0 < self.interval < 1:
            raise ValueError(f"interval is {self.interval:g}; it is a level between 0 and 1 (95 % is 0.95)")
        wanted = frequency_tensor(self.frequency, record.sampling_rate, record=record).cpu()
        object.__setattr__(self, "frequency", wanted)
        if not 0 <= self.start < record.duration:
            raise ValueError(f"start is {self.start:g} s; {record.name} lasts {record.duration:g} s")
        lowest = float(wanted.min())
        periods = lowest * (record.duration - self.start)
        if periods < FEWEST_PERIODS * (1 - 1e-6) and not self.allow_short:
            few = f"holds {periods:.3g} periods of {lowest:g} Hz, fewer than {FEWEST_PERIODS:g}"
            raise ValueError(f"{record.name} {few}; allow_short=True takes them")

    @property
    def choices(self) -> dict[str, Any]:
        """As a result states them."""
        return {"window": self.window, "segment": self.segment, "start": self.start}

    def parts(self, signals: Sequence[Tensor], frequency: Tensor) -> Parts:
        """Of real signals, (..., T), at one frequency, Hz, (1,)."""
        rate = self.record.sampling_rate
        first = round(self.start * rate)
        samples = signals[0].shape[-1] - first
        whole = self.segment is None or abs(self.segment * rate - samples) <= 0.5
        if whole and samples * float(frequency) >= rate:
            blocks = Blocks.of(samples, rate, float(frequency))
            if blocks.count >= FEWEST_BLOCKS:
                return self._blocks(signals, frequency, first, blocks)
        found = [segment_amplitudes(each, frequency, rate, **self.choices) for each in signals]
        count = len(found[0])
        return Parts(found, torch.full((count,), 1 / count, dtype=torch.float64), count == 1)

    def _blocks(self, signals: Sequence[Tensor], frequency: Tensor, first: int, blocks: Blocks) -> Parts:
        """Of one segment that begins at a sample; their mean is that of ``segment_amplitudes``."""
        samples, pairs = signals[0].shape[-1] - first, list(pairwise(blocks.borders))
        weight = window_weights(self.window, samples)
        turn = 2j * torch.pi * frequency / blocks.sampling_rate * torch.arange(first, first + samples)
        basis = torch.stack([turn.exp(), (-turn).exp(), torch.ones_like(turn)])
        across = basis.conj() * weight
        dual = torch.linalg.solve(across @ basis.mT, across)
        share = torch.stack([weight[a:b].sum() for a, b in pairs]) / weight.sum()
        kept = torch.stack([dual[0, a:b] @ basis[:, a:b].T for a, b in pairs])  # (S, 3)
        ends = list(pairwise(sorted({*blocks.borders, samples})))
        found = []
        for signal in signals:
            late = signal[..., first:].cpu()
            sums = torch.stack([late[..., a:b].to(torch.complex128) @ dual[:, a:b].T for a, b in ends])
            fitted = sums.sum(0)  # tone, conjugate, mean
            left = sums[: blocks.count, ..., 0] - torch.einsum("sk,...k->s...", kept, fitted)
            size = share.reshape(-1, *[1] * (left.ndim - 1))
            own = left / size.clamp(min=1e-12)
            own = own - (size * own).sum(0) / share.sum()  # what the samples behind the last period add
            found.append((fitted[..., 0] + own)[..., None])
        return Parts(found, share / share.sum(), True)

    def require_tone(self, label: str, signal: Tensor, amplitude: Tensor, frequency: Tensor) -> None:
        """Refuse pressures (N, T) one of which has no tone: amplitudes of segments (S, N, 1)."""
        quiet = (amplitude.abs().amax((0, 2)) <= NO_TONE * signal.abs().amax(-1).cpu()).nonzero()[:, 0].tolist()
        if quiet:
            where = f"{self.record.name}: {label} pressure has no tone at {float(frequency):g} Hz"
            raise ValueError(f"{where} in {len(quiet)} of {len(signal)} signals, first {quiet[0]}; leave it out")

    def results(self, each: Sequence[tuple[Parts, Quantities]]) -> tuple[dict[str, Tensor], dict[str, Interval], int]:
        """Z of quantities, (..., F), from the parts at every frequency; their intervals, none for fewer than four
        parts; and the fewest parts behind one."""
        names, fewest = list(each[0][1]), min(len(parts.weights) for parts, _ in each)
        impedances = {n: torch.cat([made[n][1].impedance(made[n][0][0]) for _, made in each], -1) for n in names}
        if self.interval is None or fewest < FEWEST_BLOCKS:
            return impedances, {}, fewest
        bounds = {}
        for n in names:
            found = [jackknife(made[n][0], parts.weights, self.interval, made[n][1]) for parts, made in each]
            bounds[n] = Interval.joined(found, -1)
        return impedances, bounds, fewest

    def few_blocks_notes(self, method: str, found: Interval | None) -> list[Note]:
        """Where an interval is missing or rough."""
        if self.interval is None:
            return []
        text = "no statistical interval, since the record holds fewer than four blocks (periods, or segments)"
        if found is not None:
            runs = float(found.runs.min())
            if runs >= FEWEST_RUNS or not float(found.widths.max()) > SMALLEST_WIDTH:
                return []
            text = f"the error bars rest on {runs:.2g} independent blocks, fewer than {FEWEST_RUNS}; they are rough"
        return [Note("no-intervals" if found is None else "few-blocks", f"{self.record.name}: {method}: {text}")]
