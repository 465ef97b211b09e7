r"""Three ways to turn a block of emissions into what they add to the reflected signal.

For one block of l emissions x_k at |v_k| the reply is

    y[i] = sum_k x_k h[i - k; |v_k|],   i = 0 .. l + K - 2.

- ``gather``: the kernel of every emission is gathered from the table, (p, l, K); laid into rows
  that begin one sample later each (the unfolded matrix), it is multiplied by x in one batched
  matmul.
- ``matmul``: with h = sum_r A_r(|v|) B_r[m] only the r factors of every emission are gathered; the
  products x A_r are unfolded into frames and multiplied by the Toeplitz matrix of B_r.
- ``fft``: as ``matmul``, with the convolution by B_r as a product of spectra.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import torch
from scipy.fft import next_fast_len
from torch import Tensor

from torchliner.replay.factors import Factors
from torchliner.replay.levels import gather_rows

FRAME = 256  # receptions of one frame of ``matmul``
STRIP = 64  # emissions of one strip of ``gather``


@dataclass(frozen=True)
class Located:
    """A block of |v| on the velocity grid: index and weights of the stencil's levels, (p, l)."""

    index: Tensor
    weights: list[Tensor]

    def rows(self, table: Tensor, begin: int = 0, end: int | None = None) -> Tensor:
        """Rows of ``table`` (V, C) interpolated at emissions begin .. end - 1, (p, t, C)."""
        index = self.index[:, begin:end]
        weights = [weight[:, begin:end].flatten() for weight in self.weights]
        return gather_rows(table, index.flatten(), weights).reshape(*index.shape, -1)


class Convolution(Protocol):
    """Reply of a block, made for one dtype and device."""

    def numbers(self, length: int) -> int:
        """Held per column for a block of ``length`` emissions, to size batches."""
        ...

    def __call__(self, block: Located, waves: Tensor) -> Tensor:
        """|v| (p, l) and waves (C, l) to replies (C, p, l + K - 1)."""
        ...


class FftConvolution:
    """Products of spectra; the spectra of the factors are kept for each block length."""

    def __init__(self, factors: Factors, dtype: torch.dtype) -> None:
        self.along, self.dtype = factors.along, dtype
        self.across = factors.across.to(dtype)
        self.spectra: dict[int, Tensor] = {}

    def numbers(self, length: int) -> int:
        """Amounts by factor, padded, and their spectra."""
        return 3 * len(self.along) * (length + self.along.shape[1])

    def __call__(self, block: Located, waves: Tensor) -> Tensor:
        """See ``Convolution``."""
        total = waves.shape[1] + self.along.shape[1] - 1
        size = int(next_fast_len(total, real=True))
        if size not in self.spectra:
            kind = torch.complex64 if self.dtype == torch.float32 else torch.complex128
            self.spectra[size] = torch.fft.rfft(self.along, n=size).to(kind)
        by_factor = block.rows(self.across).transpose(1, 2).contiguous()  # (p, r, l)
        replies = []
        for wave in waves:
            spectra = torch.fft.rfft(by_factor * wave, n=size)
            mixed = (spectra * self.spectra[size]).sum(1)
            replies.append(torch.fft.irfft(mixed, n=size)[:, :total])
        return torch.stack(replies)


class MatmulConvolution:
    """Frames times Toeplitz matrices, factor by factor."""

    def __init__(self, factors: Factors, dtype: torch.dtype) -> None:
        self.across, self.taps = factors.across.to(dtype), factors.taps
        # Row i of a frame holds emission i - (K - 1); it reaches reception j with lag
        # j - i + K - 1.
        padded = torch.nn.functional.pad(factors.along.flip(1), (FRAME - 1, FRAME - 1))
        toeplitz = padded.unfold(1, FRAME + self.taps - 1, 1).flip(1)  # (r, FRAME, FRAME + K - 1)
        self.toeplitz = toeplitz.transpose(1, 2).to(dtype).contiguous()

    def numbers(self, length: int) -> int:
        """Amounts by factor, padded, and one factor's frames."""
        frames = -(-(length + self.taps) // FRAME)
        return 3 * len(self.toeplitz) * length + frames * (FRAME + self.taps)

    def __call__(self, block: Located, waves: Tensor) -> Tensor:
        """See ``Convolution``."""
        length, taps = waves.shape[1], self.taps
        total = length + taps - 1
        frames = -(-total // FRAME)
        after = frames * FRAME - length
        by_factor = block.rows(self.across).permute(2, 0, 1)  # (r, p, l)
        replies = []
        for wave in waves:
            padded = torch.nn.functional.pad(by_factor * wave, (taps - 1, after))
            unfolded = padded.unfold(2, FRAME + taps - 1, FRAME)  # (r, p, frames, FRAME + K - 1)
            reply = unfolded[0] @ self.toeplitz[0]
            for frame, matrix in zip(unfolded[1:], self.toeplitz[1:], strict=True):
                reply = reply + frame @ matrix
            replies.append(reply.flatten(1)[:, :total])
        return torch.stack(replies)


class GatherConvolution:
    """Whole kernels gathered, unfolded and multiplied: no low rank, the plain tensor form."""

    def __init__(self, factors: Factors, dtype: torch.dtype) -> None:
        self.kernels = (factors.across @ factors.along).to(dtype)

    def numbers(self, length: int) -> int:
        """A strip's kernels and their padded copies."""
        return 3 * min(length, STRIP) * (self.kernels.shape[1] + STRIP) + 8 * length

    def __call__(self, block: Located, waves: Tensor) -> Tensor:
        """See ``Convolution``."""
        probes, length = block.index.shape
        taps = self.kernels.shape[1]
        replies = self.kernels.new_zeros(len(waves), probes, length + taps - 1)
        for begin in range(0, length, STRIP):
            kernels = block.rows(self.kernels, begin, begin + STRIP)  # (p, rows, K)
            rows = kernels.shape[1]
            # Rows padded to K + rows and read with one column less begin one sample later each.
            skewed = torch.nn.functional.pad(kernels, (0, rows)).flatten(1)[:, :-rows]
            skewed = skewed.reshape(probes, rows, taps + rows - 1)
            reply = waves[:, begin : begin + rows] @ skewed  # (p, C, K + rows - 1)
            replies[:, :, begin : begin + rows + taps - 1] += reply.transpose(0, 1)
        return replies


CONVOLUTIONS: dict[str, Callable[[Factors, torch.dtype], Convolution]] = {
    "fft": FftConvolution,
    "matmul": MatmulConvolution,
    "gather": GatherConvolution,
}
