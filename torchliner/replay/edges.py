r"""What happens at the two ends of a record: one exact table, shared by all probes.

Let w be the window, zero outside its N samples. A unit tone emitted at sample k through the kernel
of |v_k| adds to the windowed line f0 of the reflected signal

    G_k(v) = sum_m h[m; v] e^{-j omega m} w[k + m].                                     (1)

Where w is a sum of few cosines, w = sum_q c_q e^{2 pi j q k/N}, and k + m stays inside the record,

    G_k(v) = sum_q c_q e^{2 pi j q k/N} H(f0 - q fs/N; v),                              (2)

so a handful of lines of the response replace the kernel: R itself may stand for H. Near the ends,
and for windows that are no short sum of cosines, the difference between (1) and (2), or between
(1) and w_k H(f0; v), is added from a table over (k, level).

Edge rules:
- ``finite`` (default): the velocity record is used as it is. The tone was on before the record and
  stays on after it; what is emitted outside reaches into the record through the mean kernel of the
  first (last) K samples, K being the kernel's length, or of the whole record if that is shorter.
  So a frozen |v| gives the kernel's response exactly, and stationary turbulence has no start-up
  bias.
- ``silent``: eq. (3.2) to the letter: no wave outside the record. Start-up error with a Hann window
  3e-4 for 16 periods.
- ``wrap``: the record is periodic; it needs whole periods.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.replay.kernels import KernelTable
from torchliner.signals.windows import Window


@dataclass(frozen=True)
class Record:
    """A window placed in a record.

    Args:
        samples: n, samples of the velocity record.
        start: first sample under the window (the pre-roll before it only emits).
        window: n - start samples.
        edge: one of ``EDGE_RULES``.
        sampling_rate: Hz.
    """

    samples: int
    start: int
    window: Window
    edge: str
    sampling_rate: float

    def line_frequencies(self, frequency: float) -> tuple[list[float], list[complex]]:
        """Frequencies and coefficients of (2); one line of coefficient 1 if (2) cannot serve."""
        spacing = self.sampling_rate / (self.samples - self.start)
        lines = self.window.lines
        if lines and all(frequency - q * spacing > 0 for q, _ in lines):
            return [frequency - q * spacing for q, _ in lines], [c for _, c in lines]
        return [frequency], []

    def weights(self, begin: int, end: int) -> Tensor:
        """The window at samples begin .. end - 1, 0 in the pre-roll: float64, (t,)."""
        steps = torch.arange(begin, end) - self.start
        return torch.where(steps >= 0, self.window.weights[steps.clamp(min=0)], 0.0)

    def line_weights(self, frequency: float, begin: int, end: int) -> Tensor:
        """Weight of each line at emissions begin .. end - 1: complex128, shape (t, lines)."""
        _, coefficients = self.line_frequencies(frequency)
        if not coefficients:
            return self.weights(begin, end)[:, None].to(torch.complex128)
        steps = torch.arange(begin, end, dtype=torch.float64) - self.start
        turn = 2 * torch.pi / (self.samples - self.start)
        orders = torch.tensor([q for q, _ in self.window.lines], dtype=torch.float64)
        waves = torch.exp(1j * turn * torch.outer(steps, orders))
        return (
            (steps >= 0).to(torch.complex128)[:, None]
            * waves
            * torch.tensor(coefficients, dtype=torch.complex128)
        )

    def needs_table(self, frequency: float) -> bool:
        """False if (2) is exact everywhere, so that no kernel is needed."""
        return self.edge != "wrap" or not self.line_frequencies(frequency)[1]


class Reach:
    """The window as emissions see it, K samples beyond the record: shared by all frequencies.

    Args:
        record: n samples.
        length: K, taps of the kernels.
    """

    def __init__(self, record: Record, length: int) -> None:
        self.record, self.length = record, length
        n, start = record.samples, record.start
        self.weights = record.weights(0, n)
        reach = torch.arange(-length, n + length)
        inside = (reach >= 0) & (reach < n)
        self.seen = torch.zeros(len(reach), dtype=torch.float64)
        self.seen[inside] = self.weights
        if record.edge == "wrap":
            self.seen = self.weights[reach % n]
        # The cosines go on for ever; the window does not.
        periodic = record.window.weights
        self.periodic = periodic[(reach - start) % len(periodic)]


class EdgeTable:
    """Rows of (1) minus the lines, for emission times k and all levels."""

    def __init__(self, kernels: KernelTable, reach: Reach, frequency: float) -> None:
        record = reach.record
        self.record, self.reach = record, reach
        self.length, self.first = kernels.taps.shape[1], kernels.first
        self.taps = kernels.taps
        self.turn = 2 * torch.pi * frequency / record.sampling_rate
        self.phase = torch.exp(-1j * self.turn * kernels.lags)
        self.has_lines = bool(record.line_frequencies(frequency)[1])
        self.zone = min(record.samples, self.length)
        self.before, self.after = self._outside(kernels)

    def rows(self, begin: int, end: int) -> tuple[Tensor, Tensor] | None:
        """Forward and backward tables for k = begin .. end - 1, complex128, (t, V); or None."""
        n, last = self.record.samples, self.first + self.length - 1
        wrapped = self.record.edge == "wrap"
        whole = wrapped or (begin + self.first >= self.record.start and end - 1 + last < n)
        met_from_outside = self.record.edge == "finite" and (
            begin < self.zone or end > n - self.zone
        )
        if self.has_lines and whole and not met_from_outside:
            return None
        steps = torch.arange(begin, end)
        difference = self._spread(self.reach.seen, begin, end)
        under = (steps >= self.record.start).to(torch.float64)[:, None]
        if self.has_lines:
            difference = difference - under * self._spread(self.reach.periodic, begin, end)
        else:
            difference = difference - self.reach.weights[begin:end, None]
        forward = self._through_kernels(difference)
        # float64 steps: an integer tensor times 2j would be complex64.
        backward = forward * torch.exp(-2j * self.turn * steps.to(torch.float64))[:, None]
        for member, (one, two) in (
            (steps < self.zone, self.before),
            (steps >= n - self.zone, self.after),
        ):
            if self.record.edge == "finite":
                share = member.to(torch.complex128)[:, None] / self.zone
                forward, backward = forward + share * one, backward + share * two
        return forward, backward

    def _through_kernels(self, amounts: Tensor) -> Tensor:
        """sum_m amounts[., m] h[m; v] e^{-j omega m}: (t, K), real or complex, to (t, V)."""
        phased = amounts * self.phase
        return torch.complex(phased.real @ self.taps.T, phased.imag @ self.taps.T)

    def _spread(self, padded: Tensor, begin: int, end: int) -> Tensor:
        """padded[k + m] for k = begin .. end - 1 and every lag m: shape (t, K)."""
        low = begin + self.first + self.length
        return padded[low : low + end - begin + self.length - 1].unfold(0, self.length, 1)

    def _outside(self, kernels: KernelTable) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
        """Sums over emissions before and after the record, per level: ((V,), (V,)) each."""
        n, weights = self.record.samples, self.reach.weights
        turning = weights * torch.exp(-2j * self.turn * torch.arange(n, dtype=torch.float64))
        zero = torch.zeros(1, dtype=torch.complex128)
        plain_sum = torch.cat([zero, weights.to(torch.complex128).cumsum(0)])
        turning_sum = torch.cat([zero, turning.cumsum(0)])
        lag = kernels.lags.to(torch.int64)
        early, late = lag.clamp(0, n), (n + lag).clamp(0, n)
        ahead = torch.exp(2j * self.turn * kernels.lags)

        def both(plain: Tensor, turned: Tensor) -> tuple[Tensor, Tensor]:
            first, second = self._through_kernels(torch.stack([plain, turned * ahead]))
            return first, second

        before = both(plain_sum[early], turning_sum[early])
        after = both(plain_sum[-1] - plain_sum[late], turning_sum[-1] - turning_sum[late])
        return before, after
