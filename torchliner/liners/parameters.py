"""Parameters as fields of frozen dataclasses: unit and range stand where the field does, and from
them follow checks, keys of liner files, and what sensitivities and fits may vary."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import Field
from torch import Tensor

from torchliner.checks import one_number
from torchliner.liners.model import Number

REQUIRED: Any = dataclasses.MISSING
SLIPS = {"1": " (5 % is 0.05)", "m": " (1 mm is 0.001 m)"}  # by unit, where a value is too large


def parameter(
    unit: str = "1", *, default: Any = REQUIRED, low: float = 0.0, high: float = math.inf,
    low_included: bool = False,
) -> Any:  # fmt: skip
    """A field: a number, or a 0-d float64 tensor through which derivatives pass.

    Args:
        unit: SI, "1" if it has none.
        default: SI; without one it must be given.
        low, high: what makes sense: above ``low``, at most ``high``.
        low_included: whether ``low`` itself makes sense.
    """
    metadata = {"unit": unit, "low": low, "high": high, "low_included": low_included}
    return dataclasses.field(default=default, metadata=metadata)


def parameters_of(kind: Any) -> Iterator[dataclasses.Field[Any]]:
    """The fields of a dataclass, or of an instance, that are parameters."""
    return (each for each in dataclasses.fields(kind) if each.metadata)


def numbers_of(record: Any, label: str) -> dict[str, Number]:
    """Parameters by name, without those left at a default of None; ``label`` names the record in messages."""
    return {
        each.name: Number(one_number(f"{label}: {each.name}", plain), **each.metadata)
        for each in parameters_of(record)
        for given in (getattr(record, each.name),)
        if not (given is None and each.default is None)
        for plain in (given.detach() if isinstance(given, Tensor) else given,)
    }


def require_ranges(numbers: Mapping[str, Number], label: str) -> None:
    """Refuse what is not finite or outside its range.

    Raises:
        ValueError: label, name, value, unit, range.
    """
    for name, number in numbers.items():
        below = number.value < number.low or (number.value == number.low and not number.low_included)
        if below or not math.isfinite(number.value) or number.value > number.high:
            unit = "" if number.unit == "1" else f" {number.unit}"
            edge = f"{'at least' if number.low_included else 'above'} {number.low:g}{unit}"
            most = "" if number.high == math.inf else f"at most {number.high:g}{unit}"
            limits = " and ".join(filter(None, [edge if number.low > -math.inf else "", most]))
            slip = SLIPS.get(number.unit, "") if number.value > number.high else ""
            raise ValueError(f"{label}: {name} is {number.value:g}{unit}; it is "
                             f"{limits or 'finite'}{slip}")  # fmt: skip


def keys_of(kind: type) -> dict[str, Any]:
    """Keys of a liner file for the fields of a class, with ranges and defaults, for pydantic."""
    found: dict[str, Any] = {}
    for each in dataclasses.fields(kind):
        limits: dict[str, Any] = {}
        if about := each.metadata:
            limits = {"ge" if about["low_included"] else "gt": about["low"], "le": about["high"]}
        default: Any = ... if each.default is REQUIRED else each.default
        found[each.name] = (float if limits else Any, Field(default, **limits))
    return found
