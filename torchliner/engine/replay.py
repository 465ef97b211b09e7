r"""The whole reflected signal, eq. (3.2), of every column of a record, and R from it.

.. math:: y(t) = \sum_k x(k)\, h(t - k;\, |v(k)|)

A kernel belongs to the time k of its emission. Kernels of ``BATCH`` consecutive emissions are gathered from the table,
interpolated, laid into rows that begin one sample later each, and multiplied by x in one batched matmul. Batches begin
at multiples of ``BATCH`` of the record, so y does not depend on how it is cut.
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor
from torch.nn.functional import pad

from torchliner.checks import require_choice
from torchliner.engine.blocks import Blocks
from torchliner.engine.kernels import KernelTable, interpolate
from torchliner.engine.sums import Columns, Held, Job, Record, linear, reduce
from torchliner.names import WINDOWS
from torchliner.records.incident import EDGES, Incident

BATCH = 64  # emissions
ON_CPU, ON_DEVICE = 1 << 21, 1 << 27  # numbers in the kernels that are held together
ROWS = 24  # columns that take as much memory as the waves of one frequency under a Hann window
LOWEST = 1e-6  # power relative to that of the strongest line: below it is leakage, not signal


@dataclass(eq=False)
class Replay:
    """y of every column as a ``sums.Record``, formed while it is read, differentiable in v and in the taps.

    It has C N columns, wave by wave; ``ComplexTones`` are C = 2 F waves, all cosines before all sines. Edge ``silent``:
    nothing is emitted outside the record, eq. (3.2) to the letter, which costs 3e-4 in R with a Hann window over 16
    periods; ``periodic``: velocity and wave repeat.

    Source: Roncen et al. (2026), eq. (3.2), extended to taps before zero.
    """

    record: Record  # v, m/s, float32 or float64
    kernels: KernelTable  # at the sampling rate of the record; where |v| is beyond their levels y is nan
    incident: Incident  # x
    drive: Columns  # columns (t, N) whose |v| acts on the liner, such as ``drives.Drive()``
    edge: str | None = None  # default that of the wave
    store: Callable[[Tensor, int], None] | None = None  # called with each part of y and its first sample
    columns: int = 0  # C N

    def __post_init__(self) -> None:
        edge = self.incident.edge if self.edge is None else self.edge
        self.periodic = require_choice("edge rule", edge, EDGES) == "periodic"
        self.samples, self.device, rate = self.record.samples, self.record.device, self.kernels.sampling_rate
        self.sent = waves_of(self.incident.sampled(self.samples, rate))
        count = self.drive(torch.zeros(1, self.record.columns, device=self.device), 0).shape[1]
        self.columns = self.columns or count * len(self.sent)

    def slabs(self, bounds: Sequence[tuple[int, int]]) -> Iterator[Tensor]:
        """y at samples begin .. end - 1 of each of ``bounds``, which rise, (t, C N)."""
        first, taps, n = self.kernels.first, self.kernels.taps.shape[1], self.samples
        # Emissions up to the last that each part hears, whole batches; they begin a kernel before the first part.
        ends = [(bounds[0][0] - first - taps + 1) // BATCH * BATCH]
        ends += [-((first - end) // BATCH) * BATCH for _, end in bounds]
        if not self.periodic:
            ends = [min(max(end, 0), n) for end in ends]
        # Where emissions low .. high - 1 are in the record, which repeats.
        pieces = [
            [(a % n, a % n + b - a) for a, b in pairwise([low, *range((low // n + 1) * n, high, n), high]) if a < b]
            for low, high in pairwise(ends)
        ]
        read = self.record.slabs([piece for each in pieces for piece in each])
        held, at = torch.empty(0), ends[0] + first  # y from sample ``at`` on, its last K - 1 samples incomplete
        sent, table = self.sent, pad(self.kernels.taps, (0, BATCH))
        for (begin, end), (low, high), parts in zip(bounds, pairwise(ends), pieces, strict=True):
            if parts:
                speed = torch.cat([self.drive(next(read), part[0]).abs() for part in parts]).T
                if not held.numel():
                    sent, table = sent.to(speed), table.to(speed)
                    held = speed.new_zeros(len(speed), len(sent), taps - 1)
                held = self._received(held, speed, sent[:, torch.arange(low, high, device=speed.device) % n], table)
            signal = held[..., begin - at : end - at].permute(2, 1, 0).flatten(1)
            if self.store is not None:
                self.store(signal, begin)
            yield signal
            held, at = held[..., end - at :], end

    def _received(self, held: Tensor, speed: Tensor, sent: Tensor, table: Tensor) -> Tensor:
        """Receptions (N, C, M), the last K - 1 incomplete, and t more: of waves (C, t) sent at |v| (N, t)."""
        width, count, old = table.shape[1] - 1, speed.shape[1], held.shape[2] - (table.shape[1] - BATCH) + 1
        tile = max(1, (ON_CPU if speed.device.type == "cpu" else ON_DEVICE) // (BATCH * table.shape[1]))
        found = pad(held, (0, count + BATCH))
        for left in range(0, len(speed), tile):
            for k in range(0, count, BATCH):
                now = speed[left : left + tile, k : k + BATCH]
                kernels = interpolate(table, *self.kernels.grid.locate(now))  # (n, BATCH, K + BATCH)
                rows = kernels.flatten(1)[:, : -now.shape[1]].unflatten(1, (now.shape[1], width))  # one later each
                found[left : left + tile, :, old + k : old + k + width] += sent[:, k : k + BATCH] @ rows
        return found[..., :-BATCH]


def waves_of(sent: Tensor) -> Tensor:
    """Real waves, (C, T): of complex ones, (F, T), all real parts, then all imaginary ones."""
    return torch.cat([sent.real, sent.imag]) if sent.is_complex() else sent[None]


def cross_spectra(
    reflected: Replay | Held,
    incident: Incident,
    frequency: Tensor,
    sampling_rate: float,
    *,
    segment: int | None = None,
    window: str | None = None,
) -> tuple[Tensor, Tensor]:
    """Y X*, complex128, (S, N, F), and |X|^2, (S, 1, F), of S segments of so many samples that overlap by half, None
    for the whole record as one, in one reading of y: R(f) is the sum of the first over that of the second, H1.
    ``window``: ``hann`` (periodic) or ``boxcar``, default that of the wave."""
    hann = require_choice("window", incident.window if window is None else window, WINDOWS) == "hann"
    samples, parts = reflected.samples, 1 if segment is None else 2
    length = samples if segment is None else segment
    step = length // parts
    if length % parts or not 2 <= length <= samples:
        raise ValueError(f"segment is {length} samples; it must be even, and 2 to {samples}, the record")
    blocks = Blocks((*range(0, samples, step), samples), sampling_rate, samples // step)  # with what is behind the last
    # A Hann window mixes a line with its neighbours, whose signs turn with the start of the segment.
    lines = torch.cat([frequency + q * sampling_rate / length for q in ((0, -1, 1) if hann else (0,))])
    sent = incident.sampled(samples, sampling_rate)

    def spectra(signal: Replay | Held) -> Tensor:
        """Of all segments, (S, N, F)."""
        sized = dataclasses.replace(signal, columns=max(signal.columns, ROWS * len(frequency)))
        (sums,) = reduce(sized, blocks, [Job(lambda y, _: y, linear, lines.to(signal.device))])
        cosine_and_sine = sums[: samples // step, 1:, 0].unflatten(1, (2, -1, len(frequency))).unbind(1)
        each = torch.complex(*cosine_and_sine).conj().transpose(2, 3)
        each = each if parts == 1 else each[:-1] + each[1:]
        found = each[:, 0]
        if hann:
            sign = (-1.0) ** torch.arange(len(each), dtype=torch.float64, device=signal.device)[:, None, None]
            found = found / 2 - sign * (each[:, 1] + each[:, 2]) / 4
        if sent.is_complex():
            real, imaginary = found.unflatten(1, (2, len(sent), -1)).diagonal(dim1=2, dim2=4).unbind(1)
            found = real + 1j * imaginary
        return found

    waves = waves_of(sent).T
    x = spectra(Held(lambda low, high: waves[low:high], samples, waves.shape[1], sent.device))
    power, weights = x.abs().square(), torch.hann_window(length, dtype=torch.float64) if hann else 1.0
    strongest = torch.fft.fft(sent.unfold(-1, length, step) * weights).abs().square().sum(-2).amax(-1)
    for f, weak in zip(frequency.tolist(), (power.sum((0, 1)) < LOWEST * strongest).tolist(), strict=True):
        if weak:
            raise ValueError(f"{incident.label}: no energy at {f:g} Hz, 60 dB below the strongest line; ask elsewhere")
    device = reflected.device
    return spectra(reflected) * x.conj().to(device), power.to(device)
