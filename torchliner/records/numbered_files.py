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

    A decimal is one number, as where names tell times: t_0.9 and t_1.0 are of one series. y1.001,
    y1.002, y2.001, y2.002 are of two, whose numbers follow the point.
    """
    found = _by_name(NUMBER, (each for each in folder.iterdir() if each.suffix in endings))
    for name, files in [*found.items()]:
        counts = _by_name(COUNTER, files)
        if _count_behind_points(files, counts):
            del found[name]
            found |= counts
    return found


def _by_name(pattern: re.Pattern[str], files: Iterable[Path]) -> Series:
    """Files by what stands before their number, sorted by it."""
    rows = [(part[1], Decimal(part[2]), each) for each in files if (part := pattern.fullmatch(each.stem)) is not None]
    found: Series = {}
    for name, number, each in sorted(rows):
        found.setdefault(name, {})[each] = number
    return found


def _count_behind_points(files: dict[Path, Decimal], counts: Series) -> bool:
    """Whether decimals are no numbers: two are equal, as 1.1 and 1.10, or they leave far gaps,
    which what stands behind their points does not."""
    steps = _steps(files)
    equal = len({*files.values()}) < len({each.stem for each in files})
    far = bool(steps) and max(steps) > FAR * min(steps)
    return equal or (far and all(len(_steps(each)) < 2 for each in counts.values()))


def _steps(files: dict[Path, Decimal]) -> set[Decimal]:
    return {high - low for low, high in pairwise(files.values())}
