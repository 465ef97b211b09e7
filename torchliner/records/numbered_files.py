"""Series of files that are numbered in their names, as solvers write one a frame."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

NUMBER = re.compile(r"(.*?)(\d+(?:\.\d+)?(?:[eE][-+]\d{1,3})?)")  # plane_0.0012, plane_1.2e-03
COUNTER = re.compile(r"(.*?)(\d+)")
FAR = 10  # steps between two frames of what is no one series
Series = dict[str, dict[Path, Decimal]]


def numbered_series(folder: Path, endings: Collection[str]) -> Series:
    """Files with a number at the end of their names, by the name before it, in its order.

    A decimal is one number, as where names tell times: t_0.9 and t_1.0 are of one series. y1.001, y1.002, y2.001,
    y2.002 are of two: read as decimals they would leave far gaps.
    """
    found = _by_name(NUMBER, (each for each in folder.iterdir() if each.suffix in endings))
    for name, files in [*found.items()]:
        numbers = [*files.values()]
        steps = sorted(high - low for low, high in pairwise(numbers))
        if steps and steps[-1] > FAR * steps[0]:
            del found[name]
            found |= _by_name(COUNTER, files)
    return found


def _by_name(pattern: re.Pattern[str], files: Iterable[Path]) -> Series:
    """Files by what stands before their number, sorted by it."""
    rows = [(part[1], Decimal(part[2]), each) for each in files if (part := pattern.fullmatch(each.stem)) is not None]
    found: Series = {}
    for name, number, each in sorted(rows):
        found.setdefault(name, {})[each] = number
    return found
