r"""The one equation of a time step: the newest tap belongs to the speed that it helps to make.

With x the incident and y the reflected wave as velocities, p/(rho c), and m what earlier emissions
have left to the present moment,

    y = m + x h[0; s],   v = x - y,   s = sqrt(past + share v^2),

where s is the speed that drives the kernel of this emission: \|v\| itself (past 0, share 1), or the
rms over the last n samples (share 1/n). The right side is continuous and bounded, so a solution
exists wherever the table's top speed lies above it. It is the only one if
:math:`\sqrt{share}\,|x|\,\max|dh_0/ds| < 1`, for then both sides cross once. Beyond that limit the
slowest solution is taken, and how many there are between the table's levels is counted.
"""

from __future__ import annotations

import numpy as np

from torchliner.engine.kernels import KernelTable
from torchliner.engine.levels import STENCILS

Array = np.ndarray
MOST_STEPS = 100  # bisection alone needs 50
CLOSE = 1e-14  # of the velocities at hand


class NewestTap:
    """Solves it for M columns at once, exactly for the table's own interpolation."""

    def __init__(self, kernels: KernelTable) -> None:
        """Of a table whose first tap is that of time 0."""
        grid = kernels.grid
        nodes = STENCILS[grid.interpolation]
        self.offsets = np.array(nodes)
        self.powers = np.arange(len(nodes))
        # Values at the stencil's levels to coefficients of powers of the place between them.
        self.of_powers = np.linalg.inv(np.power.outer(self.offsets.astype(float), self.powers))
        self.last = grid.levels - 1
        self.lowest, self.highest = -nodes[0], self.last - nodes[-1]
        self.curve = 2 if grid.spacing == "sqrt" else 1
        self.scale = grid.maximum / self.last**self.curve
        self.speeds = grid.speeds.numpy()
        self.taps = kernels.taps[:, 0].numpy()
        self.steepest = float(np.abs(np.diff(self.taps) / np.diff(self.speeds)).max())

    def solve(self, sent: Array, memory: Array, past: Array, share: float) -> tuple[Array, Array, Array, Array]:
        """The speed and what it rests on.

        Args:
            sent, memory, past: x, m and past of the equation, (M,); share: at most 1.
        Returns:
            First level of the stencil and weights of its levels, (M, S); the error of the
            equation, m/s; the number of solutions seen, 0 where the table ends below them.
        """
        free = sent - memory
        made = np.sqrt(past[:, None] + share * (free[:, None] - sent[:, None] * self.taps) ** 2)
        ahead = self.speeds - made
        beyond = ahead >= 0
        roots = (beyond[:, 1:] & ~beyond[:, :-1]).sum(1) + beyond[:, 0]
        cell = np.maximum(beyond.argmax(1) - 1, 0)
        base = cell.clip(self.lowest, self.highest)
        rows = base[:, None] + self.offsets
        along = self.taps[rows] @ self.of_powers.T  # h0 as a polynomial of the place
        low, high = (cell - base).astype(float), (cell - base + 1.0)
        columns = np.arange(len(sent))
        under, over = ahead[columns, cell], ahead[columns, cell + 1]
        place = low + (under / np.where(under == over, 1.0, under - over)).clip(0, 1)
        tiny = CLOSE * (np.abs(free) + np.abs(sent) + np.sqrt(past)) + 1e-300
        for _ in range(MOST_STEPS):
            tap, tap_slope = along[:, -1], 0.0
            for coefficient in along.T[-2::-1]:  # Horner's rule, with the derivative
                tap, tap_slope = tap * place + coefficient, tap_slope * place + tap
            velocity = free - sent * tap
            made = np.sqrt(past + share * velocity**2)
            steps = base + place
            error = self.scale * steps**self.curve - made
            # Where the bracket is as narrow as rounding, its places are all as good.
            done = (np.abs(error) <= tiny) | (high - low <= 4e-16 * self.last)
            if done.all():
                break
            low, high = np.where(error < 0, place, low), np.where(error < 0, high, place)
            slope = self.curve * self.scale * steps ** (self.curve - 1)
            slope = slope + share * velocity * sent * tap_slope / np.maximum(made, 1e-300)
            newton = place - error / np.where(slope == 0, np.inf, slope)
            inside = (newton > low) & (newton < high)
            place = np.where(done, place, np.where(inside, newton, (low + high) / 2))
        grown = np.power.outer(place, self.powers)
        return rows, grown @ self.of_powers, np.abs(error), roots
