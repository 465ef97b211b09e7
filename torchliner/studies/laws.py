r"""Laws Z(f, |v|) with free parameters: what can be fitted. The liner's own law is one, curves over |v| are another.

Curves are monotone and passive whatever their parameters are. In :math:`s = \sqrt{|v|}` cubic B-splines with equal
steps, up to a speed below which nearly all of the data lie; sums of the last of them, :math:`I_j = \sum_{k \ge j} B_k`,
rise from 0 to 1, so that

.. math:: R = R_0 e^{q_0} + \sum_j \delta_j e^{q_j} I_j, \qquad
          X = X_0 + x_0 + \sum_j \delta'_j e^{q'_j} I_j

is monotone, and R above 0, for all q. The steps :math:`\delta` are those of a prior shape, the liner's law, so that
q = 0 is that shape and equal q the same shape times a factor. The logarithm of the ratio to the prior shape walks at
random over |v|, with the standard deviation ``freedom`` from rest to the last knot.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import index_of_frequency, real_tensor
from torchliner.liners.model import LinerModel, impedance_of, named_numbers

ORDER, PARTS = 3, 18  # cubic; steps in sqrt |v|, from rest to the last knot
FLOOR = 0.1  # of the mean step: the least step of a prior shape, so that a factor can act on it
STEP = 0.5 / PARTS  # of X of a prior shape that does not change
LEAST_RESISTANCE = 0.01  # at rest, of a prior shape without losses
REST = (1.0, 0.5)  # spread of the logarithm of R, and of X, at rest, where none is stated
BOUNDS = 6.0  # of all parameters of a curve: factors of 1/400 to 400
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
        label, names: of tables; of the n parameters.
        low, high, start: bounds, and where the search begins, (n,).
        curve: Z, (F, V), differentiable in the values, from these, (n,), liner, frequency, (F,) Hz, and |v|, (V,) m/s.
        prior: residuals of the prior are ``prior @ values``, (r, n).
        frequencies: Hz, of curves, which hold there alone.
    """

    label: str
    names: tuple[str, ...]
    low: Tensor
    high: Tensor
    start: Tensor
    curve: Callable[[Tensor, LinerModel, Tensor, Tensor], Tensor]
    prior: Tensor
    frequencies: tuple[float, ...] = ()


def bounds_for(names: Sequence[str], liner: LinerModel) -> dict[str, tuple[float, float]]:
    """Usual bounds, SI, of parameters by name."""
    found = {}
    for name, number in named_numbers(liner, names).items():
        reach = AROUND * number.value if number.low >= 0 else AROUND
        found[name] = USUAL.get(name, (number.value - reach, min(number.value + reach, number.high)))
    return found


def parameter_law(bounds: Mapping[str, tuple[float, float]], liner: LinerModel) -> Law:
    """The liner's own law with some of its numbers free, shared by all runs; ``bounds``: SI, by name."""
    numbers = named_numbers(liner, bounds)
    if not numbers:
        raise ValueError("no parameter is free; name at least one with its bounds")
    pairs = {each: pair for name, pair in bounds.items() for each in liner.groups.get(name, (name,))}
    for name, number in numbers.items():
        low, high = pairs[name]
        if not (number.low <= low < high <= number.high and math.isfinite(high - low)):
            raise ValueError(
                f"bounds of {name} are {low:g} to {high:g}; finite ones are needed, the lower first, within "
                f"{number.low:g} to {number.high:g} {number.unit.strip('1')}"
            )
    names = tuple(numbers)
    ends = torch.tensor([(*pairs[name], numbers[name].value) for name in names], dtype=torch.float64)

    def curve(values: Tensor, own: LinerModel, frequency: Tensor, speed: Tensor) -> Tensor:
        return impedance_of(own.with_numbers(dict(zip(names, values.unbind(), strict=True))), frequency[:, None], speed)

    return Law(", ".join(bounds), names, ends[:, 0], ends[:, 1], ends[:, 2], curve, ends.new_zeros(0, len(names)))


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
        each = np.lib.stride_tricks.sliding_window_view(self._places[1:-1], ORDER).mean(1)
        return torch.from_numpy(each).square()

    def splines(self, speed: Tensor) -> Tensor:
        """B-splines, (V, n), constant beyond the last knot."""
        from scipy.interpolate import BSpline  # takes half a second or more to import

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


def impedances_at(liner: LinerModel, frequency: Any, speeds: Tensor) -> Tensor:
    """Z of a liner, complex, (F, V); beyond the largest |v| that it knows, as there."""
    within, asked = speeds.clamp(max=liner.speed_max or torch.inf), real_tensor(frequency)
    return torch.stack([impedance_of(liner, f, within) for f in asked]).detach()


def curve_law(
    base: LinerModel, frequencies: Sequence[float], knots: Knots, freedom: float, rest: complex | None = None
) -> Law:
    """A curve at each frequency, whose parameters are q_0, x_0, q, q'; the search starts at the prior shape.

    The law of ``base`` is the prior shape, and says whether the reactance falls or rises over |v|; in another flow the
    curve differs by Z at rest. ``freedom`` is that of the walk, ``rest`` u(R) + j u(X) at rest, None for ``REST``.
    """
    lines, still = tuple(frequencies), torch.zeros(1, dtype=torch.float64)
    shapes, at_rest = impedances_at(base, lines, knots.speeds), impedances_at(base, lines, still)
    steps = shapes.diff()[:, 1:]
    sign = torch.where(shapes[:, -1:].imag > shapes[:, :1].imag, 1.0, -1.0)
    resistance, reactance = shapes[:, :1].real.clamp(min=LEAST_RESISTANCE), shapes[:, :1].imag
    up, across = _above_floor(steps.real), sign * _above_floor(sign * steps.imag[:, :-1])
    rising = functools.lru_cache(lambda speeds: knots.rising(torch.tensor(speeds, dtype=torch.float64)))
    sizes, blocks = [1, 1, up.shape[1], across.shape[1]], []
    for own in resistance[:, 0].tolist():
        spread = REST if rest is None else (rest.real / own, rest.imag)
        blocks.append(torch.diag(1 / torch.tensor(spread, dtype=torch.float64)))
        for size in sizes[2:]:
            walk = torch.eye(size, dtype=torch.float64).diff(dim=0) * (size - 1) ** 0.5 / freedom
            blocks.append(torch.cat([walk, torch.full((1, size), 1 / size, dtype=torch.float64)]))

    def curve(values: Tensor, liner: LinerModel, frequency: Tensor, speed: Tensor) -> Tensor:
        of_r, of_x = rising(tuple(speed.tolist()))
        first, second, q, x = values.unflatten(0, (len(lines), -1)).split(sizes, -1)
        real = resistance * first.exp() + (up * q.exp()) @ of_r.T
        found = torch.complex(real, reactance + second + (across * x.exp()) @ of_x.T)
        found = found + impedances_at(liner, lines, still) - at_rest
        places = [index_of_frequency(torch.tensor(lines), f) for f in frequency.tolist()]
        if None in places:
            raise ValueError(
                f"no curve is known at {frequency.tolist()} Hz, but at {', '.join(f'{f:g}' for f in lines)}"
            )
        return found[places]

    start = torch.zeros(len(lines) * sum(sizes), dtype=torch.float64)
    names, prior = tuple(f"q{i}" for i in range(len(start))), torch.block_diag(*blocks)
    box = (start - BOUNDS, start + BOUNDS, start)
    return Law(f"curve, freedom {freedom:g}", names, *box, curve, prior, lines)


def _above_floor(steps: Tensor) -> Tensor:
    """Those of the wrong direction, and of parts that do not change, are small; (F, m)."""
    mean = steps.abs().mean(1, keepdim=True)
    return steps.maximum(torch.where(mean > 0, FLOOR * mean, STEP * FLOOR))
