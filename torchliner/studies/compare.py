"""Two maps of the same cells: how far Z of one is off the other, with an interval."""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor

from torchliner.checks import index_of_frequency, require_choice
from torchliner.records import ImpedanceMap
from torchliner.records.educed import Interval
from torchliner.studies.rows import Row, Study

SAME_PLACE = 1e-6  # m
SAME_RECORD = 1e-4  # of the rms: two records of a flow never share mean and rms of all probes
ROUNDED = 1e-6  # relative, of float32


def compare(first: ImpedanceMap, second: ImpedanceMap, averaging: str | None = None) -> Study:
    """Z of ``second`` less that of ``first``, of the whole liner and of each cell.

    The errors of independent records are independent, so squares of half-widths add. Those of one run are not (one case
    in the provenance, or mean and rms of v that agree at all probes to 1e-4 of the rms), and by how much is not in a
    map: half-widths add, which no correlation exceeds.

    Args:
        first, second: of the same cells and frequencies, in any order of these.
        averaging: default that of both.
    Returns:
        averaging, level (of the intervals; None without any), same_run (whether both rest on one run, which then move
        together), words (what the intervals are). ``rows``, the whole liner first, then cells, by frequency: place
        (``liner`` or ``cell 0``, ...), x, z (its centre, m; nan for the liner and where unknown), frequency (Hz),
        first, second, difference (Z, and second - first), low, high (of the statistical interval of the difference;
        None without), differs_in (which parts have an interval without 0: "R", "X", "R, X"; "" for none, or unknown).
    Raises:
        ValueError: other cells, frequencies, averagings or levels of the interval.
    """
    if averaging is None and first.averaging != second.averaging:
        raise ValueError(
            f"the maps answer by averaging {first.averaging!r} and {second.averaging!r}; name one that both hold"
        )
    averaging = averaging or first.averaging
    for each in (first, second):
        require_choice("averaging", averaging, each.averagings)
    order, same = _require_alike(first, second), _same_run(first, second)
    level = None if None in (first.level, second.level) else first.level
    (here, own), (there, other) = _values(first, averaging), _values(second, averaging)
    there, other = there[:, order], [end[:, order] for end in other]
    low = high = [[None] * len(order)] * len(here)
    if level is not None:
        widths = torch.stack([(ends[1] - ends[0]) / 2 for ends in (own, other)])
        half = widths.sum(0) if same else widths.square().sum(0).sqrt()
        # An unbounded interval has no middle.
        middle = torch.where(half.isinf(), 0, (other[0] + other[1] - own[0] - own[1]) / 2)
        low, high = (torch.view_as_complex(end).tolist() for end in (middle - half, middle + half))
    x, z = ([math.nan, *value.tolist()] for value in (first.cell_x, first.cell_z))
    values = [each.tolist() for each in (here, there, there - here)]
    rows = [
        Row(
            place=f"cell {i - 1}" if i else "liner",
            x=x[i],
            z=z[i],
            frequency=float(first.frequency[k]),
            **dict(zip(("first", "second", "difference"), (value[i][k] for value in values), strict=True)),
            low=low[i][k],
            high=high[i][k],
            differs_in=_clear(low[i][k], high[i][k]),
        )
        for i, k in itertools.product(range(len(x)), range(len(order)))
    ]
    how = "an upper bound: both rest on one run, half-widths added" if same else "of independent records"
    words = "no intervals: one of the maps has none"
    words = words if level is None else f"{100 * level:g} % statistical interval, {how}"
    return Study(averaging=averaging, level=level, same_run=same, words=words, rows=tuple(rows))


def _clear(low: complex | None, high: complex | None) -> str:
    """Parts whose interval does not hold 0."""
    if low is None or high is None:
        return ""
    ends = {"R": (low.real, high.real), "X": (low.imag, high.imag)}
    return ", ".join(part for part, (least, most) in ends.items() if least > 0 or most < 0)


def _values(one: ImpedanceMap, averaging: str) -> tuple[Tensor, list[Tensor]]:
    """Z of the liner above that of the cells, (1 + C, F), and the ends of its interval in real parts, (1 + C, F, 2):
    complex differences of infinite ends are nan."""
    liner, cells = one.liner[averaging], one.cells[averaging]
    value = torch.cat([liner.impedance[None], cells.impedance])
    if liner.interval is None or cells.interval is None:
        return value, []
    every = Interval.joined([liner.interval.map(lambda end: end[None]), cells.interval])
    return value, [torch.view_as_real(end) for end in (every.low, every.high)]


def _require_alike(first: ImpedanceMap, second: ImpedanceMap) -> list[int]:
    """Where the frequencies of the first map are in the second."""
    lists = [each.frequency.tolist() for each in (first, second)]
    order = [i for f in lists[0] if (i := index_of_frequency(second.frequency, f)) is not None]
    if len(order) != len(lists[0]) or len(order) != len(lists[1]):
        raise ValueError(f"the maps have other frequencies: {lists[0]} Hz and {lists[1]} Hz; educe both at the same")
    counts = [len(each.cell_x) for each in (first, second)]
    pairs = ((first.cell_x, second.cell_x), (first.cell_z, second.cell_z))
    if counts[0] != counts[1] or not all(torch.allclose(*pair, 0, SAME_PLACE, equal_nan=True) for pair in pairs):
        raise ValueError(
            f"the maps have other cells ({counts[0]} and {counts[1]}); educe planes of the same extent with liners of "
            "one cell_pitch"
        )
    if None not in (first.level, second.level) and first.level != second.level:
        raise ValueError(f"the maps have intervals of {first.level} and {second.level}; educe both with the same")
    return order


def _same_run(first: ImpedanceMap, second: ImpedanceMap) -> bool:
    """By the case that they state, or by their velocities."""
    cases = [dict(each.choices.get("data") or {}).get("case") for each in (first, second)]
    if cases[0] is not None and cases[0] == cases[1]:
        return True
    if first.mean_velocity.shape != second.mean_velocity.shape:
        return False
    means, rms = (
        [getattr(each, name).double().cpu() for each in (first, second)] for name in ("mean_velocity", "velocity_rms")
    )
    # Probes that one of them left out say nothing. A mean of next to 0 is rounding by itself.
    known = torch.stack([*means, *rms]).isfinite().all(0)
    near = SAME_RECORD * rms[0] + ROUNDED * means[0].abs()
    return bool(known.any()) and all(bool(((one - other).abs() <= near)[known].all()) for one, other in (means, rms))
