"""Ways from incident to reflected wave, by the name of the kernel: in time, or a period at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import torch
from torch import Tensor

from torchliner.engine.kernels import KernelTable, build_kernels
from torchliner.engine.levels import VelocityGrid
from torchliner.ir_tdibc_method.newest_tap import NewestTap
from torchliner.ir_tdibc_method.periodic import solve_periodic
from torchliner.ir_tdibc_method.stepping import Motion, Progress, step_in_time
from torchliner.liners.model import LinerModel
from torchliner.liners.response import reflection_of

DAMPING = 1e-2  # of the least squares: error 0.02 and gain 2 in the shipped liners


@dataclass(frozen=True)
class Case:
    """What is to be answered.

    Args:
        model: of the wall.  grid: of speeds.
        sent: incident records as velocities, m/s, float64, (M, n).  repeats: whether they go on.
        rate: Hz.  read: Hz, (F,).  band: Hz, of the kernel.  after: its length, s.
        window: samples of the rms that drives, 1 for |v|.  progress: called with steps done.
    """

    model: LinerModel
    grid: VelocityGrid
    sent: Tensor
    repeats: bool
    rate: float
    read: Tensor
    band: tuple[float, float]
    after: float
    window: int
    progress: Progress | None


@dataclass(frozen=True)
class Answer:
    """What came of it.

    Args:
        motion: of the record that is read, n samples.
        drift: rms change of y against the record before, of its rms, (M,); nan if there is none.
        response: that the way has at the levels and ``Case.read``, complex, (V, F).
        error, gain: largest |H - R| in the band and |H|.
        slope: largest |x| max |dh0/ds|, of the implicit equation.
    """

    motion: Motion
    drift: Tensor
    response: Tensor
    error: float = 0.0
    gain: float = 1.0
    slope: float = 0.0


class Way(Protocol):
    """One of ``WAYS``."""

    def taps(self, after: float, rate: float) -> int:
        """Samples that a record needs at least."""
        ...

    def needed(self, band: tuple[float, float], rate: float) -> tuple[float, float]:
        """Where the liner must be known, Hz."""
        ...

    def answer(self, case: Case) -> Answer:
        """Solve it."""
        ...


@dataclass(frozen=True)
class Stepped:
    """In time, by a causal kernel: the record twice, or a recording once, after silence.

    Args:
        build: as ``build_kernels``.  everywhere: whether it takes R up to half the rate.
    """

    build: Callable[..., KernelTable]
    everywhere: bool

    def taps(self, after: float, rate: float) -> int:
        """See ``Way``."""
        return round(after * rate) + 1

    def needed(self, band: tuple[float, float], rate: float) -> tuple[float, float]:
        """See ``Way``."""
        return (0.0, rate / 2) if self.everywhere else band

    def answer(self, case: Case) -> Answer:
        """See ``Way``."""
        kernels = self.build(case.model, case.rate, velocity_max=case.grid.maximum, band=case.band, after=case.after)
        sent, n = case.sent, case.sent.shape[1]
        drift = torch.full((len(sent),), math.nan, dtype=torch.float64)
        motion = step_in_time(sent.repeat(1, 1 + case.repeats), kernels, case.window, case.progress)
        if case.repeats:
            later, before = (motion.reflected[:, end - n // 2 : end] for end in (2 * n, n))
            drift = (later - before).square().mean(1).sqrt() / later.square().mean(1).sqrt()
        slope = float(sent.abs().max()) * NewestTap(kernels).steepest * case.window**-0.5
        return Answer(motion.last(n), drift, kernels.response(case.read), kernels.error,
                      kernels.gain, slope)  # fmt: skip


class Periodic:
    """A whole period at once, by the model's own response."""

    def taps(self, after: float, rate: float) -> int:
        """See ``Way``."""
        return 2

    def needed(self, band: tuple[float, float], rate: float) -> tuple[float, float]:
        """See ``Way``."""
        return 0.0, rate / 2

    def answer(self, case: Case) -> Answer:
        """See ``Way``.

        Raises:
            ValueError: a recording, which is no period of anything.
        """
        if not case.repeats:
            raise ValueError(
                "kernel 'periodic' needs a signal that repeats, and a recording does not; take 'least-squares'"
            )
        n = case.sent.shape[1]
        frequency = torch.fft.rfftfreq(n, 1 / case.rate, dtype=torch.float64)
        lines = torch.ones(case.grid.levels, len(frequency), dtype=torch.complex128)  # R(0) = 1
        lines[:, 1:] = reflection_of(case.model, frequency[1:], case.grid.speeds[:, None])
        motion = solve_periodic(case.sent, lines, case.grid, case.window, case.progress)
        drift = torch.full((len(case.sent),), math.nan, dtype=torch.float64)
        return Answer(motion, drift, reflection_of(case.model, case.read, case.grid.speeds[:, None]))


FITTED = partial(build_kernels, kind="two-sided", before=0.0, regularisation=DAMPING)
WAYS: dict[str, Way] = {
    "least-squares": Stepped(FITTED, everywhere=False),
    "causal": Stepped(partial(build_kernels, kind="causal"), everywhere=True),
    "periodic": Periodic(),
}
