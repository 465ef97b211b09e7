"""Lines '# key = value unit' above the header of a CSV file."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

from torchliner.io.whole_file import printable
from torchliner.names import did_you_mean
from torchliner.units import SI_QUANTITY, require_plausible, si_factor


def read_stated(lines: Sequence[str], known: Mapping[str, str], path: str | Path) -> dict[str, Any]:
    """What the lines '# key = value' say; lines without '=' are remarks.

    Args:
        lines: those before the header.
        known: by key the SI unit of a number, "text", or "json" for an object.
        path: for messages.
    Raises:
        ValueError: a key that is not ``known``, or is stated twice; a line or a value that cannot
            be read.
    """
    found: dict[str, Any] = {}
    for number, line in enumerate(lines, 1):
        match = re.fullmatch(r"#\s*(\w+)\s*=\s*(.*?)\s*", line)
        if match is None:
            _require_remark(line, known, f"{path}: line {number}")
            continue
        key, value = match.groups()
        if key not in known:
            raise ValueError(
                f"{path}: line {number} states {key!r}{did_you_mean(key, list(known))}; known are {', '.join(known)}"
            )
        if key in found:
            raise ValueError(f"{path}: line {number} states {key!r} a second time; keep one")
        found[key] = _stated_value(value, known[key], f"{path}: line {number}, {key}")
    return found


def _require_remark(line: str, known: Mapping[str, str], label: str) -> None:
    """Refuse what may have been meant to state something: '# mach: 0.1' would count as silence."""
    named = re.match(r"#\s*(\w+)[\s:]*[-+]?\.?\d", line)
    if "=" in line or (named is not None and named[1] in known):
        raise ValueError(f"{label} is {line[:60]!r}; write '# key = value', and remarks without '='")


def _stated_value(text: str, kind: str, label: str) -> Any:
    """A text, an object of JSON, or a number with its unit, as ``50 mm``, in SI."""
    if kind == "text":
        return text
    if kind == "json":
        with suppress(ValueError, RecursionError):
            if isinstance(found := json.loads(text), dict):
                return found
        raise ValueError(f"{label} is {text!r}; it cannot be read, counts by reason are needed")
    parts = re.fullmatch(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*)", text)
    try:
        amount = float(parts[1] if parts else text)
    except ValueError as error:
        raise ValueError(f"{label} is {text!r}; it cannot be read") from error
    value = amount * si_factor(SI_QUANTITY[kind], parts[2] if parts else "", label)
    if not math.isfinite(value):
        raise ValueError(f"{label} is {text!r}; a finite number is needed")
    require_plausible(value, SI_QUANTITY[kind], label)
    return value


def write_stated(file: TextIO, record: Any, known: Mapping[str, str], path: str | Path) -> None:
    """The lines that ``read_stated`` reads, of what is neither None nor empty.

    Raises:
        ValueError: a text of several lines, or with blanks around it, which would not come back.
    """
    for key, kind in known.items():
        value = getattr(record, key)
        if value is None or (kind in ("text", "json") and not value):
            continue
        if kind == "text" and (value != value.strip() or len(value.splitlines()) > 1):
            raise ValueError(f"{path}: {key} is {value!r}; a .csv holds one line of it, without blanks around it")
        if kind == "text":
            text = printable(value)
        else:
            text = json.dumps(dict(value)) if kind == "json" else f"{float(value)!r} {kind}"
        file.write(f"# {key} = {text}\n")
