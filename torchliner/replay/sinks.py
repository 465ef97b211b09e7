"""What becomes of a reflected signal: lines of tones, cross-spectra, or all of it."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from torchliner.replay.edges import Record
from torchliner.replay.incident import LineSums


class ToneSink:
    """Windowed lines of the replies to complex tones; see ``incident.LineSums``."""

    def __init__(
        self, frequency: Tensor, record: Record, columns: int, device: torch.device
    ) -> None:
        """For ``columns`` columns; frequency in Hz, (F,)."""
        count = len(frequency)
        steps = torch.arange(record.samples, dtype=torch.float64)
        weights = torch.zeros(record.samples, dtype=torch.float64)
        weights[record.start :] = record.window.weights
        turn = 2 * torch.pi / record.sampling_rate * frequency.cpu()
        phase = torch.outer(turn, steps)
        # (F, n, 2): cosine and sine of each frequency under the window.
        self.analysis = torch.stack([phase.cos(), phase.sin()], dim=-1) * weights[:, None]
        self.analysis = self.analysis.to(device)
        shape = (count, columns, 2, 2)
        self.products = torch.zeros(shape, dtype=torch.float64, device=device)

    def add(self, reflected: Tensor, columns: slice, begin: int) -> None:
        """Real parts of all tones, then imaginary ones: (2 F, p, t)."""
        rows = self.analysis[:, begin : begin + reflected.shape[2]]
        for part, signal in enumerate(reflected.chunk(2)):
            self.products[:, columns, part] += signal.to(torch.float64) @ rows

    def flush(self) -> None:
        """Nothing is held back."""

    def sums(self, backward: bool) -> LineSums:
        """With y = a + j b and e^{-j omega t} = c - j s: a c + b s + j (b c - a s), and y*."""
        real, imaginary = self.products.unbind(2)
        forward = torch.complex(real[..., 0] + imaginary[..., 1], imaginary[..., 0] - real[..., 1])
        if not backward:
            return LineSums(forward.T, None)
        mirrored = torch.complex(
            real[..., 0] - imaginary[..., 1], -imaginary[..., 0] - real[..., 1]
        )
        return LineSums(forward.T, mirrored.T)


class CrossSpectra:
    """H1 estimate over windowed segments: R(f) = sum Y X* / sum |X|^2.

    Only the segments under way are held; the incident signal is known from the start.
    """

    def __init__(
        self,
        incident: Tensor,
        weights: Tensor,
        starts: list[int],
        frequency: Tensor,
        sampling_rate: float,
        columns: int,
        device: torch.device,
    ) -> None:
        """``incident`` float64 (n,); ``weights`` of one segment (N,); ``starts`` of all."""
        self.weights, self.starts, self.device = weights, starts, device
        self.turn = 2 * torch.pi / sampling_rate * frequency.cpu()
        length = len(weights)
        self.sent = torch.stack(
            [
                (incident[s : s + length] * weights * self._waves(s, s + length)).sum(1)
                for s in starts
            ]
        )  # (S, F)
        self.columns, self.count = columns, len(frequency)
        self.open: dict[int, Tensor] = {}
        zero = torch.zeros(self.count, columns, dtype=torch.complex128, device=device)
        self.cross, self.power = zero, zero.real.clone()

    def _waves(self, begin: int, end: int) -> Tensor:
        steps = torch.arange(begin, end, dtype=torch.float64)
        return torch.exp(-1j * torch.outer(self.turn, steps))

    def add(self, reflected: Tensor, columns: slice, begin: int) -> None:
        """One channel, (1, p, t)."""
        end, length = begin + reflected.shape[2], len(self.weights)
        signal = reflected[0].to(torch.float64)
        for number, start in enumerate(self.starts):
            low, high = max(begin, start), min(end, start + length)
            if low >= high:
                continue
            if number not in self.open:
                shape = (self.count, self.columns)
                self.open[number] = torch.zeros(shape, dtype=torch.complex128, device=self.device)
            rows = (self._waves(low, high) * self.weights[low - start : high - start]).to(
                self.device
            )
            piece = signal[:, low - begin : high - begin].T
            line = torch.complex(rows.real @ piece, rows.imag @ piece)
            self.open[number][:, columns] += line
            if high == start + length:
                whole = self.open[number][:, columns]
                sent = self.sent[number].to(self.device)[:, None]
                self.cross[:, columns] += whole * sent.conj()
                self.power[:, columns] += whole.abs() ** 2
                self.open[number][:, columns] = 0
        self.ended = end

    def flush(self) -> None:
        """Segments that all columns of the pass have left are dropped."""
        length = len(self.weights)
        self.open = {k: v for k, v in self.open.items() if self.starts[k] + length > self.ended}

    def reflection(self) -> Tensor:
        """R, (P, F)."""
        return (self.cross / self._sent_power()).T

    def coherence(self) -> Tensor:
        """|sum Y X*|^2/(sum |X|^2 sum |Y|^2), (P, F); 1 with a single segment."""
        total = self._sent_power() * self.power
        return torch.where(total > 0, self.cross.abs() ** 2 / total.clamp(min=1e-300), 0.0).T

    def _sent_power(self) -> Tensor:
        return (self.sent.abs() ** 2).sum(0).to(self.device)[:, None]


class WholeSignal:
    """All of the reflected signal, given to ``store`` in slabs of time: (t, p) from a sample on."""

    def __init__(self, store: Callable[[Tensor, slice, int], None]) -> None:
        self.store = store
        self.parts: list[Tensor] = []
        self.columns = slice(0, 0)
        self.begin = 0

    def add(self, reflected: Tensor, columns: slice, begin: int) -> None:
        """One channel, (1, p, t), kept until all columns of the block are there."""
        if not self.parts:
            self.columns, self.begin = columns, begin
        self.parts.append(reflected[0].T)
        self.columns = slice(self.columns.start, columns.stop)

    def flush(self) -> None:
        """Hand the block over."""
        if self.parts:
            self.store(torch.cat(self.parts, dim=1), self.columns, self.begin)
        self.parts = []
