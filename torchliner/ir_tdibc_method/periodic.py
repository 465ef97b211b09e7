"""A whole period at once: no kernel, no dropped taps, the model's own response.

Where x repeats after N samples so does, once it has settled, everything else. Then the reflected
wave is the sum over emissions of R(f, s_k) at the lines f of the period, taps before zero included,
and v solves x - y(v) = v as a whole, by damped iteration.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.engine.levels import VelocityGrid, interpolate
from torchliner.ir_tdibc_method.stepping import AboveTable, Motion, Progress

SETTLED = 1e-12  # change of v between iterations, of its largest
FIRST_STEP, SMALLEST_STEP = 0.5, 1 / 16
MOST_ITERATIONS = 400  # with one step; it is halved then
RANK_ERROR = 1e-13  # of the largest singular value of the table of R


class NotSettled(Exception):
    """The iteration ends with ``error`` (m/s) left in a column."""

    def __init__(self, column: int, error: float) -> None:
        super().__init__(column, error)
        self.column, self.error = column, error


def solve_periodic(
    sent: Tensor, response: Tensor, grid: VelocityGrid, window: int = 1,
    progress: Progress | None = None,
) -> Motion:  # fmt: skip
    """The periodic answer to periodic waves.

    Args:
        sent: one period of incident waves as velocities, m/s, float64, (M, N).
        response: R at the levels of the grid and the lines k fs/N, k = 0 .. N/2, complex, (V, L).
        grid: of speeds.  window: samples of the rms that drives, the newest included; 1: |v|.
        progress: called with columns done.
    Raises:
        AboveTable: a speed beyond the grid.  NotSettled: no answer was found.
    """
    found, factors = [], _Factors(response, grid)
    for column, wave in enumerate(sent):
        found.append(_solve(wave, factors, window, column))
        if progress is not None:
            progress(1)
    reflected, errors = zip(*found, strict=True)
    none = torch.zeros(len(sent), dtype=torch.int64)
    return Motion(sent, torch.stack(reflected), torch.tensor(errors, dtype=torch.float64), none)


class _Factors:
    """R[level, f] = sum over r of across[level, r] along[r, f]."""

    def __init__(self, response: Tensor, grid: VelocityGrid) -> None:
        parts = torch.cat([response.real, response.imag], 1)
        left, values, right = torch.linalg.svd(parts, full_matrices=False)
        rank = max(1, int((values > RANK_ERROR * values[0]).sum()))
        self.grid, self.across = grid, left[:, :rank] * values[:rank]
        self.along = torch.complex(*right[:rank].chunk(2, 1))

    def reply(self, sent: Tensor, speed: Tensor) -> Tensor:
        """The reflected wave of one period, (N,)."""
        mixed = interpolate(self.across, *self.grid.locate(speed)).T * sent
        lines = (torch.fft.rfft(mixed) * self.along).sum(0)
        return torch.fft.irfft(lines, n=len(sent))


def _solve(sent: Tensor, factors: _Factors, window: int, column: int) -> tuple[Tensor, float]:
    """Reflected wave of one column and what is left of the equation, m/s."""
    step, size = FIRST_STEP, float(sent.abs().max())
    velocity, error = sent, size
    while step >= SMALLEST_STEP:
        for _ in range(MOST_ITERATIONS):
            speed = _driving(velocity, window)
            # On the way there the speed may leave the table; the answer may not.
            reflected = factors.reply(sent, speed.clamp(max=factors.grid.maximum))
            change = sent - reflected - velocity
            error = float(change.abs().max())
            if error <= SETTLED * size:
                if float(speed.max()) > factors.grid.maximum:
                    raise AboveTable(column)
                return sent - velocity, error
            velocity = velocity + step * change
        step, velocity = step / 2, sent
    raise NotSettled(column, error)


def _driving(velocity: Tensor, window: int) -> Tensor:
    """|v|, or its rms over a window of the periodic record."""
    if window == 1:
        return velocity.abs()
    lap = velocity.square().repeat(-(-window // len(velocity)) + 1)[-len(velocity) - window :]
    sums = torch.cat([lap.new_zeros(1), lap.cumsum(0)])
    ends = torch.arange(len(lap) - len(velocity), len(lap)) + 1
    return ((sums[ends] - sums[ends - window]).clamp(min=0) / window).sqrt()
