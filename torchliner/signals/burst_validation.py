"""Which bursts count: times, runs of zeros, outliers, coincidence; each can be switched off."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import make_plain, require_positive
from torchliner.records import BurstRecord

GAUSSIAN_MAD = 1.4826  # standard deviation over median absolute deviation, 1 / Phi^-1(3/4)
REPEATED, BACKWARDS = "repeated time", "time runs backwards"
ZERO_RUN, OUTLIER = "run of exact zeros", "outlier"


@dataclass(frozen=True)
class BurstFilters:
    """Filters in the order in which they are applied; None or False switches one off.

    Args:
        times: drop bursts that do not come after all before them.
        zero_runs: drop runs of at least so many successive bursts with a component of exactly 0.
        outliers: drop |v - median| above so many standard deviations, the latter taken from the
            median absolute deviation, both weighted by transit time.
    Raises:
        ValueError: a run shorter than 2, an outlier limit not above 0.
    """

    times: bool = True
    zero_runs: int | None = 10
    outliers: float | None = 6.0

    def __post_init__(self) -> None:
        make_plain(self)
        if self.zero_runs is not None and self.zero_runs < 2:
            raise ValueError(f"zero_runs is {self.zero_runs}; a run has at least 2 bursts")
        if self.outliers is not None:
            require_positive("outliers (standard deviations)", self.outliers)


Found = tuple[Tensor, dict[str, int]]  # what a filter keeps, bool, (N,), and drops, by reason


def validate_bursts(record: BurstRecord, filters: BurstFilters | None = None) -> BurstRecord:
    """The record without the bursts that the filters refuse; each is counted in ``dropped``.

    Order: times, runs of zeros, outliers: a run is one in the order of time, and outliers are
    judged by what is left. A filter sees only what the ones before it kept.

    Raises:
        ValueError: nothing would be left, or the times run backwards.
    """
    filters = filters or BurstFilters()
    if filters.times:
        record = record.keep(*time_filter(record))
    if filters.zero_runs is not None:
        record = record.keep(*zero_run_filter(record, filters.zero_runs))
    if filters.outliers is not None:
        record = record.keep(*outlier_filter(record, filters.outliers))
    return record


def time_filter(record: BurstRecord) -> Found:
    """Bursts later than all before them; of equal times the first stays.

    Raises:
        ValueError: most bursts are not: then the order is wrong, not some bursts.
    """
    time = record.arrival_time
    latest = torch.cummax(time, 0).values
    step = torch.cat([torch.ones(1, dtype=time.dtype), time[1:] - latest[:-1]])
    repeated, backwards = int((step == 0).sum()), int((step < 0).sum())
    if 2 * backwards > record.bursts:
        raise ValueError(
            f"{record.name}: {backwards} of {record.bursts} bursts come before an earlier one: the "
            "times run backwards, or several records stand one after another; sort or split them"
        )
    if 2 * repeated > record.bursts:
        raise ValueError(
            f"{record.name}: {repeated} of {record.bursts} arrival times repeat the one before; "
            "the column is no arrival time, or was written with too few digits"
        )
    return step > 0, {BACKWARDS: backwards, REPEATED: repeated}


def zero_run_filter(record: BurstRecord, shortest: int) -> Found:
    """No runs of ``shortest`` exact zeros in a component: an unvalidated channel writes 0.00.

    Chance makes runs too where the resolution is coarse: of N bursts with a share p of zeros,
    independent, about N (1 - p) p^m runs of m or more.
    """
    keep = torch.ones(record.bursts, dtype=torch.bool)
    for values in record.components.values():
        keep &= run_lengths(values == 0) < shortest
    return keep, {ZERO_RUN: int((~keep).sum())}


def run_lengths(flag: Tensor) -> Tensor:
    """Length of the run of True to which each element belongs, 0 where False, (N,)."""
    starts = torch.cat([torch.ones(1, dtype=torch.bool), flag[1:] != flag[:-1]])
    member = starts.cumsum(0) - 1
    return torch.where(flag, torch.bincount(member)[member], 0)


def outlier_filter(record: BurstRecord, limit: float) -> Found:
    """No bursts ``limit`` standard deviations, by the median absolute deviation, off the median.

    Both medians are weighted by transit time, so that many fast bursts do not draw them. A
    deviation below the resolution counts as the resolution: where more than half of the
    values are equal the median deviation is 0 and says nothing.
    """
    keep = torch.ones(record.bursts, dtype=torch.bool)
    for values in record.components.values():
        centre = weighted_median(values, record.weights)
        away = (values - centre).abs()
        spread = GAUSSIAN_MAD * weighted_median(away, record.weights)
        keep &= away <= limit * torch.clamp(spread, min=resolution(values))
    return keep, {OUTLIER: int((~keep).sum())}


def weighted_median(values: Tensor, weights: Tensor) -> Tensor:
    """Smallest value (N,) at which half of the weight, (N,), at least 0, is reached, 0-d."""
    order = values.argsort()
    reached = weights[order].cumsum(0)
    place = torch.searchsorted(reached, reached[-1] / 2)
    return values[order[place.clamp(max=len(values) - 1)]]


def resolution(values: Tensor) -> float:
    """Smallest step between distinct values, in their unit; 0 with fewer than two."""
    distinct = values.unique()
    return float(distinct.diff().min()) if len(distinct) > 1 else 0.0


def pair_coincident(first: Tensor, second: Tensor, window: float) -> tuple[Tensor, Tensor]:
    """Bursts of two channels that belong to the same particle.

    Each burst takes the nearest of the other channel; a pair counts where the choice is mutual
    and no further apart than the window, so that no burst is used twice.

    Args:
        first, second: arrival times, s, increasing, (N,), (M,).  window: s, largest difference.
    Returns:
        Indices of the pairs into ``first`` and ``second``, each (P,).
    Raises:
        ValueError: the window is not above 0.
    """
    require_positive("coincidence window (s)", window)
    there, back = _nearest(first, second), _nearest(second, first)
    mine = torch.arange(len(first))
    mutual = (back[there] == mine) & ((second[there] - first).abs() <= window)
    return mine[mutual], there[mutual]


def _nearest(times: Tensor, others: Tensor) -> Tensor:
    """Index of the nearest of ``others``, increasing, to each of ``times``."""
    right = torch.searchsorted(others, times).clamp(max=len(others) - 1)
    left = (right - 1).clamp(min=0)
    return torch.where((times - others[left]).abs() <= (times - others[right]).abs(), left, right)
