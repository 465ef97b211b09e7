"""Tolerances as text: "0.02 mm", "2 %", "0.5 K"; a number alone says nothing."""

from __future__ import annotations

import math
import re
from typing import Any

from torchliner.units import FACTORS
from torchliner.words import did_you_mean

_TEXT = re.compile(r"(?:±|\+/?-)?\s*(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)\s*(.*)")


def parse_tolerance(given: Any, name: str, quantity: str, value: float) -> float:
    """Half-width of a tolerance in SI units.

    Args:
        given: text such as "0.02 mm", "+-0.02 mm", "2 %"; a plain number only for what has no unit.
        name: of the parameter, for messages.
        quantity: its kind, a key of ``FACTORS``.
        value: of the parameter, SI, to which per cent refer.
    Raises:
        ValueError: no unit or a wrong one (the allowed ones are listed), not above 0, or per cent
            of 0.
    """
    known = [unit for unit in FACTORS[quantity] if unit not in ("", "1")]
    allowed = ", ".join([*known, "%"])
    found = _TEXT.fullmatch(str(given).strip())
    if found is None:
        raise ValueError(
            f"tolerance of {name} is {given!r}; write a half-width above 0 and its unit, e.g. "
            f"'0.5 {known[-1] if known else '%'}' (units: {allowed})"
        )
    amount, unit = float(found[1]), found[2].strip()
    if unit == "" and known:
        raise ValueError(
            f"tolerance of {name} is {given!r}, without a unit; {name} is a {quantity}: write "
            f"'{given} {known[0]}' or another of: {allowed}"
        )
    if unit == "%" and value == 0:
        raise ValueError(f"tolerance of {name} is {given!r}, but {name} is 0; state it as a number")
    if unit != "%" and unit not in FACTORS[quantity]:
        raise ValueError(
            f"tolerance of {name} is {given!r}; unit {unit!r} is none of a {quantity}"
            f"{did_you_mean(unit, known)}: {allowed}"
        )
    half_width = amount * (abs(value) / 100 if unit == "%" else FACTORS[quantity][unit])
    if not 0 < half_width < math.inf:
        raise ValueError(f"tolerance of {name} is {given!r}; it must be finite and above 0")
    return half_width
