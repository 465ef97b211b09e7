"""Which bursts count: times, runs of zeros, outliers; each filter can be switched off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
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
        runs = torch.stack([run_lengths(values == 0) for values in record.components.values()])
        bad = (runs >= filters.zero_runs).any(0)
        record = record.keep(~bad, {ZERO_RUN: int(bad.sum())})
    if filters.outliers is not None:
        bad = torch.stack([_outlying(v, record.weights, filters.outliers) for v in record.components.values()]).any(0)
        record = record.keep(~bad, {OUTLIER: int(bad.sum())})
    return record


def _in_order_of_time(record: BurstRecord) -> BurstRecord:
    """Bursts later than all before them; of equal times the first stays."""
    time = record.arrival_time
    step = torch.cat([time.new_ones(1), time[1:] - torch.cummax(time, 0).values[:-1]])
    counts = {BACKWARDS: int((step < 0).sum()), REPEATED: int((step == 0).sum())}
    for reason, remedy in (
        (BACKWARDS, "the times run backwards, or several records stand one after another; sort or split them"),
        (REPEATED, "the column is no arrival time, or was written with too few digits"),
    ):
        if 2 * counts[reason] > record.bursts:
            raise ValueError(f"{record.name}: {reason} at {counts[reason]} of {record.bursts} bursts; {remedy}")
    return record.keep(step > 0, counts)


def run_lengths(flag: Tensor) -> Tensor:
    """Length of the run of True to which each element belongs, 0 where False, (N,)."""
    starts = torch.cat([torch.ones(1, dtype=torch.bool), flag[1:] != flag[:-1]])
    member = starts.cumsum(0) - 1
    return torch.where(flag, torch.bincount(member)[member], 0)


def _outlying(values: Tensor, weights: Tensor, limit: float) -> Tensor:
    """Values beyond so many standard deviations of the median, bool, (N,)."""
    away = (values - weighted_median(values, weights)).abs()
    spread = GAUSSIAN_MAD * weighted_median(away, weights)
    # Where more than half of the values are equal the median deviation is 0 and says nothing.
    return away > limit * max(spread, resolution(values))


def weighted_median(values: Tensor, weights: Tensor) -> float:
    """Smallest value (N,) at which half of the weight, (N,), at least 0, is reached."""
    return float(np.quantile(values.numpy(), 0.5, weights=weights.numpy(), method="inverted_cdf"))


def resolution(values: Tensor) -> float:
    """Smallest step between distinct values, in their unit; 0 with fewer than two."""
    distinct = values.unique()
    return float(distinct.diff().min()) if len(distinct) > 1 else 0.0
