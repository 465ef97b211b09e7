r"""Statistical intervals of ratios of tones: what each block of time says of the amplitudes.

A windowed amplitude is linear in the signal, :math:`A = \sum_t g_t y_t`. What is left of y when
tone, conjugate and mean are taken off adds :math:`c_s = \sum_{t \in s} g_t r_t` in block s of whole
periods, so A is the mean, with the window's weight W_s of each block, of :math:`A + c_s/W_s`: the
form that ``bootstrap`` resamples. Over several segments the blocks are the segments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from torchliner.records import Interval
from torchliner.signals.blocks import plan_blocks
from torchliner.signals.bootstrap import can_resample
from torchliner.signals.resampling import FROM_REFLECTION, Conversion, Resampling
from torchliner.signals.transfer import segment_amplitudes
from torchliner.signals.windows import make_window

FEWEST_RUNS = 8  # below, an interval says little
SMALLEST_WIDTH = 1e-9  # a steady tone leaves rounding


@dataclass(frozen=True)
class TimeBlocks:
    """Blocks of a record at one frequency.

    Args:
        amplitudes: of each signal given, (S, ..., 1).  weights: W, of sum 1, (S,).
        single: whether they are blocks of one segment, not segments.
    """

    amplitudes: tuple[Tensor, ...]
    weights: Tensor
    single: bool

    def h1(self, driver: Tensor, response: Tensor, ratio: Tensor) -> Tensor:
        """Deviation of H1 = response/driver in each block, to first order, (S, ...).

        Args:
            driver, response: of the blocks, (S, ..., 1), linear in ``amplitudes``.
            ratio: H1 of the whole record, (..., 1).
        """
        weight = self.weights.reshape(-1, *[1] * (driver.ndim - 1))
        whole = (weight * driver).sum(0)
        # Within one segment the driver is that of the whole record; over segments H1 weights them.
        lead = whole if self.single else driver
        power = lead.abs().square() if self.single else (weight * driver.abs().square()).sum(0)
        return lead.conj() * (response - ratio * driver) / power

    def interval(
        self, series: Tensor, value: Tensor, level: float, conversion: Conversion = FROM_REFLECTION
    ) -> Interval:
        """Of Z from the deviation of a quantity in each block, (S, ...); see ``Resampling``."""
        return Resampling(self.weights, level, conversion).over_time(series, value)


def blocks_of(
    signals: Sequence[Tensor], frequency: Tensor, sampling_rate: float, *, window: Any,
    segment: float | None, start: float,
) -> TimeBlocks | None:  # fmt: skip
    """Amplitudes of signals of one time base in blocks of time; None for fewer than four.

    Args:
        signals: real, (..., T) each.  frequency: Hz, (1,).  sampling_rate: Hz.
        window, segment, start: as for ``segment_amplitudes``, whose amplitudes these explain.
    """
    first = round(start * sampling_rate)
    samples = signals[0].shape[-1]
    whole = segment is None or round(segment * sampling_rate) == samples - first
    if not whole:
        found = [
            segment_amplitudes(signal, frequency, sampling_rate, window=window, segment=segment,
                               start=start)
            for signal in signals
        ]  # fmt: skip
        count = len(found[0])
        # A single segment that leaves part of the record out has no others to be compared with.
        return TimeBlocks(tuple(found), torch.full((count,), 1 / count, dtype=torch.float64),
                          False) if can_resample(count) else None  # fmt: skip
    blocks = plan_blocks(samples, first, sampling_rate / float(frequency))
    if not can_resample(blocks.count):
        return None
    weight = make_window(window, samples - first).weights
    turn = 2j * torch.pi * frequency / sampling_rate * torch.arange(first, samples)
    basis = torch.stack([turn.exp(), (-turn).exp(), torch.ones_like(turn)])
    across = basis.conj() * weight
    dual = torch.linalg.solve(across @ basis.mT, across)
    share = blocks.sums(torch.cat([weight.new_zeros(first), weight]))
    share = share / weight.sum()
    borders = [b - first for b in blocks.borders]
    kept = torch.stack([dual[0, a:b] @ basis[:, a:b].T for a, b in pairwise(borders)])  # (S, 3)
    found = []
    for signal in signals:
        ends = [*borders, samples - first] if borders[-1] < samples - first else borders
        sums = torch.stack([
            signal[..., first + a : first + b].to("cpu", torch.complex128) @ dual[:, a:b].T
            for a, b in pairwise(ends)
        ])  # fmt: skip
        fitted = sums.sum(0)  # tone, conjugate, mean
        left = sums[: blocks.count, ..., 0] - torch.einsum("sk,...k->s...", kept, fitted)
        size = share.reshape(-1, *[1] * (left.ndim - 1)).clamp(min=1e-12)
        found.append((fitted[..., 0] + left / size)[..., None])
    return TimeBlocks(tuple(found), share / share.sum(), True)
