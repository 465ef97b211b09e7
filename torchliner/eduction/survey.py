"""The first pass over a plane: what must be known of the whole record before it is replayed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from torchliner.records.slabs import slab_bounds

PERIODS_PER_SEGMENT = 2.0


class VelocitySource(Protocol):
    """Velocity read by slabs: (t, P)."""

    samples: int
    probes: int

    def read(self, begin: int, end: int) -> Tensor:
        """Samples begin .. end - 1, m/s, (t, P)."""
        ...


@dataclass(frozen=True)
class Survey:
    """Sums over a whole record, float64 or complex128.

    Args:
        mean: m/s, (P,).
        mean_square: of v, m2/s2, (P,).
        smallest, largest: of v, m/s, (P,).
        bad: number of samples that are nan or inf, (P,).
        first_bad: time index of the first of them, -1 if none, (P,).
        line: sum of w (v - mean) e^{-j omega t}, (P, F).
        coherence: of v with a steady tone, 0 to 1, (P, F).
        segments: number of segments behind ``coherence``.
    """

    mean: Tensor
    mean_square: Tensor
    smallest: Tensor
    largest: Tensor
    bad: Tensor
    first_bad: Tensor
    line: Tensor
    coherence: Tensor
    segments: int

    @property
    def rms(self) -> Tensor:
        """rms of v with its mean removed, eq. (3.6), (P,)."""
        return (self.mean_square - self.mean**2).clamp(min=0).sqrt()


def survey(
    source: VelocitySource,
    frequency: Tensor,
    sampling_rate: float,
    weights: Tensor,
    progress: Callable[[int], None] | None = None,
) -> Survey:
    """One pass over ``source``: extremes, moments, faults, tone and coherence.

    Args:
        source: n samples of P probes.
        frequency: Hz, (F,).
        sampling_rate: Hz.
        weights: window over the n samples, float64, (n,), zero in the pre-roll.
        progress: called with the number of samples done.

    The coherence is that between v and a tone of constant phase, from S segments of two periods
    with Hann windows: |sum V_s|^2 / (S sum |V_s|^2). Without a tone its mean is 1/S.
    """
    n, probes = source.samples, source.probes
    analysis = _Analysis(n, frequency, sampling_rate, weights)
    first = source.read(0, 1)
    device = first.device
    total = torch.zeros(probes, dtype=torch.float64, device=device)
    square = torch.zeros_like(total)
    smallest, largest = torch.full_like(total, torch.inf), torch.full_like(total, -torch.inf)
    bad = torch.zeros(probes, dtype=torch.int64, device=device)
    first_bad = torch.full_like(bad, -1)
    lines = torch.zeros(len(frequency), probes, dtype=torch.complex128, device=device)
    coherence = _Coherence(analysis, probes, device)
    for begin, end in slab_bounds(n, probes):
        slab = source.read(begin, end).to(torch.float64)
        finite = torch.isfinite(slab)
        if not bool(finite.all()):
            wrong = ~finite
            new = wrong.any(0) & (first_bad < 0)
            first_bad[new] = begin + wrong.to(torch.int8).argmax(0)[new]
            bad += wrong.sum(0)
            slab = torch.where(finite, slab, 0.0)
        total += slab.sum(0)
        square += (slab**2).sum(0)
        smallest = torch.minimum(smallest, slab.amin(0))
        largest = torch.maximum(largest, slab.amax(0))
        lines += _project(analysis.lines(begin, end), slab)
        coherence.add(begin, end, slab)
        if progress is not None:
            progress(end - begin)
    mean = total / n
    lines = lines - analysis.window_lines().to(device)[:, None] * mean
    return Survey(
        mean,
        square / n,
        smallest,
        largest,
        bad,
        first_bad,
        lines.T,
        coherence.result(mean, square / n).T,
        analysis.segments,
    )


def _project(matrix: Tensor, slab: Tensor) -> Tensor:
    matrix = matrix.to(slab.device)
    return torch.complex(matrix.real @ slab, matrix.imag @ slab)


class _Analysis:
    """Rows of e^{-j omega t} under the window and under the coherence segments."""

    def __init__(self, n: int, frequency: Tensor, sampling_rate: float, weights: Tensor) -> None:
        self.turn = 2 * torch.pi * frequency.cpu() / sampling_rate
        self.weights = weights
        period = sampling_rate / float(frequency.min())
        self.segment_length = max(1, min(n, round(PERIODS_PER_SEGMENT * period)))
        self.segments = max(1, n // self.segment_length)
        steps = torch.arange(self.segment_length, dtype=torch.float64)
        self.hann = 0.5 - 0.5 * torch.cos(2 * torch.pi * steps / self.segment_length)

    def _waves(self, begin: int, end: int) -> Tensor:
        steps = torch.arange(begin, end, dtype=torch.float64)
        return torch.exp(-1j * torch.outer(self.turn, steps))

    def lines(self, begin: int, end: int) -> Tensor:
        return self._waves(begin, end) * self.weights[begin:end]

    def window_lines(self) -> Tensor:
        return self.lines(0, len(self.weights)).sum(1)

    def segment_lines(self, s: int, begin: int, end: int) -> Tensor:
        """e^{-j omega t} under the Hann window of segment s, for samples begin .. end - 1."""
        inside = torch.arange(begin, end) - s * self.segment_length
        return self._waves(begin, end) * self.hann[inside]


class _Coherence:
    """Running sums over segments; only the unfinished one is held."""

    def __init__(self, analysis: _Analysis, probes: int, device: torch.device) -> None:
        self.analysis = analysis
        shape = (len(analysis.turn), probes)
        self.current = torch.zeros(shape, dtype=torch.complex128, device=device)
        self.total = torch.zeros_like(self.current)
        self.power = torch.zeros(shape, dtype=torch.float64, device=device)
        # The window's own lines, for the mean velocity that is known only at the end.
        self.window = torch.zeros(shape[0], 1, dtype=torch.complex128, device=device)
        self.window_total = torch.zeros_like(self.window)
        self.window_power = torch.zeros(shape[0], 1, dtype=torch.float64, device=device)
        self.cross = torch.zeros_like(self.power)

    def add(self, begin: int, end: int, slab: Tensor) -> None:
        """Samples begin .. end - 1, in order."""
        length = self.analysis.segment_length
        for s in range(begin // length, min(self.analysis.segments, -(-end // length))):
            low, high = max(begin, s * length), min(end, (s + 1) * length)
            matrix = self.analysis.segment_lines(s, low, high)
            self.current = self.current + _project(matrix, slab[low - begin : high - begin])
            self.window = self.window + matrix.sum(1, keepdim=True).to(slab.device)
            if high == (s + 1) * length:
                self.total += self.current
                self.power += self.current.abs() ** 2
                self.window_total += self.window
                self.window_power += self.window.abs() ** 2
                self.cross += (self.current * self.window.conj()).real
                self.current = torch.zeros_like(self.current)
                self.window = torch.zeros_like(self.window)

    def result(self, mean: Tensor, mean_square: Tensor) -> Tensor:
        """|sum V_s|^2 / (S sum |V_s|^2) of v without its mean, (F, P)."""
        total = self.total - mean * self.window_total
        power = self.power - 2 * mean * self.cross + mean**2 * self.window_power
        power = self.analysis.segments * power
        # A constant probe leaves rounding behind, which would be coherent with itself.
        length, segments = self.analysis.segment_length, self.analysis.segments
        floor = segments**2 * 1e-24 * mean_square * length**2
        return torch.where(power > floor, total.abs() ** 2 / power.clamp(min=1e-300), 0.0)
