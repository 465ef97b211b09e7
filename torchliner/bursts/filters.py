"""Which bursts count: times, runs of zeros, outliers; each filter can be switched off."""

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
        outliers: drop |v - median| above so many standard deviations, the latter taken from the median absolute
            deviation, both weighted by transit time.
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


def validate_bursts(record: BurstRecord, filters: BurstFilters | None = None) -> BurstRecord:
    """The record without the bursts that the filters refuse; each is counted in ``dropped``.

    Order: times, runs of zeros, outliers. A run is one in the order of time, and outliers are judged by what is left.

    Raises:
        ValueError: nothing would be left, or most times repeat or run backwards: then the file is wrong, not a burst.
    """
    filters = filters or BurstFilters()
    if filters.times:
        record = _in_order_of_time(record)
    if filters.zero_runs is not None:
        keep = torch.ones(record.bursts, dtype=torch.bool)
        for values in record.components.values():
            keep &= run_lengths(values == 0) < filters.zero_runs
        record = record.keep(keep, {ZERO_RUN: int((~keep).sum())})
    if filters.outliers is not None:
        keep = torch.ones(record.bursts, dtype=torch.bool)
        for values in record.components.values():
            away = (values - weighted_median(values, record.weights)).abs()
            spread = GAUSSIAN_MAD * weighted_median(away, record.weights)
            # Where more than half of the values are equal the median deviation is 0 and says nothing.
            keep &= away <= filters.outliers * torch.clamp(spread, min=resolution(values))
        record = record.keep(keep, {OUTLIER: int((~keep).sum())})
    return record


def _in_order_of_time(record: BurstRecord) -> BurstRecord:
    """Bursts later than all before them; of equal times the first stays."""
    time = record.arrival_time
    step = torch.cat([time.new_ones(1), time[1:] - torch.cummax(time, 0).values[:-1]])
    repeated, backwards = int((step == 0).sum()), int((step < 0).sum())
    if 2 * backwards > record.bursts:
        raise ValueError(
            f"{record.name}: {backwards} of {record.bursts} bursts come before an earlier one: the times run "
            "backwards, or several records stand one after another; sort or split them"
        )
    if 2 * repeated > record.bursts:
        raise ValueError(
            f"{record.name}: {repeated} of {record.bursts} arrival times repeat the one before; the column is no "
            "arrival time, or was written with too few digits"
        )
    return record.keep(step > 0, {BACKWARDS: backwards, REPEATED: repeated})


def run_lengths(flag: Tensor) -> Tensor:
    """Length of the run of True to which each element belongs, 0 where False, (N,)."""
    starts = torch.cat([torch.ones(1, dtype=torch.bool), flag[1:] != flag[:-1]])
    member = starts.cumsum(0) - 1
    return torch.where(flag, torch.bincount(member)[member], 0)


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
