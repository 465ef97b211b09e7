r"""The whole reflected signal, eq. (3.2), of every column of a record, and R from it.

.. math:: y(t) = \sum_k x(k)\, h(t - k;\, |v(k)|)

A kernel belongs to the time k of its emission. Kernels of ``BATCH`` consecutive emissions are gathered from the table,
interpolated, laid into rows that begin one sample later each, and multiplied by x in one batched matmul. Batches begin
at multiples of ``BATCH`` of the record, so y does not depend on how it is cut.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import pad

from torchliner.checks import require_choice
from torchliner.engine.blocks import Blocks, waves
from torchliner.engine.kernels import KernelTable
from torchliner.engine.levels import interpolate
from torchliner.engine.sums import Drive, Held, Job, Record, linear, reduce
from torchliner.records.incident import EDGES, Incident

BATCH = 64  # emissions
ON_CPU, ON_DEVICE = 1 << 21, 1 << 27  # numbers in the kernels that are held together
ROWS = 4  # columns that take the memory of the two windowed rows, float64, of a frequency
LOWEST = 1e-6  # power relative to that of the strongest line: below it is leakage, not signal


def replay(
    record: Record, kernels: KernelTable, incident: Incident, drive: Drive, *, edge: str | None = None, reach: int = 0
) -> Replay:
    """The reflected signal of every column. It is formed while it is read; nothing but x is as long as the record.

    Args:
        record: v, m/s, float32 or float64, on any device; y is differentiable in it and in the taps.
        kernels: at the sampling rate of the record. Where |v| is beyond their levels y is nan.
        incident: x.
        drive: columns (t, N) whose |v| acts on the liner, such as ``drives.as_measured``.
        edge: ``silent``: nothing is emitted outside the record, eq. (3.2) to the letter, which costs 3e-4 in R with a
            Hann window over 16 periods. ``periodic``: velocity and wave repeat. Default that of the wave.
        reach: samples before and after a slab that ``drive`` needs.
    Raises:
        ValueError: a wave that does not suit the record, or cannot repeat with it.
    Source: Roncen et al. (2026), eq. (3.2), extended to taps before zero.
    """
    sent = incident.sampled(record.samples, kernels.sampling_rate)
    periodic = require_choice("edge rule", incident.edge if edge is None else edge, EDGES) == "periodic"
    if periodic:
        incident.require_periodic(record.samples, kernels.sampling_rate)
    sent = _waves(sent)
    columns = drive(torch.zeros(1, record.columns, device=record.device), 0).shape[1] * len(sent)
    return Replay(record, kernels, sent, drive, periodic, reach, record.samples, columns, record.device)


@dataclass(eq=False)
class Replay:
    """y as a ``sums.Record`` of C N columns, wave by wave; ``ComplexTones`` are C = 2 F waves, cosines before sines."""

    record: Record
    kernels: KernelTable
    sent: Tensor  # (C, T), float64
    drive: Drive
    periodic: bool
    reach: int
    samples: int
    columns: int
    device: torch.device

    def slabs(self, bounds: Sequence[tuple[int, int]]) -> Iterator[Tensor]:
        """y at samples begin .. end - 1 of each of ``bounds``, (t, C N); those that follow on are convolved once."""
        first, taps = self.kernels.first, self.kernels.taps.shape[1]
        plan = list(self._plan(bounds))
        read = self.record.slabs(
            [(max(0, a - self.reach), min(self.samples, b + self.reach)) for _, _, pieces in plan for a, b in pieces]
        )
        sent, table = self.sent, pad(self.kernels.taps, (0, BATCH))
        held, at, done = sent, 0, -1
        for (begin, end), (low, high, pieces) in zip(bounds, plan, strict=True):
            if pieces:
                speed = torch.cat([self._speed(next(read), *piece) for piece in pieces])
                speed = pad(speed, (0, 0, 0, high - low - len(speed))).T
                sent, table = sent.to(speed), table.to(speed)
                if begin != done:
                    held, at = speed.new_zeros(len(speed), len(sent), taps - 1), low + first
                step = torch.arange(low, high, device=speed.device)
                now = sent[:, step % self.samples] * (self.periodic | (step < self.samples))
                held = self._received(held, speed, now, table)
            yield held[..., begin - at : end - at].permute(2, 1, 0).flatten(1)
            held, at, done = held[..., end - at :], end, end

    def _plan(self, bounds: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int, list[tuple[int, int]]]]:
        """Emissions low .. high - 1 to add for each of ``bounds``, whole batches, and where in the record they are."""
        first, n = self.kernels.first, self.samples
        done, high = -1, 0
        for begin, end in bounds:
            low = high if begin == done else (begin - first - self.kernels.taps.shape[1] + 1) // BATCH * BATCH
            high, done = -((first - end) // BATCH) * BATCH, end
            if not self.periodic:
                low, high = max(0, low), high if high < n else -((first - n) // BATCH) * BATCH
            stop = high if self.periodic else min(high, n)
            cuts = [low, *range((low // n + 1) * n, stop, n), stop]
            yield low, high, [(a % n, a % n + b - a) for a, b in pairwise(cuts) if a < b]

    def _speed(self, slab: Tensor, begin: int, end: int) -> Tensor:
        """|v| that drives samples begin .. end - 1, (t, N)."""
        low = max(0, begin - self.reach)
        return self.drive(slab, low)[begin - low : end - low].abs()

    def _received(self, held: Tensor, speed: Tensor, sent: Tensor, table: Tensor) -> Tensor:
        """Receptions (N, C, M), the last K - 1 of them incomplete, and t more: of waves (C, t) sent at |v| (N, t)."""
        taps = table.shape[1] - BATCH
        tile = max(1, (ON_CPU if speed.device.type == "cpu" else ON_DEVICE) // (BATCH * table.shape[1]))
        tiles = []
        for own, before in zip(speed.split(tile), held.split(tile), strict=True):
            complete, tail = before.split([before.shape[2] - taps + 1, taps - 1], dim=2)
            found = [complete]
            for k in range(0, own.shape[1], BATCH):
                kernels = interpolate(table, *self.kernels.grid.locate(own[:, k : k + BATCH]))  # (n, BATCH, K + BATCH)
                rows = kernels.flatten(1)[:, :-BATCH].unflatten(1, (BATCH, taps + BATCH - 1))  # one sample later each
                total = sent[:, k : k + BATCH] @ rows + pad(tail, (0, BATCH))
                found.append(total[..., :BATCH].clone())
                tail = total[..., BATCH:]
            tiles.append(torch.cat([*found, tail], dim=2))
        return torch.cat(tiles)


def _waves(sent: Tensor) -> Tensor:
    """Real waves, (C, T): of complex ones, (F, T), all real parts, then all imaginary ones."""
    return torch.cat([sent.real, sent.imag]) if sent.is_complex() else sent[None]


class Transfer(NamedTuple):
    """R, complex128, (N, F); Y, windowed sums of y e^{-j omega t} over S segments, (S, N, F); X, (S, F)."""

    reflection: Tensor
    reflected: Tensor
    incident: Tensor


def transfer(
    reflected: Replay | Held,
    incident: Incident,
    frequency: Tensor,
    sampling_rate: float,
    *,
    segment: int | None = None,
    window: str | None = None,
) -> Transfer:
    """R(f) = sum Y X* / sum |X|^2 over segments, H1, in one reading of y.

    Args:
        reflected: y, such as a ``Replay``.
        incident: x of the same record.
        frequency: Hz, (F,); those of ``ComplexTones`` themselves.
        sampling_rate: Hz.
        segment: samples of segments that overlap by half; None for the whole record as one.
        window: ``hann`` (periodic) or ``boxcar``; default that of the wave.
    Raises:
        ValueError: a segment that is odd or does not fit, a frequency at which the wave has no energy.
    """
    window = require_choice("window", incident.window if window is None else window, ("hann", "boxcar"))
    samples, device, parts = reflected.samples, reflected.device, 1 if segment is None else 2
    length = samples if segment is None else segment
    if length % parts or not 2 <= length <= samples:
        raise ValueError(f"segment is {length} samples; it must be even, and 2 to {samples}, the record")
    step = length // parts
    angle = 2 * torch.pi / length * torch.arange(length, dtype=torch.float64)
    weights = 0.5 - 0.5 * torch.cos(angle) if window == "hann" else torch.ones_like(angle)
    blocks = Blocks(tuple(range(0, samples + 1, step)), sampling_rate, samples // step)

    sent = incident.sampled(samples, sampling_rate)

    def spectra(signal: Replay | Held) -> Tensor:
        """Of all segments, (S, N, F): the first part of the window over a block, its second part over the next."""
        lines, halves = frequency.to(signal.device), weights.unflatten(0, (parts, 1, step)).to(signal.device)

        def rows(begin: int, end: int) -> Tensor:
            inside = halves[..., torch.arange(begin, end, device=signal.device) % step]
            return (inside * waves(lines, sampling_rate, begin, end)[1:]).flatten(0, 1)

        sized = dataclasses.replace(signal, columns=max(signal.columns, ROWS * parts * len(lines)))
        (sums,) = reduce(sized, blocks, [Job(lambda y, _: y, rows, linear)])
        cosine, sine = sums[:, :, 0].unflatten(1, (parts, 2, len(lines))).unbind(2)
        each = torch.complex(cosine, -sine)
        whole = (each[:, 0] if parts == 1 else each[:-1, 0] + each[1:, 1]).transpose(1, 2)
        if not sent.is_complex():
            return whole
        real, imaginary = whole.unflatten(1, (2, len(sent), -1)).diagonal(dim1=2, dim2=4).unbind(1)
        return real + 1j * imaginary

    waves_sent = _waves(sent).T
    x = spectra(Held(lambda low, high: waves_sent[low:high], samples, waves_sent.shape[1], sent.device))[:, 0]
    power = x.abs().square().sum(0)
    strongest = torch.fft.fft(sent.unfold(-1, length, step) * weights).abs().square().sum(-2).amax(-1)
    for f, weak in zip(frequency.tolist(), (power < LOWEST * strongest).tolist(), strict=True):
        if weak:
            raise ValueError(f"{incident.label}: no energy at {f:g} Hz, 60 dB below the strongest line; ask elsewhere")
    y, x = spectra(reflected), x.to(device)
    return Transfer((y * x.conj()[:, None]).sum(0) / power.to(device), y, x)
