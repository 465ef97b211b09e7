"""Parameters, declared once: the type of a field holds its unit and range.

From the declaration follow the check of a value, the key of a liner file, and what sensitivities, tolerances and fits
may vary. ``Length``, ``Share`` and the like are such types; ``Annotated[Any, Number(unit="kg/m2")]`` is a new one. A
value is a number, or a 0-d float64 tensor through which derivatives pass.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Self, get_type_hints

from torch import Tensor

from torchliner.checks import make_plain, one_number, plain_number
from torchliner.fluid import Fluid
from torchliner.units import SI_QUANTITY

SLIPS = {"1": " (5 % is 0.05)", "m": " (1 mm is 0.001 m)"}  # by unit, where a value is too large


@dataclass(frozen=True)
class Number:
    """A real parameter of a model, SI, or, without a value, what is declared of it: above ``low`` (or at it, if
    ``low_included``), at most ``high``; ``varied``: whether it is one of a model's ``numbers``."""

    value: float = math.nan
    unit: str = "1"
    low: float = 0.0
    high: float = math.inf
    low_included: bool = False
    varied: bool = True

    @property
    def quantity(self) -> str:
        """Kind of its units, a key of ``units.FACTORS``."""
        return SI_QUANTITY.get(self.unit, "number")

    def at(self, value: Any) -> Number:
        """Another value."""
        return dataclasses.replace(self, value=plain_number(value))

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


Length = Annotated[Any, Number(unit="m", high=0.1)]  # of plates; more are millimetres given as metres
Depth = Annotated[Any, Number(unit="m", high=10.0)]  # of cavities, likewise
Share = Annotated[Any, Number(high=1.0)]
ShareFrom0 = Annotated[Any, Number(high=1.0, low_included=True)]
Factor = Annotated[Any, Number()]
FactorFrom0 = Annotated[Any, Number(low_included=True)]
Coefficient = Annotated[Any, Number(low=-math.inf)]
Mach = ShareFrom0
Pitch = Annotated[float | None, Number(unit="m", varied=False)]


@cache
def arguments_of(declared: type) -> dict[str, tuple[Any, Any]]:
    """Type and default of each argument of a class, by name; those that only keywords give come last."""
    hints = get_type_hints(declared, include_extras=True)
    given = inspect.signature(declared).parameters
    return {name: (hints.get(name, Any), each.default) for name, each in given.items()}


@cache
def parameters_of(declared: type) -> dict[str, Number]:
    """What a class declares of its parameters, by name."""
    marks = {name: getattr(hint, "__metadata__", ()) for name, (hint, _) in arguments_of(declared).items()}
    return {name: mark for name, held in marks.items() for mark in held if isinstance(mark, Number)}


class Declared:
    """Base of frozen dataclasses whose fields have these types.

    Raises:
        TypeError: a parameter is no number.  ValueError: it is outside its range.
    """

    def __post_init__(self) -> None:
        make_plain(self, tensors=True)
        for name, mark, value in self._parameters():
            where = f"{self.label}: {name}"
            number = one_number(where, value.detach() if isinstance(value, Tensor) else value)
            mark.at(number).require(where)
            if not isinstance(value, Tensor):
                self.settle(**{name: number})

    @property
    def label(self) -> str:
        """For messages."""
        return type(self).__name__

    def settle(self, **values: Any) -> None:
        """Set what follows from the arguments."""
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _parameters(self) -> Iterator[tuple[str, Number, Any]]:
        """With declaration and value; those left at a default of None are passed over."""
        own: Any = type(self)
        for name, mark in parameters_of(own).items():
            value = getattr(self, name)
            if value is not None or arguments_of(own)[name][1] is not None:
                yield name, mark, value

    def numbers(self) -> dict[str, Number]:
        """The real parameters that sensitivities, tolerances and fits may vary, by name."""
        return {name: mark.at(value) for name, mark, value in self._parameters() if mark.varied}

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """A copy with other ``numbers``: by name, SI; floats, or 0-d float64 tensors, through which derivatives pass if
        ``impedance`` computes with torch."""
        return self.replace(**values)

    def replace(self, **changes: Any) -> Self:
        """A copy with some arguments changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def describe(self) -> dict[str, Any]:
        """All arguments as plain values, for provenance and liner files."""
        own: Any = type(self)
        return {name: plain(getattr(self, name)) for name in arguments_of(own)}


def plain(value: Any) -> Any:
    """An argument of a model as a plain value."""
    if isinstance(value, Tensor):
        value = value.detach().item()
    if isinstance(value, Fluid):
        return {name: plain(each) for name, each in vars(value).items()}
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, tuple):
        return [each.describe() if hasattr(each, "describe") else each for each in value]
    return value
