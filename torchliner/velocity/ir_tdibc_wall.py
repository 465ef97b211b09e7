r"""A wall that the incident wave alone drives: its velocity follows, step by step or over a whole period at once.

With x the incident and y the reflected wave as velocities, p/(rho c), v = x - y goes into the wall. Each emission has
the kernel of the speed s that drives the wall at that moment,

.. math:: y(t) = \sum_k x(t_k)\, h(t - t_k;\, s_k),\qquad s = \sqrt{past + share\, v^2},

where s is \|v\| (past 0, share 1), or the rms over the last n samples (share 1/n). In time the newest tap h(0; s) makes
each step an equation in s. Its right side is continuous and bounded, so there is a solution wherever the table's top
speed lies above it, and only one if :math:`\sqrt{share}\,|x|\,\max|dh_0/ds| < 1`. Of several the least is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchliner.engine.kernels import STENCILS, KernelTable, VelocityGrid, interpolate

Array = np.ndarray
Progress = Callable[[int], object]

REPORTED = 512  # steps between two calls of ``progress``
MOST_STEPS = 100  # of a root; eight are usual
CLOSE = 1e-14  # of the velocities in the equation
STEPS = (1 / 2, 1 / 4, 1 / 8, 1 / 16)  # of the damped iteration, until one of them settles
MOST_ITERATIONS = 400  # with each
SETTLED = 1e-12  # change of v in an iteration, of its largest
RANK_ERROR = 1e-13  # of the largest singular value of a table of R


class Reply(NamedTuple):
    """What a wall makes of incident waves; nan where |v| leaves the table.

    Args:
        reflected: y, m/s, float64, (M, n).
        residual: largest error of the equation, m/s, (M,).
        several: steps with more than one solution between the levels of the table, (M,).
        drift: rms change of y against the record before, of its rms, over half a record, (M,); nan if it is sent once.
    """

    reflected: Tensor
    residual: Tensor
    several: Tensor
    drift: Tensor


def step_in_time(
    sent: Tensor, kernels: KernelTable, window: int = 1, *, repeats: bool = False, progress: Progress | None = None
) -> Reply:
    """The reply of a wall at rest, one sample after another.

    Args:
        sent: incident waves as velocities, m/s, float64, (M, n).
        kernels: causal, first tap at 0.
        window: samples of the rms that drives the kernels, the newest included; 1: |v| itself.
        repeats: send the record twice and give the reply to the second.
        progress: called with numbers of steps done.
    Source: Roncen et al. (2026), eq. (3.2) and section 3.1: "a reference array stores the precomputed response, which
        is then sequentially processed into a secondary array to accumulate the boundary condition's future response";
        v from incident and reflected wave as in Roncen (2025b).
    """
    n, tap, length = sent.shape[1], NewestTap(kernels), kernels.taps.shape[1]
    sent = sent.repeat(1, 1 + repeats)
    columns, total = sent.shape
    reflected = torch.zeros(columns, total + length, dtype=torch.float64)  # complete up to the present step
    x, y, power = sent.numpy(), reflected.numpy(), np.zeros((columns, total))
    residual, several = np.zeros(columns), np.zeros(columns, dtype=np.int64)
    for k in range(total):
        past = power[:, max(0, k - window + 1) : k].sum(1) / window
        levels, weights, error, roots = tap.solve(x[:, k], y[:, k], past, 1 / window)
        reflected[:, k : k + length] += torch.nn.functional.embedding_bag(
            torch.from_numpy(levels), kernels.taps, mode="sum", per_sample_weights=torch.from_numpy(weights)
        )
        power[:, k] = (x[:, k] - y[:, k]) ** 2
        residual = np.maximum(residual, error)
        several += roots > 1
        if progress is not None and k % REPORTED == REPORTED - 1:
            progress(REPORTED)
    drift = torch.full((columns,), torch.nan, dtype=torch.float64)
    if repeats:
        later, before = (reflected[:, end - n // 2 : end] for end in (2 * n, n))
        drift = (later - before).square().mean(1).sqrt() / later.square().mean(1).sqrt()
    return Reply(reflected[:, total - n : total], torch.from_numpy(residual), torch.from_numpy(several), drift)


class NewestTap:
    """The equation of one step for M columns, exact for the interpolation of a table whose first tap is at 0."""

    def __init__(self, kernels: KernelTable) -> None:
        grid = kernels.grid
        self.power = 2 if grid.spacing == "sqrt" else 1
        self.scale = grid.maximum / (grid.levels - 1) ** self.power
        self.speeds, self.taps = grid.speeds.numpy(), kernels.taps[:, 0].numpy()
        self.nodes = np.array(STENCILS[grid.interpolation])
        self.base = np.arange(grid.levels - 1).clip(-self.nodes[0], grid.levels - 1 - self.nodes[-1])
        # Of the place between two levels, counted in levels from the base of their stencil: weights of the stencil, and
        # the newest tap itself, as polynomials.
        self.weights = np.linalg.inv(np.vander(self.nodes.astype(float), increasing=True))
        self.polynomials = self.weights @ self.taps[self.base + self.nodes[:, None]]

    def solve(self, sent: Array, memory: Array, past: Array, share: float) -> tuple[Array, Array, Array, Array]:
        """The kernel of the least s: levels of its stencil and their weights times x, (M, S), nan where the table ends
        below s; error of the equation, m/s, and number of solutions seen, (M,).

        Args:
            sent: x, m/s, (M,).  memory: what earlier emissions have left of y, m/s, (M,).
            past, share: see the head of this file.
        """
        free = sent - memory
        ahead = self.speeds - np.sqrt(past[:, None] + share * (free[:, None] - sent[:, None] * self.taps) ** 2)
        beyond = ahead >= 0
        roots = (beyond[:, 1:] & ~beyond[:, :-1]).sum(1) + beyond[:, 0]
        cell = np.maximum(beyond.argmax(1) - 1, 0)
        polynomial, base, columns = self.polynomials[:, cell], self.base[cell], np.arange(len(sent))
        limit = CLOSE * (np.abs(free) + np.abs(sent) + np.sqrt(past)) + 1e-300
        ends, before = np.stack([cell, cell + 1]).astype(float), np.full(len(sent), -1)
        values, place, done = ahead[columns, ends.astype(int)], ends[0], np.zeros(len(sent), bool)
        with np.errstate(invalid="ignore", divide="ignore"):  # columns without a solution
            for _ in range(MOST_STEPS):  # rule of Illinois, from one end below 0 and one of at least 0
                place = np.where(done, place, ends[0] - values[0] * (ends[1] - ends[0]) / (values[1] - values[0]))
                tap = polynomial[-1]
                for coefficient in polynomial[-2::-1]:
                    tap = tap * (place - base) + coefficient
                value = self.scale * place**self.power - np.sqrt(past + share * (free - sent * tap) ** 2)
                done = np.abs(value) <= limit
                if (done | np.isnan(value)).all():
                    break
                side = (value >= 0).astype(int)
                # Of an end that stays a second time the value is halved, so that the other end moves, too.
                values[1 - side, columns] *= np.where(side == before, 0.5, 1.0)
                ends[side, columns], values[side, columns], before = place, value, side
        weights = np.vander(place - base, len(self.nodes), increasing=True) @ self.weights
        return base[:, None] + self.nodes, np.where(roots > 0, weights.T * sent, np.nan).T, np.abs(value), roots


def settle_period(
    sent: Tensor, response: Tensor, grid: VelocityGrid, window: int = 1, progress: Progress | None = None
) -> Reply:
    """The periodic reply to periodic waves: no kernel, no dropped taps, the response of the model itself.

    y is the sum over emissions of R(f, s_k) at the lines of the period; x - y(v) = v is solved by damped iteration.
    Where that does not settle the residual is large.

    Args:
        sent: one period of incident waves as velocities, m/s, float64, (M, n).
        response: R at the levels of the grid and the lines k fs/n, k = 0 .. n/2, complex, (V, L).
        grid, window, progress: as of ``step_in_time``; progress counts records.
    """
    left, values, right = torch.linalg.svd(torch.cat([response.real, response.imag], 1), full_matrices=False)
    rank = max(1, int((values > RANK_ERROR * values[0]).sum()))
    across, along = left[:, :rank] * values[:rank], torch.complex(*right[:rank].chunk(2, 1))
    reflected, residual = torch.full_like(sent, torch.nan), torch.zeros(len(sent), dtype=torch.float64)

    def driving(velocity: Tensor) -> Tensor:
        """rms over each sample and those before it, ``window`` together."""
        again = torch.cat([velocity, velocity])[len(velocity) - window + 1 :]
        return again.square().unfold(0, window, 1).mean(1).sqrt()

    for i, wave in enumerate(sent):
        for step in STEPS:
            velocity = wave
            for _ in range(MOST_ITERATIONS):
                # On the way to the solution the speed may leave the table.
                located = grid.locate(driving(velocity).clamp(max=grid.maximum))
                mixed = torch.fft.rfft(interpolate(across, *located).T * wave)
                change = wave - torch.fft.irfft((mixed * along).sum(0), n=len(wave)) - velocity
                residual[i] = change.abs().max()
                if residual[i] <= SETTLED * wave.abs().max():
                    break
                velocity = velocity + step * change
            else:
                continue
            break
        if float(driving(velocity).max()) <= grid.maximum:
            reflected[i] = wave - velocity
        if progress is not None:
            progress(1)
    return Reply(reflected, residual, torch.zeros(len(sent), dtype=torch.int64), torch.full_like(residual, torch.nan))
