"""Low-rank factors of a kernel table: few shapes in time, mixed by |v|."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.compiled.threads import one_thread
from torchliner.replay.kernels import KernelTable
from torchliner.replay.levels import VelocityGrid, carries_gradient

# In float64 the table's own rounding (1e-16 over the fit's Tikhonov parameter of 1e-7) keeps its
# singular values above some 1e-11, so that 3e-11 takes nearly full rank; 1e-8 takes 40 of 200.
TOLERANCE = {torch.float32: 5e-6, torch.float64: 3e-11}


@dataclass(frozen=True)
class Factors:
    """h[m; level] = sum over r of across[level, r] along[r, m].

    Args:
        across: (V, r).
        along: (r, K).
        first: index of the first tap.
        grid: velocity levels.
        error: largest change of the response at any frequency and level.
    """

    across: Tensor
    along: Tensor
    first: int
    grid: VelocityGrid
    error: float

    @property
    def rank(self) -> int:
        """r."""
        return self.across.shape[1]

    @property
    def taps(self) -> int:
        """K."""
        return self.along.shape[1]


@one_thread()
def factor_taps(kernels: KernelTable, tolerance: float | None) -> Factors:
    """The smallest rank at which no response moves by more than ``tolerance``.

    Args:
        kernels: V levels, K taps.
        tolerance: of R, absolute; None for the table itself (rank V, factors of one level each).
    """
    if carries_gradient(kernels.taps):
        raise ValueError(
            "the liner carries a gradient, which the low-rank factors of engine 'unfold' would "
            "lose; use engine 'spectral' or 'direct', or detach the parameters"
        )
    taps, grid = kernels.taps, kernels.grid
    assert isinstance(grid, VelocityGrid)  # levels of the data, not nodes of a basis
    if tolerance is None:
        whole = torch.eye(len(taps), dtype=taps.dtype, device=taps.device)
        return Factors(whole, taps, kernels.first, grid, 0.0)
    left, values, right = torch.linalg.svd(taps, full_matrices=False)
    across = left * values
    # |sum_m h e^{-j w m}|^2 <= K sum |h|^2: the rank that surely suffices bounds the search.
    tails = (values.square().flip(0).cumsum(0).flip(0) * taps.shape[1]).sqrt()
    low, high = 0, int((tails > tolerance).sum())
    size = 1 << (4 * taps.shape[1] - 1).bit_length()
    spectra = torch.fft.rfft(right, n=size)
    parts = spectra.real.contiguous(), spectra.imag.contiguous()

    def error(rank: int) -> float:
        if rank == len(values):
            return 0.0
        real, imaginary = (across[:, rank:] @ part[rank:] for part in parts)
        return float((real.square_() + imaginary.square_()).max().sqrt())

    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if error(middle) <= tolerance else (middle, high)
    rank = max(1, high)
    return Factors(
        across[:, :rank].contiguous(), right[:rank].contiguous(), kernels.first, grid,
        error(rank),
    )  # fmt: skip
