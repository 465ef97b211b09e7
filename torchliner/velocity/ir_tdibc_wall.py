r"""A wall that the incident wave alone drives: its velocity follows step by step.

With x the incident and y the reflected wave as velocities, p/(rho c), v = x - y goes into the wall. Each emission has
the kernel of the speed \|v\| at that moment,

.. math:: y(t) = \sum_k x(t_k)\, h(t - t_k;\, |v(t_k)|).

The newest tap makes each step an equation in s = \|v\|, with m what earlier emissions have left of y:
:math:`s = |x (1 - h_0(s)) - m|`. Its right side is continuous and bounded, so there is a solution wherever the table
reaches beyond it, and only one if :math:`|x| \max|dh_0/ds| < 1`. Of several the least is taken.
"""

import numpy as np
import torch
from torch import Tensor

from torchliner.engine.kernels import STENCILS, KernelTable
from torchliner.liners.model import LinerModel, reflection_of

Array = np.ndarray

MOST_STEPS = 100  # of a root; eight are usual
CLOSE = 1e-14  # of the velocities in the equation
PLACES = 2001  # speeds between which a fixed point is looked for, closer towards rest


def step_in_time(sent: Tensor, kernels: KernelTable) -> Tensor:
    """The reply y of a wall at rest, m/s, (L, n), one sample after another; nan where |v| leaves the table.

    Args:
        sent: incident waves as velocities, m/s, float64, (L, n).
        kernels: causal, first tap at 0.
    Source: Roncen et al. (2026), eq. (3.2) and section 3.1: "a reference array stores the precomputed response, which
        is then sequentially processed into a secondary array to accumulate the boundary condition's future response";
        v from incident and reflected wave as in Roncen (2025b).
    """
    (waves, n), tap, length = sent.shape, NewestTap(kernels), kernels.taps.shape[1]
    reflected = torch.zeros(waves, n + length, dtype=torch.float64)  # complete up to the present step
    x, y = sent.numpy(), reflected.numpy()
    for k in range(n):
        levels, weights = map(torch.from_numpy, tap.solve(x[:, k], y[:, k]))
        reflected[:, k : k + length] += torch.nn.functional.embedding_bag(
            levels, kernels.taps, mode="sum", per_sample_weights=weights
        )
    return reflected[:, :n]


class NewestTap:
    """The equation of one step for L waves, exact for the interpolation of a table whose first tap is at 0."""

    def __init__(self, kernels: KernelTable) -> None:
        grid = kernels.grid
        self.power = 2 if grid.spacing == "sqrt" else 1
        self.scale = grid.maximum / (grid.levels - 1) ** self.power
        self.speeds, self.taps = grid.speeds.numpy(), kernels.taps[:, 0].numpy()
        self.nodes = np.array(STENCILS[grid.interpolation])
        self.base = np.arange(grid.levels - 1).clip(-self.nodes[0], grid.levels - 1 - self.nodes[-1])
        # Weights of the stencil, and the newest tap itself, as polynomials of the place between two levels, which is
        # counted in levels from the base of the stencil.
        self.weights = np.linalg.inv(np.vander(self.nodes.astype(float), increasing=True))
        self.polynomials = self.weights @ self.taps[self.base + self.nodes[:, None]]

    def solve(self, sent: Array, memory: Array) -> tuple[Array, Array]:
        """The kernel of the least s, for x and for what earlier emissions left of y, m/s, (L,): levels of the stencil
        and their weights times x, (L, S), nan where the table ends below s."""
        free = sent - memory
        ahead = self.speeds - np.abs(free[:, None] - sent[:, None] * self.taps)
        beyond = ahead >= 0
        cell = np.maximum(beyond.argmax(1) - 1, 0)
        polynomial, base, waves = self.polynomials[:, cell], self.base[cell], np.arange(len(sent))
        limit = CLOSE * (np.abs(free) + np.abs(sent)) + 1e-300
        ends, before = np.stack([cell, cell + 1]).astype(float), np.full(len(sent), -1)
        values, place, done = ahead[waves, ends.astype(int)], ends[0], np.zeros(len(sent), bool)
        with np.errstate(invalid="ignore", divide="ignore"):  # waves without a solution
            for _ in range(MOST_STEPS):  # rule of Illinois, from one end below 0 and one of at least 0
                place = np.where(done, place, ends[0] - values[0] * (ends[1] - ends[0]) / (values[1] - values[0]))
                tap = polynomial[-1]
                for coefficient in polynomial[-2::-1]:
                    tap = tap * (place - base) + coefficient
                value = self.scale * place**self.power - np.abs(free - sent * tap)
                done = np.abs(value) <= limit
                if (done | np.isnan(value)).all():
                    break
                side = (value >= 0).astype(int)
                # Of an end that stays a second time the value is halved, so that the other end moves, too.
                values[1 - side, waves] *= np.where(side == before, 0.5, 1.0)
                ends[side, waves], values[side, waves], before = place, value, side
        weights = np.vander(place - base, len(self.nodes), increasing=True) @ self.weights
        return base[:, None] + self.nodes, np.where(beyond.any(1), weights.T * sent, np.nan).T


def fixed_speed(liner: LinerModel, frequency: Tensor, power: Tensor, highest: float) -> float:
    r"""The least rms speed, m/s, that wave and wall agree on in the frequency domain; nan if none is up to ``highest``.

    With p_i the mean square of the incident wave (as a velocity, m2/s2, (F,)) at its frequencies f_i (Hz, (F,)),
    :math:`s^2 = \sum_i p_i |1 - R(f_i, s)|^2`, which lies between 0 and :math:`4 \sum p_i` for passive walls.
    """
    from scipy.optimize import brentq  # takes a while to import

    def excess(speed: Tensor) -> Tensor:
        made = power[:, None] * (1 - reflection_of(liner, frequency[:, None], speed)).abs() ** 2
        return speed - made.sum(0).sqrt()

    top = min(highest, 2.5 * float(power.sum().sqrt()))
    places = top * torch.linspace(0, 1, PLACES, dtype=torch.float64) ** 2
    beyond = excess(places) > 0
    if not bool(beyond.any()):
        return float("nan")
    first = int(beyond.int().argmax())
    low, high = places[[first - 1, first]].tolist()
    return float(brentq(lambda s: float(excess(places.new_tensor([s]))), low, high, xtol=1e-14))
