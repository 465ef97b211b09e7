r"""Curves Z(|v|) that are monotone and passive whatever their parameters are.

In :math:`s = \sqrt{|v|}` cubic B-splines with equal steps, up to a speed below which nearly all of
the data lie; sums of the last of them, :math:`I_j = \sum_{k \ge j} B_k`, rise from 0 to 1, so that

.. math:: R = R_0 e^{q_0} + \sum_j \delta_j e^{q_j} I_j, \qquad
          X = X_0 + x_0 \mp \sum_j \delta'_j e^{q'_j} I_j

is monotone, and R above 0, for all q: no bound has to hold them there. The steps :math:`\delta` are
those of a prior shape, so that q = 0 is that shape and equal q the same shape times a factor. At
rest both have no slope in s; beyond the last knot R goes on along its tangent in |v|, X stays.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.liners.model import LinerModel
from torchliner.liners.response import complex_tensor
from torchliner.names import CURVE_SHAPES, REACTANCES

ORDER = 3  # cubic
PARTS = 18  # steps in sqrt |v|, from rest to the last knot
FLOOR = 0.1  # of the mean step: the least step of a prior shape, so that a factor can act on it
LEAST_RESISTANCE = 0.01  # at rest, of a prior shape without losses
SMOOTH = 1.0 - 0.5j  # change of Z from rest to the largest |v|, of the prior shape "smooth"
REST = (1.0, 0.5)  # spread of the logarithm of R, and of X, at rest, where none is stated
SIGNS = dict(zip(REACTANCES, (-1.0, 1.0), strict=True))


@dataclass(frozen=True)
class Knots:
    """Where the splines of all curves of a fit stand.

    Args:
        top: m/s, the last knot.
        parts: equal steps in sqrt |v|.
    """

    top: float
    parts: int = PARTS

    @functools.cached_property
    def _places(self) -> np.ndarray:
        inner = np.linspace(0.0, self.top**0.5, self.parts + 1)
        return np.pad(inner, ORDER, mode="edge")

    @property
    def speeds(self) -> Tensor:
        """|v| about which each B-spline lies, m/s, (n,)."""
        knots = self._places
        each = [knots[i + 1 : i + 1 + ORDER].mean() for i in range(self.parts + ORDER)]
        return torch.tensor(each, dtype=torch.float64).square()

    def splines(self, speed: Tensor) -> Tensor:
        """B-splines, (V, n), constant beyond the last knot."""
        from scipy.interpolate import BSpline

        place = np.sqrt(speed.numpy().clip(0, self.top))
        matrix = BSpline.design_matrix(place.clip(0, self._places[-1]), self._places, ORDER)
        return torch.from_numpy(matrix.toarray())

    def rising(self, speed: Tensor) -> tuple[Tensor, Tensor]:
        """I_j of R, (V, m), and of X, (V, m - 1); beyond the last knot along the tangent in |v|,
        and constant. What would give a slope in s at rest, or to X at the last knot, is left out.
        """
        sums = self.splines(speed).flip(-1).cumsum(-1).flip(-1)
        beyond = (speed - self.top).clamp(min=0)
        # Of the sums only the last has a slope there: 3/h in s, by ds = dv/(2 s) in |v|.
        end = self.top**0.5
        tangent = sums[:, 2:].clone()
        tangent[:, -1] += beyond * ORDER * self.parts / (2 * end**2)
        return tangent, sums[:, 2:-1]


@dataclass(frozen=True, eq=False)
class PriorShape:
    """Z at rest and steps of both parts, all above 0.

    Args:
        rest: standard deviations of the logarithm of R and of X at rest.
    """

    resistance: float
    reactance: float
    resistance_steps: Tensor
    reactance_steps: Tensor
    sign: float
    rest: tuple[float, float]

    @property
    def count(self) -> int:
        """Parameters of a curve: q_0, x_0, q, q'."""
        return 2 + len(self.resistance_steps) + len(self.reactance_steps)

    def split(self, parameters: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """q_0, x_0, q, q'."""
        sizes = [1, 1, len(self.resistance_steps), len(self.reactance_steps)]
        first, second, third, fourth = parameters.split(sizes, -1)
        return first, second, third, fourth

    def curve(self, parameters: Tensor, rising: tuple[Tensor, Tensor]) -> Tensor:
        """Z, (..., V), from parameters (..., count) and ``Knots.rising``."""
        q, x, up, down = self.split(parameters)
        steps = self.resistance_steps * up.exp(), self.reactance_steps * down.exp()
        first, second = (each @ sums.T for each, sums in zip(steps, rising, strict=True))
        return torch.complex(self.resistance * q.exp() + first, self.reactance + x + self.sign * second)

    def slopes(self, parameters: Tensor, rising: tuple[Tensor, Tensor]) -> Tensor:
        """dZ/dparameters, (V, count)."""
        q, _, up, down = self.split(parameters)
        one = torch.ones(len(rising[0]), 1, dtype=torch.float64)
        real = rising[0] * (self.resistance_steps * up.exp())
        change = rising[1] * (self.reactance_steps * down.exp())
        parts = [one * self.resistance * q.exp(), 1j * one, real, 1j * self.sign * change]
        return torch.cat([part.to(torch.complex128) for part in parts], dim=1)


def prior_shape(
    shape: str, liner: LinerModel, frequency: float, knots: Knots, direction: str,
    rest: complex | None,
) -> PriorShape:  # fmt: skip
    """Of ``SHAPES``; the liner's Z at rest in either case.

    Args:
        direction: of the reactance, one of ``SIGNS``.
        rest: standard uncertainty of R and X at rest; None for ``REST``.
    """
    at = torch.tensor(frequency, dtype=torch.float64)
    values = SHAPES[shape](liner, at, knots.speeds)
    sign, steps = SIGNS[direction], values.diff()[1:]
    resistance = max(float(values[0].real), LEAST_RESISTANCE)
    return PriorShape(
        resistance, float(values[0].imag), _above_floor(steps.real),
        _above_floor(sign * steps.imag[:-1]), sign,
        REST if rest is None else (rest.real / resistance, rest.imag),
    )  # fmt: skip


def _above_floor(steps: Tensor) -> Tensor:
    """Those of the wrong direction, and of parts that do not change, are small."""
    mean = float(steps.abs().mean())
    return steps.clamp(min=FLOOR * mean if mean > 0 else -SMOOTH.imag * FLOOR / PARTS)


def law_of(liner: LinerModel, frequency: Any, speeds: Tensor) -> Tensor:
    """Z of a liner, complex, (V,); beyond the largest |v| that it knows, as there."""
    held = speeds.clamp(max=liner.speed_max or torch.inf)
    found = liner.impedance(frequency, held)
    return complex_tensor(found, type(liner).__name__).detach()


def _smooth(liner: LinerModel, frequency: Tensor, speeds: Tensor) -> Tensor:
    """From the liner's Z at rest in proportion to |v|."""
    rest = law_of(liner, frequency, torch.zeros(1, dtype=torch.float64))
    return rest + SMOOTH * speeds / speeds[-1]


SHAPES: dict[str, Callable[[LinerModel, Tensor, Tensor], Tensor]] = dict(
    zip(CURVE_SHAPES, (law_of, _smooth), strict=True)
)
