"""What a curve is held to at one frequency, and the curve that answers it best.

Least squares on what runs are held to, with a Gaussian prior in the parameters of ``PriorShape``:
the logarithm of the ratio to the prior shape walks at random over |v|, with the standard deviation
``freedom`` from rest to the last knot.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchliner.conversions import admittance_from_reflection, reflection_from_impedance
from torchliner.engine.nodes import Nodes
from torchliner.identification.runs import Run
from torchliner.identification.speed_curve import Knots, PriorShape

LEVEL = 1.0  # standard deviation of the mean logarithm of the ratio to the prior shape
BOUNDS = 6.0  # of all parameters: factors of 1/400 to 400


@dataclass(frozen=True, eq=False)
class Datum:
    """One plane at one frequency.

    Args:
        offset: what its liner's Z at rest has more than that of the curve's prior shape.
    """

    run: Run
    index: int
    offset: complex = 0j

    @functools.cached_property
    def speeds(self) -> Tensor:
        """At which R is asked for, m/s, (K,)."""
        return self.run.weights.nodes.speeds

    def impedance(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """Z of the plane and its slopes in the curve's Z at node speeds, (K,), from those."""
        weights = self.run.weights
        reflection = weights.weights @ reflection_from_impedance(values)
        found = 1 / (admittance_from_reflection(reflection) @ weights.share)
        turned = weights.share * 2 / (1 + reflection) ** 2
        return found, found**2 * (turned @ weights.weights) * 2 / (1 + values) ** 2

    def seen(self, values: Tensor, knots: Knots) -> Tensor:
        """Share of each spline of a curve in Z of the plane, (n,), which sum to 1."""
        slopes = self.impedance(values)[1]
        found = (slopes @ knots.splines(self.speeds).to(slopes)).abs()
        return found / found.sum()

    def misses(self, impedance: Tensor) -> tuple[Tensor, Tensor]:
        """What is left over its noise, (m,), and its slopes in Re Z and Im Z, (m, 2)."""
        noise = self.run.noise[self.index]
        size = torch.stack([noise.real, noise.imag])[: 1 + self.run.has_phase]

        def left(parts: Tensor) -> Tensor:
            whole = torch.complex(parts[0], parts[1]).expand(len(self.run.wanted))
            away = self.run.misses(whole)[self.index]
            return torch.stack([away.real, away.imag])[: len(size)] / size

        parts = torch.stack([impedance.real, impedance.imag])
        if self.run.ratio is None:
            return left(parts), torch.diag(1 / size)
        slopes: Tensor = torch.autograd.functional.jacobian(left, parts)  # type: ignore[no-untyped-call]
        return left(parts), slopes


@dataclass(frozen=True, eq=False)
class CurveProblem:
    """Least squares of one frequency.

    Args:
        data: what the curve is held to.  knots, shape: of it.  frequency: Hz.
        freedom: of the walk over |v|.
    """

    data: Sequence[Datum]
    knots: Knots
    shape: PriorShape
    frequency: float
    freedom: float

    @functools.cached_property
    def prior(self) -> Tensor:
        """Residuals of the prior are these times the parameters, (r, n)."""
        blocks = []
        for size in (len(self.shape.resistance_steps), len(self.shape.reactance_steps)):
            walk = torch.eye(size, dtype=torch.float64).diff(dim=0)
            mean = torch.full((1, size), 1 / (size * LEVEL), dtype=torch.float64)
            blocks.append(torch.cat([walk * (size - 1) ** 0.5 / self.freedom, mean]))
        rest = torch.diag(1 / torch.tensor(self.shape.rest, dtype=torch.float64))
        return torch.block_diag(rest, *blocks)

    @functools.cached_property
    def rising(self) -> dict[Nodes, tuple[Tensor, Tensor]]:
        """Of the knots, at the speeds of the nodes."""
        return {nodes: self.knots.rising(nodes.speeds) for nodes in {datum.run.weights.nodes for datum in self.data}}

    def slopes(self, parameters: Tensor) -> tuple[Tensor, Tensor]:
        """Residuals of the data over their noise, (m,), and their Jacobian, (m, n)."""
        moved = {
            nodes: (self.shape.curve(parameters, each), self.shape.slopes(parameters, each))
            for nodes, each in self.rising.items()
        }
        rows, jacobian = [], []
        for datum in self.data:
            values, by_parameter = moved[datum.run.weights.nodes]
            found, by_node = datum.impedance(values + datum.offset)
            left, by_part = datum.misses(found)
            along = by_node @ by_parameter
            rows.append(left)
            jacobian.append(by_part @ torch.stack([along.real, along.imag]))
        return torch.cat(rows), torch.cat(jacobian)

    def solve(self) -> Tensor:
        """Parameters that fit best, (n,), within ``BOUNDS``; the search starts at the prior shape.

        Raises:
            RuntimeError: it does not converge.
        """
        from scipy.optimize import least_squares

        prior = self.prior.numpy()

        @functools.lru_cache(maxsize=1)
        def slopes(place: bytes) -> tuple[np.ndarray, np.ndarray]:
            left, by = self.slopes(torch.from_numpy(np.frombuffer(place).copy()))
            return left.numpy(), by.numpy()

        def residuals(at: np.ndarray) -> np.ndarray:
            return np.concatenate([slopes(at.tobytes())[0], prior @ at])

        def jacobian(at: np.ndarray) -> np.ndarray:
            return np.concatenate([slopes(at.tobytes())[1], prior])

        found = least_squares(residuals, np.zeros(self.shape.count), jacobian,
                              bounds=(-BOUNDS, BOUNDS), x_scale="jac", xtol=1e-9, ftol=1e-9,
                              gtol=1e-9, max_nfev=1000)  # fmt: skip
        if not found.success:
            raise RuntimeError(
                f"the curve at {self.frequency:g} Hz does not settle in {found.nfev} evaluations "
                f"({found.message}); state a larger noise or a smaller freedom"
            )
        return torch.from_numpy(np.asarray(found.x, dtype=np.float64))
