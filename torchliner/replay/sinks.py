"""What becomes of a reflected signal: lines of tones, cross-spectra, or all of it."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from torchliner.replay.edges import Record
from torchliner.replay.incident import LineSums
from torchliner.signals.tones import line_sums, waves


class ToneSink:
    """Windowed lines of the replies to complex tones; see ``incident.LineSums``."""

    def __init__(self, frequency: Tensor, record: Record, columns: int, device: torch.device) -> None:
        """For ``columns`` columns; frequency in Hz, (F,)."""
        self.frequency, self.record, self.device = frequency, record, device
        shape = (len(frequency), columns, 2, 2)
        self.products = torch.zeros(shape, dtype=torch.float64, device=device)
        self.kept: dict[tuple[int, int], Tensor] = {}

    def add(self, reflected: Tensor, columns: slice, begin: int) -> None:
        """Real parts of all tones, then imaginary ones: (2 F, p, t)."""
        rows = self._analysis(begin, begin + reflected.shape[2])
        for part, signal in enumerate(reflected.chunk(2)):
            self.products[:, columns, part] += signal.to(torch.float64) @ rows

    def _analysis(self, begin: int, end: int) -> Tensor:
        """Cosine and sine of each frequency under the window, (F, t, 2)."""
        if (begin, end) not in self.kept:
            turning = waves(self.frequency, self.record.sampling_rate, begin, end)
            pair = torch.stack([turning.real, -turning.imag], dim=-1)
            pair = pair * self.record.weights(begin, end)[:, None]
            self.kept[begin, end] = pair.to(self.device)
        return self.kept[begin, end]

    def flush(self) -> None:
        """All columns have been given these samples."""
        self.kept = {}

    def sums(self, backward: bool) -> LineSums:
        """With y = a + j b and e^{-j omega t} = c - j s: a c + b s + j (b c - a s), and y*."""
        real, imaginary = self.products.unbind(2)
        forward = torch.complex(real[..., 0] + imaginary[..., 1], imaginary[..., 0] - real[..., 1])
        if not backward:
            return LineSums(forward.T, None)
        mirrored = torch.complex(real[..., 0] - imaginary[..., 1], -imaginary[..., 0] - real[..., 1])
        return LineSums(forward.T, mirrored.T)


class CrossSpectra:
    """H1 estimate over windowed segments: R(f) = sum Y X* / sum |X|^2.

    Only segments that some block has cut are held; the incident signal is known from the start.
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
        self.frequency, self.sampling_rate = frequency, sampling_rate
        length = len(weights)
        self.sent = torch.stack(
            [line_sums(incident[s : s + length] * weights, frequency, sampling_rate, s) for s in starts]
        )  # (S, F)
        self.shape = (len(frequency), columns)
        self.open: dict[int, Tensor] = {}
        self.kept: dict[tuple[int, int, int], Tensor] = {}
        self.cross = torch.zeros(self.shape, dtype=torch.complex128, device=device)
        self.ended = 0

    def add(self, reflected: Tensor, columns: slice, begin: int) -> None:
        """One channel, (1, p, t)."""
        end, length = begin + reflected.shape[2], len(self.weights)
        signal = reflected[0].to(torch.float64).T
        for number, start in enumerate(self.starts):
            low, high = max(begin, start), min(end, start + length)
            if low >= high:
                continue
            rows = self._analysis(number, low, high)
            piece = signal[low - begin : high - begin]
            line = torch.complex(rows.real @ piece, rows.imag @ piece)
            if low > start or high < start + length:
                if number not in self.open:
                    self.open[number] = torch.zeros_like(self.cross)
                self.open[number][:, columns] += line
                line = self.open[number][:, columns]
            if high == start + length:
                self.cross[:, columns] += line * self.sent[number].to(self.device)[:, None].conj()
        self.ended = end

    def _analysis(self, number: int, low: int, high: int) -> Tensor:
        """e^{-j omega t} under the window of a segment, complex128, (F, t)."""
        key = (number, low, high)
        if key not in self.kept:
            start = self.starts[number]
            turning = waves(self.frequency, self.sampling_rate, low, high)
            self.kept[key] = (turning * self.weights[low - start : high - start]).to(self.device)
        return self.kept[key]

    def flush(self) -> None:
        """All columns of the pass have been given these samples: drop what is complete."""
        length = len(self.weights)
        self.open = {k: v for k, v in self.open.items() if self.starts[k] + length > self.ended}
        self.kept = {}

    def reflection(self) -> Tensor:
        """R, (P, F)."""
        return (self.cross / (self.sent.abs() ** 2).sum(0).to(self.device)[:, None]).T


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
