"""Parameters, declared once: the type of a field, or of a keyword of a law, holds its unit and range.

From the declaration follow the check of a value, the key of a liner file, and what sensitivities, tolerances and fits
may vary. ``Length``, ``Share`` and the like are such types; ``Annotated[Any, Range("kg/m2")]`` is a new one. A value is
a number, or a 0-d float64 tensor through which derivatives pass.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, get_type_hints

import torch
from torch import Tensor

from torchliner.checks import one_number, plain_number, real_tensor
from torchliner.units import SI_QUANTITY

SLIPS = {"1": " (5 % is 0.05)", "m": " (1 mm is 0.001 m)"}  # by unit, where a value is too large


@dataclass(frozen=True)
class Number:
    """A real parameter of a model that may be varied.

    Args:
        value: SI.  unit: SI, "1" if it has none.
        low, high: what makes sense: above ``low``, at most ``high``.  low_included: whether ``low`` itself does.
    """

    value: float
    unit: str = "1"
    low: float = 0.0
    high: float = math.inf
    low_included: bool = False

    @property
    def quantity(self) -> str:
        """Kind of its units, a key of ``units.FACTORS``."""
        return SI_QUANTITY.get(self.unit, "number")

    def require(self, name: str) -> None:
        """Raise a ValueError with name, value, unit and range unless the value is finite and within the range."""
        below = self.value < self.low or (self.value == self.low and not self.low_included)
        if not below and math.isfinite(self.value) and self.value <= self.high:
            return
        unit = "" if self.unit == "1" else f" {self.unit}"
        limits = [f"{'at least' if self.low_included else 'above'} {self.low:g}{unit}"] * (self.low > -math.inf)
        limits += [f"at most {self.high:g}{unit}"] * (self.high < math.inf)
        slip = SLIPS.get(self.unit, "") if self.value > self.high else ""
        raise ValueError(f"{name} is {self.value:g}{unit}; it is {' and '.join(limits) or 'finite'}{slip}")


@dataclass(frozen=True)
class Range:
    """Unit and range of a parameter, as in ``Number``; ``varied``: whether it is one of a liner's ``numbers``."""

    unit: str = "1"
    low: float = 0.0
    high: float = math.inf
    low_included: bool = False
    varied: bool = True

    def number(self, value: Any) -> Number:
        """A value with this unit and range."""
        return Number(plain_number(value), self.unit, self.low, self.high, self.low_included)


Length = Annotated[Any, Range("m", high=0.1)]  # of plates; more are millimetres given as metres
Depth = Annotated[Any, Range("m", high=10.0)]  # of cavities, likewise
Share = Annotated[Any, Range(high=1.0)]
ShareFrom0 = Annotated[Any, Range(high=1.0, low_included=True)]
Factor = Annotated[Any, Range()]
FactorFrom0 = Annotated[Any, Range(low_included=True)]
Coefficient = Annotated[Any, Range(low=-math.inf)]
Mach = ShareFrom0
Pitch = Annotated[float | None, Range("m", varied=False)]


@cache
def arguments_of(declared: Any) -> dict[str, tuple[Any, Any]]:
    """Type and default of each argument of a class or a function, by name; those that only keywords give come last."""
    hints = get_type_hints(declared, include_extras=True)
    given = inspect.signature(declared).parameters
    return {name: (hints.get(name, Any), each.default) for name, each in given.items()}


@cache
def ranges_of(declared: Any) -> dict[str, Range]:
    """Ranges of the parameters of a class or a function, by name."""
    marks = {name: getattr(hint, "__metadata__", ()) for name, (hint, _) in arguments_of(declared).items()}
    return {name: mark for name, held in marks.items() for mark in held if isinstance(mark, Range)}


def stated(declared: Any, values: Mapping[str, Any]) -> Iterator[tuple[str, Range, Any]]:
    """Parameters with range and value; those left at a default of None are passed over."""
    for name, within in ranges_of(declared).items():
        if values[name] is not None or arguments_of(declared)[name][1] is not None:
            yield name, within, values[name]


def checked(declared: Any, values: Mapping[str, Any], label: str) -> dict[str, float | Tensor]:
    """Parameters as Python's numbers, and tensors as they are; ``label`` says of what, for messages.

    Raises:
        TypeError: no number.  ValueError: outside its range.
    """
    found = {}
    for name, within, value in stated(declared, values):
        number = one_number(f"{label}: {name}", value.detach() if isinstance(value, Tensor) else value)
        within.number(number).require(f"{label}: {name}")
        found[name] = value if isinstance(value, Tensor) else number
    return found


def numbers_of(declared: Any, values: Mapping[str, Any]) -> dict[str, Number]:
    """Parameters that may be varied, by name."""
    return {name: within.number(value) for name, within, value in stated(declared, values) if within.varied}


def tensors_of(declared: Any, values: Mapping[str, Any], device: torch.device) -> dict[str, Tensor]:
    """Parameters as float64 tensors, gradients kept."""
    return {name: real_tensor(value).to(device) for name, _, value in stated(declared, values)}
