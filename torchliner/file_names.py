"""Names of files and columns of several planes or frequencies, no two of them alike."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

MOST_DIGITS = 17  # that tell two float64 apart


def unique_names(paths: Iterable[str | Path]) -> list[str]:
    """Stems, with as many folders before all of them as tell them apart; else whole paths."""
    every = [Path(path) for path in paths]
    for depth in range(1, max(len(path.parts) for path in every)):
        found = ["_".join([*path.parts[:-1], path.stem][-depth:]) for path in every]
        if len(set(found)) == len(found):
            return found
    return [re.sub(r"[\W]+", "_", str(path)).strip("_") for path in every]


def frequency_ends(frequencies: Sequence[float]) -> list[str]:
    """``_1400Hz`` each, with as many digits as tell them apart, six at least; nothing for one."""
    if len(frequencies) == 1:
        return [""]
    for digits in range(6, MOST_DIGITS + 1):
        found = [f"_{f:.{digits}g}Hz" for f in frequencies]
        if len(set(found)) == len(set(frequencies)):
            break
    return found
