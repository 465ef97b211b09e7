r"""A wall that the incident wave alone drives: its velocity follows step by step, or over a whole period at once.

With x the incident and y the reflected wave as velocities, p/(rho c), v = x - y goes into the wall. Each emission has
the kernel of the speed \|v\| at that moment,

.. math:: y(t) = \sum_k x(t_k)\, h(t - t_k;\, |v(t_k)|).

In time the newest tap makes each step an equation in s = \|v\|, with m what earlier emissions have left of y:
:math:`s = |x (1 - h_0(s)) - m|`. Its right side is continuous and bounded, so there is a solution wherever the table
reaches beyond it, and only one if :math:`|x| \max|dh_0/ds| < 1`. Of several the least is taken.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchliner.conversions import impedance_from_reflection
from torchliner.engine.kernels import STENCILS, KernelTable, VelocityGrid, interpolate
from torchliner.liners.model import LinerModel, reflection_of

Array = np.ndarray
Progress = Callable[[int], object]

REPORTED = 512  # steps between two calls of ``progress``
MOST_STEPS = 100  # of a root; eight are usual
CLOSE = 1e-14  # of the velocities in the equation
DAMPINGS = (1 / 2, 1 / 4, 1 / 8, 1 / 16)  # of the iteration over a period, until one of them settles
MOST_ITERATIONS = 400  # with each
SETTLED = 1e-12  # change of v in an iteration, of its largest
RANK_ERROR = 1e-13  # of the largest singular value of a table of R
PLACES = 2001  # speeds between which fixed points are looked for, closer towards rest; two in one gap are lost
DRIFTS, UNSTEADY = 1e-3, 5e-2  # drift above which there is a warning, and an error
KERNEL_PART = 0.02  # of |Z + 1|: what a kernel may change without a warning


class Reply(NamedTuple):
    """What a wall makes of L incident waves.

    Args:
        reflected: y, m/s, float64, (L, n); nan where |v| leaves the table.
        residual: largest error of the equation, m/s, (L,).
        several: steps with more than one solution, (L,).
        drift: rms change of y against the record before, of its rms, over half a record, (L,); nan if it is sent once.
    """

    reflected: Tensor
    residual: Tensor
    several: Tensor
    drift: Tensor


def step_in_time(
    sent: Tensor, kernels: KernelTable, *, repeats: bool = False, progress: Progress | None = None
) -> Reply:
    """The reply of a wall at rest, one sample after another.

    Args:
        sent: incident waves as velocities, m/s, float64, (L, n).
        kernels: causal, first tap at 0.
        repeats: send the record twice and give the reply to the second.
        progress: called with numbers of steps done.
    Source: Roncen et al. (2026), eq. (3.2) and section 3.1: "a reference array stores the precomputed response, which
        is then sequentially processed into a secondary array to accumulate the boundary condition's future response";
        v from incident and reflected wave as in Roncen (2025b).
    """
    n, tap, length = sent.shape[1], NewestTap(kernels), kernels.taps.shape[1]
    sent = sent.repeat(1, 1 + repeats)
    waves, total = sent.shape
    reflected = torch.zeros(waves, total + length, dtype=torch.float64)  # complete up to the present step
    x, y = sent.numpy(), reflected.numpy()
    residual, several = np.zeros(waves), np.zeros(waves, dtype=np.int64)
    for k in range(total):
        levels, weights, error, roots = tap.solve(x[:, k], y[:, k])
        reflected[:, k : k + length] += torch.nn.functional.embedding_bag(
            torch.from_numpy(levels), kernels.taps, mode="sum", per_sample_weights=torch.from_numpy(weights)
        )
        residual = np.maximum(residual, error)
        several += roots > 1
        if progress is not None and k % REPORTED == REPORTED - 1:
            progress(REPORTED)
    drift = torch.full((waves,), torch.nan, dtype=torch.float64)
    if repeats:
        later, before = (reflected[:, end - n // 2 : end] for end in (2 * n, n))
        drift = (later - before).square().mean(1).sqrt() / later.square().mean(1).sqrt()
    return Reply(reflected[:, total - n : total], torch.from_numpy(residual), torch.from_numpy(several), drift)


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

    def solve(self, sent: Array, memory: Array) -> tuple[Array, Array, Array, Array]:
        """The kernel of the least s, for x and for what earlier emissions left of y, m/s, (L,).

        Returns:
            Levels of the stencil and their weights times x, (L, S), nan where the table ends below s; error of the
            equation, m/s, and number of solutions seen between the levels, (L,).
        """
        free = sent - memory
        ahead = self.speeds - np.abs(free[:, None] - sent[:, None] * self.taps)
        beyond = ahead >= 0
        roots = (beyond[:, 1:] & ~beyond[:, :-1]).sum(1) + beyond[:, 0]
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
        return base[:, None] + self.nodes, np.where(roots > 0, weights.T * sent, np.nan).T, np.abs(value), roots


def settle_period(sent: Tensor, response: Tensor, grid: VelocityGrid, progress: Progress | None = None) -> Reply:
    """The periodic reply to periodic waves: no kernel, no dropped taps, the response of the model itself.

    y is the sum over emissions of R(f, |v_k|) at the lines of the period; x - y(v) = v is solved by damped iteration.
    Where that does not settle the residual is large.

    Args:
        sent: one period of incident waves as velocities, m/s, float64, (L, n).
        response: R at the levels of the grid and the lines k fs/n, k = 0 .. n/2, complex, (V, n/2 + 1).
        grid: levels of |v|.  progress: called with numbers of waves done.
    """
    left, values, right = torch.linalg.svd(torch.cat([response.real, response.imag], 1), full_matrices=False)
    rank = max(1, int((values > RANK_ERROR * values[0]).sum()))
    across, along = left[:, :rank] * values[:rank], torch.complex(*right[:rank].chunk(2, 1))
    reflected, residual = torch.full_like(sent, torch.nan), torch.zeros(len(sent), dtype=torch.float64)
    for i, wave in enumerate(sent):
        for damping in DAMPINGS:
            velocity = wave
            for _ in range(MOST_ITERATIONS):
                # On the way to the solution the speed may leave the table.
                located = grid.locate(velocity.abs().clamp(max=grid.maximum))
                mixed = torch.fft.rfft(interpolate(across, *located).T * wave)
                change = wave - torch.fft.irfft((mixed * along).sum(0), n=len(wave)) - velocity
                residual[i] = change.abs().max()
                if residual[i] <= SETTLED * wave.abs().max():
                    break
                velocity = velocity + damping * change
            else:
                continue
            break
        if float(velocity.abs().max()) <= grid.maximum:
            reflected[i] = wave - velocity
        if progress is not None:
            progress(1)
    return Reply(reflected, residual, torch.zeros(len(sent), dtype=torch.int64), torch.full_like(residual, torch.nan))


class FixedPoint(NamedTuple):
    """Z(f), complex128, (F,), at an rms |v|, m/s, that is just what the incident wave then drives."""

    speed: float
    impedance: Tensor


@dataclass(frozen=True)
class LevelCurve:
    """Impedance of a wall that is driven by incident waves of L levels.

    Args:
        level: of the incident wave, dB re 20 uPa rms, (L,).
        frequency: Hz, (F,).
        reflection: Y/X, complex128, (L, F).
        rms_speed, peak_speed: of v in the record that is read, m/s, (L,).
        residual: largest error of the implicit equation, of the largest |x|, (L,).
        several: steps at which that equation has more than one solution, (L,).
        drift: rms change of y against the record before, of its rms, (L,); nan with kernel ``periodic``.
        reflected_energy: mean square of y over that of x, (L,).
        fixed_points: of the frequency domain with one rms speed, by level; usually one.
        frozen: Z of the kernel less Z of the model, where |v| stands still at its rms, (L, F).
        choices: ``kernel``, ``kernel_band`` (Hz), ``kernel_error`` and ``kernel_gain``, largest |H - R| in the band and
            largest |H|; ``incident``, ``liner``, ``sampling_rate`` (Hz) and ``duration`` (s) of the record.
    """

    level: Tensor
    frequency: Tensor
    reflection: Tensor
    rms_speed: Tensor
    peak_speed: Tensor
    residual: Tensor
    several: Tensor
    drift: Tensor
    reflected_energy: Tensor
    fixed_points: tuple[tuple[FixedPoint, ...], ...]
    frozen: Tensor
    choices: dict[str, Any]

    @property
    def impedance(self) -> Tensor:
        """Z, complex128, (L, F)."""
        return impedance_from_reflection(self.reflection)

    def warnings(self) -> Iterator[str]:
        """What is doubtful.

        Raises:
            ValueError: a level that has no steady state.
        """
        chosen, levels = self.choices, self.level.tolist()
        for level, drift in zip(levels, self.drift.tolist(), strict=True):
            still = f"at {level:g} dB y still changes by {drift:.2g} of its rms from one record"
            if drift > UNSTEADY:
                raise ValueError(
                    f"{still} of {1e3 * chosen['duration']:.3g} ms to the next: no steady state; give a longer "
                    f"duration, or a kernel of lower gain than {chosen['kernel_gain']:.3g}"
                )
            if drift > DRIFTS:
                yield f"{still} to the next; a longer duration settles it"
        share = self.frozen.abs() / (self.impedance - self.frozen + 1).abs()
        i, j = divmod(int(share.argmax()), share.shape[1])
        if share[i, j] > KERNEL_PART:
            yield (
                f"kernel {chosen['kernel']!r} is not the liner's response: with |v| frozen at the rms of {levels[i]:g} "
                f"dB it moves Z at {self.frequency[j]:g} Hz by {complex(self.frozen[i, j]):.3f}; see the kernel "
                "'periodic'"
            )
        for level, several in zip(levels, self.several.tolist(), strict=True):
            if several:
                yield f"at {level:g} dB {several} steps have more than one |v|; the least was taken"


def fixed_points(liner: LinerModel, frequency: Tensor, power: Tensor, highest: float) -> list[float]:
    r"""All rms speeds (m/s) up to ``highest`` that the wave and the wall agree on in the frequency domain.

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
    ends = [(float(places[i]), float(places[i + 1])) for i in (beyond[1:] != beyond[:-1]).nonzero().flatten()]
    return [brentq(lambda s: float(excess(torch.tensor([s], dtype=torch.float64))), *each, xtol=1e-14) for each in ends]
