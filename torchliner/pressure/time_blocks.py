r"""Tones of a pressure record in blocks of time, and the statistical intervals that follow.

An interval says how far Z may be off because the record is finite; not what the formula, the cavity's numbers or the
microphones' own errors do.

A windowed amplitude is linear in the signal, :math:`A = \sum_t g_t y_t`. What is left of y when tone, conjugate and
mean are taken off adds :math:`c_s = \sum_{t \in s} g_t r_t` in block s of whole periods, so A is the mean, with the
window's weight W_s of each block, of :math:`A + c_s/W_s`: without block s it is :math:`A - c_s/(1 - W_s)`. Z of these
amplitudes is what the jackknife of ``engine.intervals`` takes. Over several segments the blocks are the segments, and
H1 is made of the sums over those that remain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS, stated_frequency
from torchliner.engine.blocks import Blocks
from torchliner.engine.intervals import FEWEST_BLOCKS, Conversion, jackknife, replicates
from torchliner.records import Interval, PressureRecord
from torchliner.records.notes import Note
from torchliner.tones import segment_amplitudes, window_weights

LEVEL = 0.95
FEWEST_RUNS = 8  # below, an interval says little
SMALLEST_WIDTH = 1e-9  # a steady tone leaves rounding


@dataclass(frozen=True)
class TimeBlocks:
    """Blocks of a record at one frequency.

    Args:
        amplitudes: of each signal given, (S, ..., 1).
        weights: W, of sum 1, (S,).
        single: whether they are blocks of one segment, not segments.
    """

    amplitudes: tuple[Tensor, ...]
    weights: Tensor
    single: bool

    def h1(self, driver: Tensor, response: Tensor) -> Tensor:
        """H1 = response/driver of all blocks, without each and without each quarter, (1 + S + 4, ...).

        Args:
            driver, response: of the blocks, (S, ..., 1), linear in ``amplitudes``.
        """
        if self.single:  # H1 of one segment is the ratio of its amplitudes
            return self._remaining(response) / self._remaining(driver)
        return self._remaining(driver.conj() * response) / self._remaining(driver.abs().square())

    def _remaining(self, values: Tensor) -> Tensor:
        """Weighted means of (S, ...) over the blocks that remain."""
        return replicates(self.weights.reshape(-1, *[1] * (values.ndim - 1)) * values, self.weights)


def time_intervals(
    signals: Sequence[Tensor],
    frequency: Tensor,
    sampling_rate: float,
    options: dict[str, Any],
    level: float | None,
    quantities: Callable[[TimeBlocks, int], dict[str, tuple[Tensor, Conversion]]],
) -> tuple[dict[str, Interval], int] | None:
    """Intervals of quantities, (..., F), and the fewest blocks behind one; None for fewer than four blocks.

    Args:
        signals: real, of one time base, (..., T) each.
        frequency: Hz, (F,).
        sampling_rate: Hz.
        options: window, segment and start of ``segment_amplitudes``.
        level: of the intervals; None for none.
        quantities: of the blocks at a frequency, and its number: values of ``TimeBlocks.h1`` or made of them, and how Z
            follows from them.
    """
    if level is None:
        return None
    parts: dict[str, list[Interval]] = {}
    counts = []
    for f, hertz in enumerate(frequency):
        blocks = _blocks(signals, hertz[None], sampling_rate, **options)
        if blocks is None:
            return None
        counts.append(len(blocks.weights))
        for name, (values, conversion) in quantities(blocks, f).items():
            parts.setdefault(name, []).append(jackknife(values, blocks.weights, level, conversion))
    return {name: Interval.joined(each, -1) for name, each in parts.items()}, min(counts)


def _blocks(
    signals: Sequence[Tensor],
    frequency: Tensor,
    sampling_rate: float,
    *,
    window: Any,
    segment: float | None,
    start: float,
) -> TimeBlocks | None:
    """Amplitudes at one frequency, (1,), that explain those of ``segment_amplitudes``."""
    first, samples = round(start * sampling_rate), signals[0].shape[-1]
    if segment is not None and round(segment * sampling_rate) != samples - first:
        cut = {"window": window, "segment": segment, "start": start}
        parts = tuple(segment_amplitudes(s, frequency, sampling_rate, **cut) for s in signals)
        equal = torch.full((len(parts[0]),), 1 / len(parts[0]), dtype=torch.float64)
        # A single segment that leaves part of the record out has no others to be compared with.
        return TimeBlocks(parts, equal, False) if len(equal) >= FEWEST_BLOCKS else None
    if (samples - first) * float(frequency) < sampling_rate:
        return None
    borders = list(Blocks.of(samples - first, sampling_rate, float(frequency)).borders)
    count = len(borders) - 1
    if count < FEWEST_BLOCKS:
        return None
    weight = window_weights(window, samples - first)
    turn = 2j * torch.pi * frequency / sampling_rate * torch.arange(first, samples)
    basis = torch.stack([turn.exp(), (-turn).exp(), torch.ones_like(turn)])
    across = basis.conj() * weight
    dual = torch.linalg.solve(across @ basis.mT, across)
    share = torch.stack([weight[a:b].sum() for a, b in pairwise(borders)]) / weight.sum()
    kept = torch.stack([dual[0, a:b] @ basis[:, a:b].T for a, b in pairwise(borders)])  # (S, 3)
    ends = sorted({*borders, samples - first})
    found = []
    for signal in signals:
        parts_of = (
            signal[..., first + a : first + b].to("cpu", torch.complex128) @ dual[:, a:b].T for a, b in pairwise(ends)
        )
        sums = torch.stack(list(parts_of))
        fitted = sums.sum(0)  # tone, conjugate, mean
        left = sums[:count, ..., 0] - torch.einsum("sk,...k->s...", kept, fitted)
        size = share.reshape(-1, *[1] * (left.ndim - 1)).clamp(min=1e-12)
        own = left / size
        own = own - (size * own).sum(0) / share.sum()  # what the samples behind the last period add
        found.append((fitted[..., 0] + own)[..., None])
    return TimeBlocks(tuple(found), share / share.sum(), True)


def frequencies_of(record: PressureRecord, frequency: Any, start: float, allow_short: bool) -> Tensor:
    """Those asked for, or the record's tone, Hz, (F,).

    Raises:
        ValueError: none is stated; one is at or above Nyquist; the record after ``start`` (s) is empty or has fewer
            than four periods of one.
    """
    wanted = stated_frequency(frequency, record.frequency, record.name, record.sampling_rate)
    if not 0 <= start < record.duration:
        raise ValueError(
            f"start is {start:g} s; it must be at least 0 and leave something of {record.name}, which lasts "
            f"{record.duration:g} s"
        )
    periods = float(wanted.min()) * (record.duration - start)
    if periods < FEWEST_PERIODS * (1 - 1e-6) and not allow_short:
        raise ValueError(
            f"{record.name} holds {periods:.3g} periods of {float(wanted.min()):g} Hz, fewer than "
            f"{FEWEST_PERIODS:g}; pass allow_short=True if that is meant"
        )
    return wanted


def require_level(level: float | None) -> None:
    """Refuse what is no share of all cases; None is for no intervals."""
    if level is not None and not 0 < level < 1:
        raise ValueError(f"interval is {level:g}; it is a level between 0 and 1 (95 % is 0.95)")


def few_blocks_notes(name: str, found: Interval | None, level: float | None) -> list[Note]:
    """Where an interval is missing or rough."""
    if level is None:
        return []
    if found is None:
        text = (
            "no statistical interval, since the record holds fewer than four blocks (periods of the tone, or segments)"
        )
        return [Note("no-intervals", f"{name}: {text}")]
    runs = float(found.runs.min())
    if runs >= FEWEST_RUNS or not float(found.widths.max()) > SMALLEST_WIDTH:
        return []
    text = f"the error bars rest on {runs:.2g} independent blocks of time, fewer than {FEWEST_RUNS}; they are rough"
    return [Note("few-blocks", f"{name}: {text}")]
