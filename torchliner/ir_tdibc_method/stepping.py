"""Time stepping: each emission adds its kernel, that of the speed it makes, to the replies ahead.

"A reference array stores the precomputed response, which is then sequentially processed into a
secondary array to accumulate the boundary condition's future response" (Roncen et al. (2026),
section 3.1): the reference array is the table of kernels over speeds, the secondary one holds the
next block and a kernel's length, so that memory does not grow with the record but for its results.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchliner.engine.kernels import KernelTable
from torchliner.ir_tdibc_method.newest_tap import NewestTap

BLOCK = 512  # steps between shifts of the accumulator
Progress = Callable[[int], None]


class AboveTable(Exception):
    """The speed leaves the table in a column."""

    def __init__(self, column: int) -> None:
        super().__init__(column)
        self.column = column


@dataclass(frozen=True)
class Motion:
    """Waves at the wall as velocities, p/(rho c), m/s.

    Args:
        incident, reflected: x and y, float64, (M, T).
        residual: largest error of the implicit equation over the steps, m/s, (M,).
        several: steps with more than one solution between the table's levels, (M,).
    """

    incident: Tensor
    reflected: Tensor
    residual: Tensor
    several: Tensor

    @property
    def velocity(self) -> Tensor:
        """Into the wall, v = x - y."""
        return self.incident - self.reflected

    def last(self, samples: int) -> Motion:
        """The end of it."""
        x, y = (part[:, -samples:] for part in (self.incident, self.reflected))
        return Motion(x, y, self.residual, self.several)


def step_in_time(sent: Tensor, kernels: KernelTable, window: int = 1, progress: Progress | None = None) -> Motion:
    """What a wall at rest makes of incident waves.

    Args:
        sent: incident waves as velocities, m/s, float64, (M, T).
        kernels: causal, first tap at 0.
        window: samples of the rms that drives the kernels, the newest included; 1: |v| itself.
        progress: called with numbers of steps done.
    Raises:
        AboveTable: a speed beyond the table.
    Source: Roncen et al. (2026), eq. (3.2), with v of incident and reflected wave as in Roncen
        (2025b); the kernel belongs to the emission.
    """
    taps, tap = kernels.taps, NewestTap(kernels)
    columns, total = sent.shape
    length = taps.shape[1]
    ahead = torch.zeros(columns, BLOCK + length, dtype=torch.float64)
    incident, waiting = sent.numpy(), ahead.numpy()
    reflected, power = np.zeros((columns, total)), np.zeros((columns, total))
    past, residual = np.zeros(columns), np.zeros(columns)
    several = np.zeros(columns, dtype=np.int64)
    for k in range(total):
        at = k % BLOCK
        if at == 0 and k:
            ahead[:, :length] = ahead[:, BLOCK:].clone()
            ahead[:, length:] = 0
            if progress is not None:
                progress(BLOCK)
        now = incident[:, k]
        if window > 1:
            past = power[:, max(0, k - window + 1) : k].sum(1) / window
        rows, weights, error, roots = tap.solve(now, waiting[:, at], past, 1 / window)
        if not roots.all():
            raise AboveTable(int((roots == 0).argmax()))
        residual = np.maximum(residual, error)
        several += roots > 1
        ahead[:, at : at + length] += torch.nn.functional.embedding_bag(
            torch.from_numpy(rows), taps, mode="sum",
            per_sample_weights=torch.from_numpy(weights * now[:, None]),
        )  # fmt: skip
        reflected[:, k] = waiting[:, at]
        power[:, k] = (now - reflected[:, k]) ** 2
    found = (torch.from_numpy(part) for part in (reflected, residual, several))
    return Motion(sent, *found)
