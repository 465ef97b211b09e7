"""Lines '# key = value unit' above the header of a CSV file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torchliner.names import did_you_mean
from torchliner.text_columns import number_of
from torchliner.units import SI_QUANTITY, require_plausible, si_factor


def read_stated(lines: Sequence[str], known: Mapping[str, str], path: str | Path) -> dict[str, Any]:
    """What the lines '# key = value' say; lines without '=' are remarks.

    Args:
        lines: those before the header.
        known: by key the SI unit of a number, or "text".
        path: for messages.
    Raises:
        ValueError: a key that is not ``known``, or is stated twice; a line or a value that cannot
            be read.
    """
    found: dict[str, Any] = {}
    for number, line in enumerate(lines, 1):
        label, match = f"{path}: line {number}", re.fullmatch(r"#\s*(\w+)\s*=\s*(.*?)\s*", line)
        if match is None:
            # '# mach: 0.1' was meant to state something.
            named = re.match(r"#\s*(\w+)[\s:]*[-+]?\.?\d", line)
            if "=" in line or (named is not None and named[1] in known):
                raise ValueError(f"{label} is {line[:60]!r}; write '# key = value', and remarks without '='")
            continue
        key, value = match.groups()
        if key not in known or key in found:
            again = " a second time" if key in found else did_you_mean(key, list(known))
            raise ValueError(f"{label} states {key!r}{again}; once each are known: {', '.join(known)}")
        found[key] = value if known[key] == "text" else _number(value, known[key], f"{label}, {key}")
    return found


def _number(text: str, unit: str, label: str) -> float:
    """A number with its unit, as ``50 mm``, in SI."""
    parts = re.fullmatch(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*)", text)
    amount = number_of(parts[1]) if parts else float("nan")
    value = amount * si_factor(SI_QUANTITY[unit], parts[2] if parts else unit, label)
    if not abs(value) < float("inf"):
        raise ValueError(f"{label} is {text!r}; a finite number with its unit is needed")
    require_plausible(value, SI_QUANTITY[unit], label)
    return value
