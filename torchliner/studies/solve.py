"""The least squares of a law and runs, which speeds Z of a run is made of, and where the knots of curves stand."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.least_squares import with_slopes
from torchliner.studies.laws import Knots, Law, impedance_at
from torchliner.studies.runs import Run

START = (0.02, 0.98)  # of the box: a start on a bound could not leave it
WITHIN = 0.995  # of a plane's weight lies below the last knot
CREST, FINE = 4.0, 60  # times the rms no |v| that matters is larger; steps in sqrt |v| by which the last knot is found


def solve(law: Law, runs: Sequence[Run]) -> tuple[Tensor, Tensor, Tensor]:
    """Least squares by trust-region reflective steps with the exact Jacobian: values, (n,), and ``residuals_of`` them.

    Raises:
        ValueError: fewer data than parameters, a prior counting as one datum each.
        RuntimeError: the least squares do not converge.
    """
    from scipy.optimize import least_squares

    data = sum(run.data for run in runs)
    if data + len(law.prior) < len(law.names):
        raise ValueError(
            f"{data} data of {len(runs)} planes cannot fix {len(law.names)} parameters ({', '.join(law.names)}); add "
            "planes or frequencies, or free fewer"
        )
    width = law.high - law.low
    start = law.low + width * ((law.start - law.low) / width).clamp(*START)

    @functools.lru_cache(maxsize=1)
    def both(place: bytes) -> tuple[Tensor, Tensor]:
        return residuals_of(law, start + width * torch.from_numpy(np.frombuffer(place).copy()), runs)

    def residuals(at: np.ndarray) -> np.ndarray:
        return both(at.tobytes())[0].numpy()

    def jacobian(at: np.ndarray) -> np.ndarray:
        return (both(at.tobytes())[1] * width).numpy()

    how: Any = {"x_scale": "jac", "max_nfev": 1000} | dict.fromkeys(("xtol", "ftol", "gtol"), law.tolerance)
    how["bounds"] = [((end - start) / width).numpy() for end in (law.low, law.high)]
    found = least_squares(residuals, np.zeros(len(width)), jacobian, **how)
    if not found.success:
        raise RuntimeError(
            f"the least squares do not settle in {found.nfev} evaluations ({found.message}); narrow the bounds, state "
            "a larger noise, or free fewer parameters"
        )
    place = np.asarray(found.x, dtype=np.float64)
    values = start + width * torch.from_numpy(place)
    return values, *both(place.tobytes())


def residuals_of(law: Law, values: Tensor, runs: Sequence[Run]) -> tuple[Tensor, Tensor]:
    """Residuals of the data and then of the prior, (m,), and their derivatives in the values, (m, n)."""

    def made(at: Tensor) -> Tensor:
        return torch.cat([run.residuals(z) for run, z in zip(runs, impedances(law, at, runs), strict=True)])

    left, by = with_slopes(made, values)
    return torch.cat([left, law.prior @ values]), torch.cat([by, law.prior])


def curves_at_nodes(law: Law, values: Tensor, runs: Sequence[Run]) -> Iterator[Tensor]:
    """Z at the frequencies and node speeds of each run, (F, K), differentiable; each liner is asked once."""
    every = torch.cat([run.frequency for run in runs]).unique()
    made: dict[Any, Tensor] = {}
    for run in runs:
        key = (id(run.liner), run.plane.mach, run.nodes)
        if key not in made:
            made[key] = law.curve(values, run.in_flow, every, run.nodes.speeds)
        yield made[key][torch.searchsorted(every, run.frequency)]


def impedances(law: Law, values: Tensor, runs: Sequence[Run]) -> list[Tensor]:
    """Z of each run, (F,), differentiable in the values."""
    return [run.impedance(z) for run, z in zip(runs, curves_at_nodes(law, values, runs), strict=True)]


def weights_of(run: Run, values: Tensor, knots: Knots) -> Tensor:
    """Share of each spline of a curve in Z of a plane, (F, n), which sum to 1; ``values``: Z at the nodes, (F, K)."""
    at = values.detach().requires_grad_()
    (slopes,) = torch.autograd.grad(run.impedance(at).real.sum(), at)
    found = (slopes @ knots.splines(run.nodes.speeds).to(slopes)).abs()
    return found / found.sum(-1, keepdim=True)


def knots_for(runs: Sequence[Run]) -> Knots:
    """Up to the |v| below which nearly all of every plane's weight lies."""
    fine, last = Knots(CREST * max(float(run.squares.max()) for run in runs) ** 0.5, FINE), 0
    for run in runs:
        curves = torch.stack([impedance_at(run.in_flow, f, run.nodes.speeds) for f in run.frequency])
        below = (weights_of(run, curves, fine).cumsum(-1) < WITHIN).sum(-1)
        last = max(last, int(below.max()))
    return Knots(float(fine.speeds[last]))
