"""Coherence of v with a steady tone, |sum V_s|^2 / (S sum |V_s|^2) over segments of few periods."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.records.slabs import SLAB_ROWS
from torchliner.reduction.eager import Lines, continued
from torchliner.reduction.plan import ENDLESS, PassPlan

PERIODS_PER_SEGMENT = 2.0
MOST_PERIODS = 16.0  # of a segment
FEWEST_SEGMENTS = 8
APART = (2.0, 1.5, 0.5)  # bins of a segment: Hann's zero, and where lines turn by half a turn


def segment_periods(frequency: float, tone: float | None, periods: float) -> float:
    """Periods of ``frequency`` (Hz) in a segment.

    Two, if no line of the sound is near. Sound of another frequency, a bin of the segment away,
    lies under the main lobe of Hann's window and has the same phase in each segment: it would count
    as coherent. So where the nearest harmonic of the sound's ``tone`` (Hz) is nearer than two bins,
    segments are so long that it is two away, else that its phase turns by half from one to the
    next.

    Args:
        frequency, tone: Hz; None if unknown.
        periods: in the record.
    """
    limit = max(PERIODS_PER_SEGMENT, periods / FEWEST_SEGMENTS)
    return next(each for each in _lengths(frequency, tone) if each <= limit)


def _lengths(frequency: float, tone: float | None) -> list[float]:
    """Periods of a segment, the best first; the last one is always there."""
    if tone is None:
        return [PERIODS_PER_SEGMENT]
    order = max(1, round(frequency / tone))
    apart = [abs(frequency - n * tone) for n in (order - 1, order, order + 1) if n > 0]
    nearest = min(each for each in apart if each > SAME_FREQUENCY * frequency)
    wanted = [max(PERIODS_PER_SEGMENT, bins * frequency / nearest) for bins in APART]
    return [*(each for each in wanted if each <= MOST_PERIODS), PERIODS_PER_SEGMENT]


class ToneCoherence:
    """Running sums of one group of columns; only unfinished segments are held.

    Args:
        plan: of the pass; the whole record counts.
        tones: Hz, (F,), each with segments of its own under Hann windows. Without a tone the mean
            of the coherence is 1/S.
        sound: Hz, of the tone in the data; None if it is unknown.

    Of a record whose end is not known there are segments of every length that may suit it.
    """

    def __init__(self, plan: PassPlan, tones: Tensor, width: int, device: torch.device, sound: float | None) -> None:
        self.tones, self.sound, self.width = tones.tolist(), sound, width
        wanted = self._wanted(plan)
        if plan.samples == ENDLESS:
            rate = plan.sampling_rate
            wanted = [(i, round(periods * rate / f)) for i, f in enumerate(self.tones)
                      for periods in dict.fromkeys(_lengths(f, sound))]  # fmt: skip
        self.owner = [i for i, _ in wanted]
        self.each = [_Segments(plan, length, width, device) for _, length in wanted]

    def _wanted(self, plan: PassPlan) -> list[tuple[int, int]]:
        """Each tone, and the samples of a segment in such a record."""
        samples, rate = plan.samples, plan.sampling_rate
        found = []
        for i, f in enumerate(self.tones):
            length = round(segment_periods(f, self.sound, samples * f / rate) * rate / f)
            found.append((i, min(max(length, 1), samples)))
        return found

    @property
    def counts(self) -> tuple[int, ...]:
        """Segments behind each tone."""
        return tuple(each.count for each in self.each)

    def weights_of(self, begin: int, slab: Tensor, turning: Tensor) -> list[SegmentWeights | None]:
        """Of each tone, for a slab (t, P) of any group, of samples from ``begin`` on, and the waves
        e^{-j omega t} there, complex128, (F, t)."""
        pairs = zip(self.each, self.owner, strict=True)
        return [each.weights_of(begin, slab, turning[i]) for each, i in pairs]

    def asked(self, weights: Sequence[SegmentWeights | None]) -> list[SegmentLines]:
        """What is to be summed of a slab, in order."""
        pairs = zip(self.each, weights, strict=True)
        return [each.asked(own) for each, own in pairs if own is not None]

    def so_far(self, plan: PassPlan) -> ToneCoherence:
        """Of a record that ended here; views."""
        found = copy.copy(self)
        found.owner, found.each = [], []
        for i, length in self._wanted(plan):
            own = [each for each, j in zip(self.each, self.owner, strict=True) if i == j]
            # In a record that is shorter than the shortest there is none of any length.
            chosen = copy.copy(next((each for each in own if each.length == length), own[-1]))
            chosen.count = plan.samples // chosen.length
            found.owner.append(i)
            found.each.append(chosen)
        return found

    def follow(self, other: ToneCoherence) -> None:
        """Add what comes next in the record."""
        for own, next_one in zip(self.each, other.each, strict=True):
            own.follow(next_one)

    def result(self, mean: Tensor, mean_square: Tensor) -> Tensor:
        """Of v without its mean, (F, P)."""
        found = [each.result(mean, mean_square) for each in self.each]
        return torch.stack(found) if found else mean.new_zeros(0, self.width)


@dataclass(frozen=True)
class SegmentWeights:
    """Of one tone and slab.

    Args:
        begin: first sample of the slab.
        pieces: of it, with the number of the segment, of those that it reaches.
        rows: real and imaginary part of wave times window, (2, t); 0 beyond the last segment.
        windows: lines of the segments' windows, as far as the slab goes, complex128, (S,).
        is_open: whether the last segment goes on.
    """

    begin: int
    pieces: np.ndarray
    rows: Tensor
    windows: Tensor
    is_open: bool


@dataclass(frozen=True)
class SegmentLines:
    """Of one tone, slab and group.

    Args:
        segments: whose.
        weights: of all groups.
        lines: sums over the segments, once they are made; the first one goes on.
    """

    segments: _Segments
    weights: SegmentWeights
    lines: Lines


class _Segments:
    """Segments of one tone."""

    def __init__(self, plan: PassPlan, length: int, width: int, device: torch.device) -> None:
        self.length, self.count = length, plan.samples // length
        steps = torch.arange(length, dtype=torch.float64)
        self.hann = 0.5 - 0.5 * torch.cos(2 * torch.pi * steps / length)
        # Line and power of whole segments, their product with the window's own line, for the mean
        # that is known only at the end; the window's lines themselves.
        self.line = torch.zeros(width, dtype=torch.complex128, device=device)
        self.power = torch.zeros(width, dtype=torch.float64, device=device)
        self.cross = self.power.clone()
        self.window, self.window_power = 0j, 0.0
        self.open = torch.zeros(2, width, dtype=torch.float64, device=device)
        self.open_window = 0j
        # Of a part of a record: whether it begins within a segment, and what it has of that.
        self.inside: bool | None = None
        self.head: tuple[Tensor, complex] | None = None
        self.rounding = 1e-12

    def weights_of(self, begin: int, slab: Tensor, wave: Tensor) -> SegmentWeights | None:
        """None beyond the last whole segment, where samples count for nothing."""
        end = min(begin + len(slab), self.count * self.length)
        if begin >= end:
            return None
        starts = np.arange(begin - begin % self.length, end, self.length)
        hann = self.hann if len(starts) == 1 else self.hann.repeat(len(starts))
        rows = wave[: end - begin] * hann[begin % self.length :][: end - begin]
        cuts = (starts[:, None] + np.arange(0, self.length, SLAB_ROWS)).flatten()
        cuts = np.array([begin, *cuts[(cuts > begin) & (cuts < end)], end])
        block = (cuts[:-1] - starts[0]) // self.length
        pieces = np.column_stack([cuts[:-1] - begin, cuts[1:] - begin, block])
        windows = torch.from_numpy(np.add.reduceat(rows.numpy(), np.maximum(starts - begin, 0)))
        both = torch.zeros(2, len(slab), dtype=torch.float64)
        torch.stack([rows.real, rows.imag], out=both[:, : end - begin])
        both = both.to(slab.device, slab.dtype)
        return SegmentWeights(begin, pieces, both, windows, end % self.length != 0)

    def asked(self, weights: SegmentWeights) -> SegmentLines:
        """Sums over the segments of a slab; then ``add`` them."""
        self.rounding = max(1e-12, 16 * torch.finfo(weights.rows.dtype).eps)
        if self.inside is None:
            self.inside = weights.begin % self.length != 0
        sums = continued(self.open, len(weights.windows))
        return SegmentLines(self, weights, Lines(weights.pieces, weights.rows, sums))

    def add(self, found: SegmentLines) -> None:
        """What ``asked`` stands for, summed."""
        sums, is_open = found.lines.sums, found.weights.is_open
        windows = found.weights.windows.clone()
        windows[0] += self.open_window
        whole = len(sums) - is_open
        headed = int(bool(self.inside) and self.head is None and whole > 0)
        if headed:
            self.head = sums[0].clone(), complex(windows[0])
        self._close(sums[headed:whole], windows[headed:whole].to(sums.device))
        self.open = sums[-1].clone() if is_open else torch.zeros_like(self.open)
        self.open_window = complex(windows[-1]) if is_open else 0j

    def _close(self, sums: Tensor, windows: Tensor) -> None:
        """Whole segments, (S, 2, P), and their windows' lines, (S,)."""
        if not len(sums):
            return
        real, imaginary = sums.unbind(1)
        self.line += torch.complex(real.sum(0), imaginary.sum(0))
        self.power += sums.square().sum((0, 1))
        self.cross += windows.real @ real + windows.imag @ imaginary
        self.window += complex(windows.sum())
        self.window_power += float(windows.abs().square().sum())

    def follow(self, other: _Segments) -> None:
        """Add what comes next in the record."""
        if other.inside is None:
            return  # beyond the last whole segment
        self.rounding = max(self.rounding, other.rounding)
        if other.inside:
            own, window = (other.open, other.open_window) if other.head is None else other.head
            joint, joint_window = self.open + own, self.open_window + window
            if other.head is None:
                self.open, self.open_window = joint, joint_window
            elif self.inside and self.head is None:
                self.head = joint, joint_window
            else:
                self._close(
                    joint[None],
                    torch.tensor([joint_window], dtype=torch.complex128, device=joint.device),
                )
        if self.inside is None:
            self.inside = False
        if other.head is not None or not other.inside:
            self.open, self.open_window = other.open, other.open_window
        self.line += other.line
        self.power += other.power
        self.cross += other.cross
        self.window += other.window
        self.window_power += other.window_power

    def result(self, mean: Tensor, mean_square: Tensor) -> Tensor:
        """(P,)."""
        line = self.line - mean * self.window
        power = self.power - 2 * mean * self.cross + mean**2 * self.window_power
        power = self.count * power
        # A constant probe leaves rounding behind, which would be coherent with itself.
        floor = (self.count * self.length * self.rounding) ** 2 * mean_square
        return torch.where(power > floor, line.abs() ** 2 / power.clamp(min=1e-300), 0.0)
