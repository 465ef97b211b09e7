"""Laws Z(f, |v|) with free parameters: what can be fitted. The liner's own law is one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import require_choice
from torchliner.liners.model import LinerModel, named_numbers
from torchliner.liners.response import impedance_of


@dataclass(frozen=True, eq=False)
class Law:
    """What can be fitted.

    Args:
        names: of the n parameters.
        low, high, start: bounds, and where the search begins, (n,).
        curve: Z, (F, V), differentiable in the values, from these, (n,), liner, frequency, (F,) Hz, and |v|, (V,) m/s.
        centre, prior: residuals of the prior are ``prior @ (values - centre)``, (n,) and (r, n).
        tolerance: of the search, relative.
        frequency: Hz, of a law that holds at one alone: a curve.
    """

    names: tuple[str, ...]
    low: Tensor
    high: Tensor
    start: Tensor
    curve: Callable[[Tensor, LinerModel, Tensor, Tensor], Tensor]
    centre: Tensor
    prior: Tensor
    tolerance: float = 1e-12
    frequency: float | None = None


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
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise ValueError(f"bounds of {name} are {low:g} to {high:g}{unit}; finite ones are needed, the lower first")
        refused = low == number.low == 0 and not number.low_included
        if low < number.low or refused or high > number.high:
            raise ValueError(
                f"bounds of {name} are {low:g} to {high:g}{unit}; it is "
                f"{'at least' if number.low_included else 'above'} {number.low:g} and at most {number.high:g}{unit}"
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
    return Law(names, ends[:, 0], ends[:, 1], ends[:, 2], curve, prior[:, 0], rows)
