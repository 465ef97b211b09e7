"""Which bursts of a station count, their moments, and what makes the station doubtful."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import require_choice
from torchliner.names import FILTERS
from torchliner.records import BurstRecord

GAUSSIAN_MAD = 1.4826  # standard deviation over median absolute deviation, 1 / Phi^-1(3/4)
REPEATED, BACKWARDS = "repeated time", "time runs backwards"
ZERO_RUN, OUTLIER = "run of exact zeros", "outlier"
LEAST_RUN, MOST_DEVIATIONS = 10, 6.0  # of bursts; standard deviations
MOST_ZEROS = 0.25  # share of exact zeros in a component
MOST_DROPPED = 0.10  # share of the bursts
GAP_CHANCE = 1e-3  # of a gap so long in a Poisson process of the same rate
MOST_ROUNDING = 0.05  # share of the variance
FEWEST_PER_PERIOD = 2.0  # bursts in a period of the tone


def validate_bursts(record: BurstRecord, without: Collection[str] = ()) -> BurstRecord:
    """The record without the bursts that filters refuse, one filter after another; each is counted in ``dropped``.

    ``times`` drops bursts that do not come after all before them, ``zero-runs`` runs of 10 and more successive bursts
    with a component of exactly 0, ``outliers`` |v - median| above 6 standard deviations, the latter taken from the
    median absolute deviation, both weighted by transit time.

    Args:
        without: filters that are switched off.
    Raises:
        ValueError: nothing would be left.
    """
    for name in without:
        require_choice("filter", name, FILTERS)
    if "times" not in without:
        time = record.arrival_time
        step = torch.cat([time.new_ones(1), time[1:] - torch.cummax(time, 0).values[:-1]])
        record = record.keep(step > 0, {BACKWARDS: int((step < 0).sum()), REPEATED: int((step == 0).sum())})
    for name, (reason, refused) in {"zero-runs": (ZERO_RUN, _silent), "outliers": (OUTLIER, _outlying)}.items():
        if name not in without:
            bad = torch.stack([refused(values, record.weights) for values in record.components.values()]).any(0)
            record = record.keep(~bad, {reason: int(bad.sum())})
    return record


def _silent(values: Tensor, _: Tensor) -> Tensor:
    """Exact zeros in a run of many, bool, (N,)."""
    _, member, count = torch.unique_consecutive(values == 0, return_inverse=True, return_counts=True)
    return (values == 0) & (count[member] >= LEAST_RUN)


def _outlying(values: Tensor, weights: Tensor) -> Tensor:
    """Values too many standard deviations off the median, bool, (N,)."""

    def median(of: Tensor) -> float:
        return float(np.quantile(of.numpy(), 0.5, weights=weights.numpy(), method="inverted_cdf"))

    away = (values - median(values)).abs()
    # Where more than half of the values are equal the median deviation is 0 and says nothing.
    return away > MOST_DEVIATIONS * max(GAUSSIAN_MAD * median(away), _resolution(values))


def _resolution(values: Tensor) -> float:
    """Smallest step between distinct values, in their unit; 0 with fewer than two."""
    steps = values.unique().diff()
    return float(steps.min()) if len(steps) else 0.0


@dataclass(frozen=True)
class ComponentMoments:
    """Mean and rms, m/s, plain and by transit time."""

    mean: float
    rms: float
    weighted_mean: float
    weighted_rms: float

    @property
    def velocity_bias(self) -> float:
        """Arithmetic less weighted mean, m/s: what fast particles, being more, add to the mean."""
        return self.mean - self.weighted_mean


@dataclass(frozen=True)
class BurstMoments:
    """Of one station; ``irregularity`` of the intervals is 1 for a Poisson process."""

    components: dict[str, ComponentMoments]
    weighted: bool  # whether transit times were recorded; without them both weightings are one
    duration: float  # from the first to the last burst, s
    rate: float  # intervals over duration, 1/s; nan with one burst or no duration
    longest_gap: float  # s
    irregularity: float  # standard deviation over mean of the intervals


def burst_moments(record: BurstRecord) -> BurstMoments:
    r"""Means, rms values and the statistics of arrival, of bursts in the order of time.

    A particle is the likelier to arrive the faster the flow, so the mean over bursts favours fast ones;
    :math:`\sum v_i\tau_i/\sum\tau_i` with the transit times gives back the mean over time.
    """
    components = {}
    for name, values in record.components.items():
        found = []
        for weights in (torch.ones_like(values), record.weights):
            share = weights / weights.sum()
            mean = (share * values).sum()
            found += [float(mean), float((share * (values - mean) ** 2).sum().sqrt())]
        components[name] = ComponentMoments(*found)
    steps = record.arrival_time.diff()
    duration, about = float(steps.sum()), (math.nan,) * 3
    if duration > 0:
        about = (len(steps) / duration, float(steps.max()), float(steps.std(correction=0) / steps.mean()))
    weighted = record.transit_time is not None and bool((record.transit_time > 0).any())
    return BurstMoments(components, weighted, duration, *about)


@dataclass(frozen=True)
class Station:
    """One station: the bursts that pass the filters, their moments, and why they cannot be trusted.

    ``flags`` state number and limit; no average takes a flagged station unless asked to.
    """

    kept: BurstRecord
    moments: BurstMoments
    flags: tuple[str, ...]

    @classmethod
    def of(cls, raw: BurstRecord, without: Collection[str] = ()) -> Station:
        """Validate bursts as read and take their moments."""
        kept = validate_bursts(raw, without)
        moments = burst_moments(kept)
        return cls(kept, moments, tuple(_flags(raw, kept, moments)))

    @property
    def name(self) -> str:
        """Its title, or the name of its file."""
        return self.kept.title or self.kept.name


def _flags(raw: BurstRecord, kept: BurstRecord, moments: BurstMoments) -> Iterator[str]:
    for name, values in raw.components.items():
        if (share := float((values == 0).double().mean())) > MOST_ZEROS:
            yield f"{100 * share:.0f} % of {name} are exactly 0 (limit {100 * MOST_ZEROS:g} %): not validated?"
        # Rounding to a step d adds d^2/12 to the variance.
        step, rms = _resolution(values), moments.components[name].rms
        rounding = min(1, step**2 / 12 / rms**2 if rms > 0 else 1)
        if step == 0 or rounding > MOST_ROUNDING:
            text = f"rounding alone is {100 * rounding:.0f} % of its variance (limit {100 * MOST_ROUNDING:g} %)"
            yield f"{name} is resolved to {step:g} m/s: {text}" if step else f"{name} is constant, {values[0]:g} m/s"
    if (gone := 1 - kept.bursts / kept.received) > MOST_DROPPED:
        yield f"{100 * gone:.0f} % of the bursts dropped (limit {100 * MOST_DROPPED:g} %)"
    rate, gap = moments.rate, moments.rate * moments.longest_gap
    # The longest of N exponential intervals exceeds g with a chance of about N exp(-rate g).
    chance = (kept.bursts - 1) * math.exp(-gap)
    if chance < GAP_CHANCE:
        text = f"chance in a Poisson process {chance:.0e}, limit {GAP_CHANCE:g}"
        yield f"a gap of {1e3 * moments.longest_gap:.3g} ms, {gap:.3g} mean intervals ({text})"
    if kept.frequency is not None and rate < FEWEST_PER_PERIOD * kept.frequency:
        periods = f"{rate / kept.frequency:.2g} bursts a period of {kept.frequency:g} Hz"
        yield f"{periods} (limit {FEWEST_PER_PERIOD:g})"
