r"""Laws Z(f, |v|) with free parameters: what can be fitted. The liner's own law is one, curves over |v| are another.

Curves are monotone and passive whatever their parameters are. In :math:`s = \sqrt{|v|}` cubic B-splines with equal
steps, up to a speed below which nearly all of the data lie; sums of the last of them, :math:`I_j = \sum_{k \ge j} B_k`,
rise from 0 to 1, so that

.. math:: R = R_0 e^{q_0} + \sum_j \delta_j e^{q_j} I_j, \qquad
          X = X_0 + x_0 + \sum_j \delta'_j e^{q'_j} I_j

is monotone, and R above 0, for all q: no bound has to hold them there. The steps :math:`\delta` are those of a prior
shape, so that q = 0 is that shape and equal q the same shape times a factor. The logarithm of the ratio to the prior
shape walks at random over |v|, with the standard deviation ``freedom`` from rest to the last knot. At rest both have no
slope in s; beyond the last knot R goes on along its tangent in |v|, X stays.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, require_choice
from torchliner.liners.model import LinerModel, named_numbers
from torchliner.liners.response import complex_tensor, impedance_of

ORDER = 3  # cubic
PARTS = 18  # steps in sqrt |v|, from rest to the last knot
FLOOR = 0.1  # of the mean step: the least step of a prior shape, so that a factor can act on it
STEP = 0.5 / PARTS  # of X of a prior shape that does not change
LEAST_RESISTANCE = 0.01  # at rest, of a prior shape without losses
REST = (1.0, 0.5)  # spread of the logarithm of R, and of X, at rest, where none is stated
LEVEL = 1.0  # standard deviation of the mean logarithm of the ratio to the prior shape
BOUNDS = 6.0  # of all parameters of a curve: factors of 1/400 to 400
STILL = torch.zeros(1, dtype=torch.float64)
AROUND = 0.5  # bounds that are not stated: so much of a value, or about one that may be negative
USUAL = {  # bounds of factors, whose neutral value says nothing of how far they go
    "vena_contracta": (0.2, 1.0),
    "end_correction": (0.0, 4.0),
    "mass_loss": (0.0, 10.0),
    "mass_loss_speed": (0.05, 10.0),
    "mach_resistance": (-5.0, 5.0),
    "mach_mass_loss": (-10.0, 10.0),
}


@dataclass(frozen=True, eq=False)
class Law:
    """What can be fitted.

    Args:
        label, names: of tables, and of the n parameters.
        low, high, start: bounds, and where the search begins, (n,).
        curve: Z, (F, V), differentiable in the values, from these, (n,), liner, frequency, (F,) Hz, and |v|, (V,) m/s.
        centre, prior: residuals of the prior are ``prior @ (values - centre)``, (n,) and (r, n).
        tolerance, frequencies: of the search, relative; Hz, of curves, which hold there alone.
    """

    label: str
    names: tuple[str, ...]
    low: Tensor
    high: Tensor
    start: Tensor
    curve: Callable[[Tensor, LinerModel, Tensor, Tensor], Tensor]
    centre: Tensor
    prior: Tensor
    tolerance: float = 1e-12
    frequencies: tuple[float, ...] = ()


def bounds_for(names: Sequence[str], liner: LinerModel) -> dict[str, tuple[float, float]]:
    """Usual bounds, SI, of parameters by name."""
    found = {}
    for name, number in named_numbers(liner, names).items():
        reach = AROUND * number.value if number.low >= 0 else AROUND
        found[name] = USUAL.get(name, (number.value - reach, min(number.value + reach, number.high)))
    return found


def parameter_law(
    bounds: Mapping[str, tuple[float, float]], liner: LinerModel, known: Mapping[str, tuple[float, float]] | None = None
) -> Law:
    """The liner's own law with some of its numbers free, shared by all runs.

    Args:
        bounds: SI, by name of a parameter or group.
        liner: that states them.
        known: mean and standard deviation of parameters known beforehand.
    Raises:
        ValueError: no parameter, an unknown one, or bounds that are reversed or that no liner has.
    """
    numbers, known = named_numbers(liner, bounds), known or {}
    if not numbers:
        raise ValueError("no parameter is free; name at least one with its bounds")
    pairs = {each: pair for name, pair in bounds.items() for each in liner.groups.get(name, (name,))}
    for name, number in numbers.items():
        low, high = pairs[name]
        unit = "" if number.unit == "1" else f" {number.unit}"
        least = "at least" if number.low_included else "above"
        refused = low == number.low == 0 and not number.low_included
        if not max(low, number.low) == low < high == min(high, number.high) or refused or math.isinf(high - low):
            raise ValueError(
                f"bounds of {name} are {low:g} to {high:g}{unit}; finite ones are needed, the lower first, and it is "
                f"{least} {number.low:g} and at most {number.high:g}{unit}"
            )
    for name, (mean, spread) in known.items():
        require_choice("parameter of a prior", name, numbers)
        if not (math.isfinite(mean) and 0 < spread < math.inf):
            raise ValueError(
                f"prior of {name} is {mean:g} +- {spread:g}; a mean and a standard deviation above 0 are needed"
            )
    names = tuple(numbers)
    ends = torch.tensor([(*pairs[name], numbers[name].value) for name in names], dtype=torch.float64)
    prior = torch.tensor([known.get(name, (0.0, math.inf)) for name in names], dtype=torch.float64)

    def curve(values: Tensor, own: LinerModel, frequency: Tensor, speed: Tensor) -> Tensor:
        return impedance_of(own.with_numbers(dict(zip(names, values.unbind(), strict=True))), frequency[:, None], speed)

    rows = torch.diag(1 / prior[:, 1])[prior[:, 1].isfinite()]
    box: dict[str, Any] = dict(zip(("low", "high", "start"), ends.unbind(1), strict=True))
    return Law(", ".join(bounds), names, **box, curve=curve, centre=prior[:, 0], prior=rows)


@dataclass(frozen=True)
class Knots:
    """Where the splines of all curves of a fit stand: up to ``top``, m/s, in equal steps of sqrt |v|."""

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

        place = np.sqrt(speed.numpy().clip(0, self.top)).clip(0, self._places[-1])
        return torch.from_numpy(BSpline.design_matrix(place, self._places, ORDER).toarray())

    def rising(self, speed: Tensor) -> tuple[Tensor, Tensor]:
        """I_j of R, (V, m), and of X, (V, m - 1); beyond the last knot along the tangent in |v|, and constant.

        What would give a slope in s at rest, or to X at the last knot, is left out.
        """
        sums = self.splines(speed).flip(-1).cumsum(-1).flip(-1)
        tangent = sums[:, 2:].clone()
        # Of the sums only the last has a slope there: 3/h in s, by ds = dv/(2 s) in |v|.
        tangent[:, -1] += (speed - self.top).clamp(min=0) * ORDER * self.parts / (2 * self.top)
        return tangent, sums[:, 2:-1]


def impedance_at(liner: LinerModel, frequency: Any, speeds: Tensor) -> Tensor:
    """Z of a liner, complex, (V,); beyond the largest |v| that it knows, as there."""
    found = liner.impedance(frequency, speeds.clamp(max=liner.speed_max or torch.inf))
    return complex_tensor(found, type(liner).__name__).detach()


@dataclass(frozen=True, eq=False)
class CurveShape:
    """Curves at one frequency; their parameters are q_0, x_0, q, q'.

    Args:
        base: liner whose law is the prior shape, which is kept where nothing is known, and says whether the reactance
            falls or rises over |v|; another liner's curve differs by its Z at rest.
        frequency, knots: Hz; of the splines.
        freedom, rest: of the walk over |v|; standard uncertainty u(R) + j u(X) at rest, None for ``REST``.
    """

    base: LinerModel
    frequency: float
    knots: Knots
    freedom: float
    rest: complex | None = None

    @functools.cached_property
    def _shape(self) -> tuple[float, float, Tensor, Tensor]:
        """R and X at rest, and the steps of both: of R above 0, of X of one sign."""
        values = impedance_at(self.base, torch.tensor(self.frequency, dtype=torch.float64), self.knots.speeds)
        steps, sign = values.diff()[1:], 1.0 if values[-1].imag > values[0].imag else -1.0
        resistance = max(float(values[0].real), LEAST_RESISTANCE)
        across = sign * _above_floor(sign * steps.imag[:-1])
        return resistance, float(values[0].imag), _above_floor(steps.real), across

    @property
    def count(self) -> int:
        """Parameters."""
        return 2 + len(self._shape[2]) + len(self._shape[3])

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
        return torch.complex(real, reactance + second + (across * x.exp()) @ rising[1].T)


def curve_law(shapes: Sequence[CurveShape]) -> Law:
    """Curves at several frequencies, each with its own parameters; the prior shapes are the start and the centre."""
    start = torch.zeros(sum(shape.count for shape in shapes), dtype=torch.float64)
    frequencies, knots = tuple(shape.frequency for shape in shapes), shapes[0].knots
    kept: dict[Any, Any] = {}  # of nodes and liners that are asked again and again

    def rising(speed: Tensor) -> tuple[Tensor, Tensor]:
        key = speed.numpy().tobytes()
        return kept[key] if key in kept else kept.setdefault(key, knots.rising(speed))

    def more(shape: CurveShape, liner: LinerModel) -> complex:
        """Z at rest of a liner above that of the base."""
        key = (shape.frequency, id(liner))
        if key not in kept:
            own, base = (complex(each.impedance(shape.frequency, STILL)[0]) for each in (liner, shape.base))
            kept[key] = own - base, liner
        return kept[key][0]

    def curve(values: Tensor, liner: LinerModel, frequency: Tensor, speed: Tensor) -> Tensor:
        parts, sums = values.split([shape.count for shape in shapes]), rising(speed)
        places = [place_of(frequencies, f) for f in frequency.tolist()]
        return torch.stack([shapes[i].values(parts[i], sums) + more(shapes[i], liner) for i in places])

    prior, label = torch.block_diag(*(shape.prior for shape in shapes)), f"curve, freedom {shapes[0].freedom:g}"
    names = tuple(f"q{i}" for i in range(len(start)))
    return Law(label, names, start - BOUNDS, start + BOUNDS, start, curve, start, prior, 1e-9, frequencies)


def place_of(known: Sequence[float], frequency: float) -> int:
    """Where a frequency, Hz, is among those at which curves are known; ValueError if it is not."""
    for i, each in enumerate(known):
        if abs(each / frequency - 1) < SAME_FREQUENCY:
            return i
    raise ValueError(
        f"no curve is known at {frequency:g} Hz: the runs that are left have {', '.join(f'{f:g}' for f in known)} Hz; "
        "a table over |v| says nothing of other frequencies (a parameter does: models=[('vena_contracta',)])"
    )


def _above_floor(steps: Tensor) -> Tensor:
    """Those of the wrong direction, and of parts that do not change, are small."""
    mean = float(steps.abs().mean())
    return steps.clamp(min=FLOOR * mean if mean > 0 else STEP * FLOOR)
