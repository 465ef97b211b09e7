r"""Tones of a pressure record in blocks of time, and the statistical intervals that follow because it is finite.

A windowed amplitude A is linear in the signal. What is left of that when tone and mean are taken off adds c_s to it in
block s of whole periods (``spectra.tone_blocks``), so without block s of weight W_s it is :math:`A - c_s/(1 - W_s)`,
which the jackknife of ``engine.intervals`` takes. Of several segments these are the blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS, frequency_tensor
from torchliner.conversions import reflection_from_impedance
from torchliner.engine.blocks import Blocks
from torchliner.engine.intervals import FEWEST_BLOCKS, FEWEST_RUNS, SMALLEST_WIDTH, Conversion, jackknife, replicates
from torchliner.pressure.spectra import segment_amplitudes, tone_blocks, window_weights
from torchliner.records import Educed, Interval, PressureRecord
from torchliner.records.notes import Note

LEVEL = 0.95
NO_TONE = 1e-9  # of a signal's largest value

Quantities = dict[str, tuple[Tensor, Conversion]]  # of those that remain, (1 + S + 4, ..., 1), and how Z follows


@dataclass(frozen=True)
class Parts:
    """Tones of N signals at one frequency in S parts of a record: segments, or blocks of one segment."""

    amplitudes: Tensor  # (S, N, 1)
    weights: Tensor  # of the parts, of sum 1, (S,)
    single: bool  # whether they are of one segment, whose amplitude is their mean

    @property
    def segments(self) -> Tensor:
        """Amplitudes of the segments, one or several, (S, N, 1)."""
        return self.remaining(self.amplitudes)[:1] if self.single else self.amplitudes

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
        window: ``hann`` or ``boxcar``.
        segment: s, overlapping by half; default the whole record, in which tones are exact.
        start: s at the beginning that are left out.
        allow_short: accept fewer than four periods.
        interval: level of the statistical intervals, 0 to 1; None for none.
    """

    record: PressureRecord
    frequency: Any = None
    window: str = "hann"
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
        periods = (lowest := float(wanted.min())) * (record.duration - self.start)
        if periods < FEWEST_PERIODS * (1 - 1e-6) and not self.allow_short:
            few = f"holds {periods:.3g} periods of {lowest:g} Hz, fewer than {FEWEST_PERIODS:g}"
            raise ValueError(f"{record.name} {few}; allow_short=True takes them")

    @property
    def choices(self) -> dict[str, Any]:
        """As a result states them."""
        return {"window": self.window, "segment": self.segment, "start": self.start}

    def parts(self, label: str, signal: Tensor, frequency: Tensor) -> Parts:
        """Of signals, (N, T), at one frequency, Hz, (1,): blocks of one segment, whose mean is that of
        ``segment_amplitudes``, or several segments. ValueError where one has no tone; ``label``: what they are."""
        rate, tone = self.record.sampling_rate, float(frequency)
        first = round(self.start * rate)
        samples = signal.shape[-1] - first
        whole = self.segment is None or abs(self.segment * rate - samples) <= 0.5
        if not whole or samples * tone < rate or (blocks := Blocks.of(samples, rate, tone)).count < FEWEST_BLOCKS:
            found = segment_amplitudes(signal, frequency, rate, **self.choices)
            parts = Parts(found, torch.full((len(found),), 1 / len(found), dtype=torch.float64), len(found) == 1)
        else:
            weight, ends = window_weights(self.window, samples), sorted({*blocks.borders, samples})
            mean, added = tone_blocks(signal[..., first:], frequency, rate, weight, ends)
            share = torch.stack([weight[a:b].sum() for a, b in pairwise(blocks.borders)]) / weight.sum()
            own = added[: blocks.count] / share.clamp(min=1e-12)[:, None, None]
            own = own - added[: blocks.count].sum(0) / share.sum()  # what the samples behind the last period add
            turn = torch.exp(-2j * torch.pi * frequency * first / rate)
            parts = Parts(turn * (mean + own), share / share.sum(), True)
        quiet = parts.segments.abs().amax((0, 2)) <= NO_TONE * signal.abs().amax(-1).cpu()
        if bool(quiet.any()):
            where = f"{self.record.name}: {label} pressure has no tone at {tone:g} Hz"
            which = f"{int(quiet.sum())} of {len(signal)} signals, first {int(quiet.nonzero()[0])}"
            raise ValueError(f"{where} in {which}; leave it out")
        return parts

    def results(self, each: Sequence[tuple[Parts, Quantities]]) -> tuple[dict[str, Educed], int]:
        """Z of quantities, (..., F), from the parts at every frequency, and the fewest parts behind one, of which four
        are needed for intervals."""
        fewest, found = min(len(parts.weights) for parts, _ in each), {}
        for name in each[0][1]:
            several, interval = [(parts.weights, *made[name]) for parts, made in each], None
            z = torch.cat([way.impedance(values[0]) for _, values, way in several], -1)
            if self.interval is not None and fewest >= FEWEST_BLOCKS:
                bounds = [jackknife(values, weights, self.interval, way) for weights, values, way in several]
                interval = Interval.joined(bounds, -1)
            found[name] = Educed(reflection_from_impedance(z), interval)
        return found, fewest

    def few_blocks_notes(self, method: str, found: Educed) -> list[Note]:
        """Where an interval is missing or rough."""
        if self.interval is None:
            return []
        code = "no-intervals"
        text = "no statistical interval, since the record holds fewer than four blocks (periods, or segments)"
        if (interval := found.interval) is not None:
            code, runs = "few-blocks", float(interval.runs.min())
            if runs >= FEWEST_RUNS or not float(interval.widths.max()) > SMALLEST_WIDTH:
                return []
            text = f"the error bars rest on {runs:.2g} independent blocks, fewer than {FEWEST_RUNS}; they are rough"
        return [Note(code, f"{self.record.name}: {method}: {text}")]
