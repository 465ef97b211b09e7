r"""Curves Z(|v|) that are monotone and passive whatever their parameters are, and their fit.

In :math:`s = \sqrt{|v|}` cubic B-splines with equal steps, up to a speed below which nearly all of the data lie; sums
of the last of them, :math:`I_j = \sum_{k \ge j} B_k`, rise from 0 to 1, so that

.. math:: R = R_0 e^{q_0} + \sum_j \delta_j e^{q_j} I_j, \qquad
          X = X_0 + x_0 \mp \sum_j \delta'_j e^{q'_j} I_j

is monotone, and R above 0, for all q: no bound has to hold them there. The steps :math:`\delta` are those of a prior
shape, so that q = 0 is that shape and equal q the same shape times a factor. The logarithm of the ratio to the prior
shape walks at random over |v|, with the standard deviation ``freedom`` from rest to the last knot. At rest both have no
slope in s; beyond the last knot R goes on along its tangent in |v|, X stays.
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
from torchliner.studies.laws import Law

ORDER = 3  # cubic
PARTS = 18  # steps in sqrt |v|, from rest to the last knot
FLOOR = 0.1  # of the mean step: the least step of a prior shape, so that a factor can act on it
LEAST_RESISTANCE = 0.01  # at rest, of a prior shape without losses
SMOOTH = 1.0 - 0.5j  # change of Z from rest to the largest |v|, of the prior shape "smooth"
REST = (1.0, 0.5)  # spread of the logarithm of R, and of X, at rest, where none is stated
SIGNS = dict(zip(REACTANCES, (-1.0, 1.0), strict=True))
LEVEL = 1.0  # standard deviation of the mean logarithm of the ratio to the prior shape
BOUNDS = 6.0  # of all parameters: factors of 1/400 to 400
TOLERANCE = 1e-9  # of the search
STILL = torch.zeros(1, dtype=torch.float64)


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
        return np.pad(np.linspace(0.0, self.top**0.5, self.parts + 1), ORDER, mode="edge")

    @functools.cached_property
    def speeds(self) -> Tensor:
        """|v| about which each B-spline lies, m/s, (n,)."""
        each = [self._places[i + 1 : i + 1 + ORDER].mean() for i in range(self.parts + ORDER)]
        return torch.tensor(each, dtype=torch.float64).square()

    def splines(self, speed: Tensor) -> Tensor:
        """B-splines, (V, n), constant beyond the last knot."""
        from scipy.interpolate import BSpline

        place = np.sqrt(speed.numpy().clip(0, self.top))
        matrix = BSpline.design_matrix(place.clip(0, self._places[-1]), self._places, ORDER)
        return torch.from_numpy(matrix.toarray())

    def rising(self, speed: Tensor) -> tuple[Tensor, Tensor]:
        """I_j of R, (V, m), and of X, (V, m - 1); beyond the last knot along the tangent in |v|, and constant.

        What would give a slope in s at rest, or to X at the last knot, is left out.
        """
        sums = self.splines(speed).flip(-1).cumsum(-1).flip(-1)
        tangent = sums[:, 2:].clone()
        # Of the sums only the last has a slope there: 3/h in s, by ds = dv/(2 s) in |v|.
        tangent[:, -1] += (speed - self.top).clamp(min=0) * ORDER * self.parts / (2 * self.top)
        return tangent, sums[:, 2:-1]


def law_of(liner: LinerModel, frequency: Any, speeds: Tensor) -> Tensor:
    """Z of a liner, complex, (V,); beyond the largest |v| that it knows, as there."""
    found = liner.impedance(frequency, speeds.clamp(max=liner.speed_max or torch.inf))
    return complex_tensor(found, type(liner).__name__).detach()


def _smooth(liner: LinerModel, frequency: Any, speeds: Tensor) -> Tensor:
    """From the liner's Z at rest in proportion to |v|."""
    return law_of(liner, frequency, STILL) + SMOOTH * speeds / speeds[-1]


SHAPES: dict[str, Callable[[LinerModel, Any, Tensor], Tensor]] = dict(zip(CURVE_SHAPES, (law_of, _smooth), strict=True))


@dataclass(frozen=True, eq=False)
class CurveShape:
    """Curves at one frequency; their parameters are q_0, x_0, q, q'.

    Args:
        base: liner whose Z at rest, and whose law if that is the prior shape, is kept where nothing is known; another
            liner's curve differs by its Z at rest.
        frequency: Hz.
        knots: of the splines.
        shape: prior shape, one of ``SHAPES``.
        direction: of the reactance, one of ``SIGNS``.
        freedom: of the walk over |v|.
        rest: standard uncertainty u(R) + j u(X) at rest; None for ``REST``.
    """

    base: LinerModel
    frequency: float
    knots: Knots
    shape: str
    direction: str
    freedom: float
    rest: complex | None = None

    @functools.cached_property
    def _shape(self) -> tuple[float, float, Tensor, Tensor]:
        """R and X at rest, and the steps of both, above 0."""
        at = torch.tensor(self.frequency, dtype=torch.float64)
        values = SHAPES[self.shape](self.base, at, self.knots.speeds)
        steps = values.diff()[1:]
        resistance = max(float(values[0].real), LEAST_RESISTANCE)
        falling = SIGNS[self.direction] * steps.imag[:-1]
        return resistance, float(values[0].imag), _above_floor(steps.real), _above_floor(falling)

    @property
    def count(self) -> int:
        """Parameters."""
        return 2 + len(self._shape[2]) + len(self._shape[3])

    def law(self) -> Law:
        """The prior shape is the start and the centre."""
        start = torch.zeros(self.count, dtype=torch.float64)
        names = tuple(f"q{i}" for i in range(self.count))
        return Law(
            names, start - BOUNDS, start + BOUNDS, start, self._curve, start, self.prior, TOLERANCE, self.frequency
        )

    @functools.cached_property
    def prior(self) -> Tensor:
        """Residuals of the prior are these times the parameters, (r, n)."""
        resistance, _, *steps = self._shape
        rest = REST if self.rest is None else (self.rest.real / resistance, self.rest.imag)
        blocks = [torch.diag(1 / torch.tensor(rest, dtype=torch.float64))]
        for size in map(len, steps):
            walk = torch.eye(size, dtype=torch.float64).diff(dim=0)
            mean = torch.full((1, size), 1 / (size * LEVEL), dtype=torch.float64)
            blocks.append(torch.cat([walk * (size - 1) ** 0.5 / self.freedom, mean]))
        return torch.block_diag(*blocks)

    def values(self, parameters: Tensor, rising: tuple[Tensor, Tensor]) -> Tensor:
        """Z of the base, (..., V), from parameters (..., n) and ``Knots.rising``."""
        resistance, reactance, up, across = self._shape
        first, second, q, x = parameters.split([1, 1, len(up), len(across)], -1)
        real = resistance * first.exp() + (up * q.exp()) @ rising[0].T
        return torch.complex(real, reactance + second + SIGNS[self.direction] * ((across * x.exp()) @ rising[1].T))

    def _curve(self, values: Tensor, liner: LinerModel, frequency: Tensor, speed: Tensor) -> Tensor:
        """See ``Law``; F is 1."""
        return (self.values(values, self._rising(speed)) + self._offset(liner))[None]

    def _rising(self, speed: Tensor) -> tuple[Tensor, Tensor]:
        """Of the nodes again and again."""
        key = speed.numpy().tobytes()
        kept: dict[Any, tuple[Tensor, Tensor]] = self.__dict__.setdefault("_kept", {})
        if key not in kept:
            kept[key] = self.knots.rising(speed)
        return kept[key]

    def _offset(self, liner: LinerModel) -> complex:
        """What the Z at rest of a liner has more than that of the base."""
        if liner is self.base:
            return 0j
        own, base = (complex(each.impedance(self.frequency, STILL)[0]) for each in (liner, self.base))
        return own - base


def _above_floor(steps: Tensor) -> Tensor:
    """Those of the wrong direction, and of parts that do not change, are small."""
    mean = float(steps.abs().mean())
    return steps.clamp(min=FLOOR * mean if mean > 0 else -SMOOTH.imag * FLOOR / PARTS)
