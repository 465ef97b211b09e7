"""Moments of the bursts of a station, when they came, and what makes the station doubtful."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.bursts.filters import BurstFilters, resolution, validate_bursts
from torchliner.records import BurstRecord

MOST_ZEROS = 0.25  # share of exact zeros in a component
MOST_DROPPED = 0.10  # share of the bursts
GAP_CHANCE = 1e-3  # of a gap so long in a Poisson process of the same rate
MOST_ROUNDING = 0.05  # share of the variance
FEWEST_PER_PERIOD = 2.0  # bursts in a period of the tone


@dataclass(frozen=True)
class ComponentMoments:
    """Of one velocity component; central moments about the mean of the same weighting.

    Args:
        mean, rms: m/s.  third: mean of the cube of the fluctuation, m3/s3.
        weighted_mean, weighted_rms, weighted_third: the same with transit times as weights.
    """

    mean: float
    rms: float
    third: float
    weighted_mean: float
    weighted_rms: float
    weighted_third: float

    @property
    def velocity_bias(self) -> float:
        """Arithmetic less weighted mean, m/s: what fast particles, being more, add to the mean."""
        return self.mean - self.weighted_mean


@dataclass(frozen=True)
class BurstMoments:
    """Of one station.

    Args:
        components: by name.
        weighted: whether transit times were recorded; without them both weightings are one.
        duration: from the first to the last burst, s.
        rate: intervals over duration, 1/s; nan with one burst or no duration.  longest_gap: s.
        irregularity: standard deviation over mean of the intervals: 1 for a Poisson process.
    """

    components: dict[str, ComponentMoments]
    weighted: bool
    duration: float
    rate: float
    longest_gap: float
    irregularity: float


def burst_moments(record: BurstRecord) -> BurstMoments:
    r"""Means, rms values and third moments, and the statistics of arrival, of bursts in the order of time.

    A particle is the likelier to arrive the faster the flow, so the mean over bursts favours fast ones;
    :math:`\sum v_i\tau_i/\sum\tau_i` with the transit times gives back the mean over time.
    """
    weights = (torch.ones_like(record.arrival_time), record.weights)
    components = {
        name: ComponentMoments(*(part for weight in weights for part in _moments(values, weight)))
        for name, values in record.components.items()
    }
    steps = record.arrival_time.diff()
    duration = float(steps.sum())
    about = (math.nan,) * 3
    if duration > 0:
        about = (len(steps) / duration, float(steps.max()), float(steps.std(correction=0) / steps.mean()))
    weighted = record.transit_time is not None and bool((record.transit_time > 0).any())
    return BurstMoments(components, weighted, duration, *about)


def _moments(values: Tensor, weights: Tensor) -> tuple[float, float, float]:
    share = weights / weights.sum()
    mean = (share * values).sum()
    rest = values - mean
    return float(mean), float((share * rest**2).sum().sqrt()), float((share * rest**3).sum())


@dataclass(frozen=True)
class Station:
    """One station as read, as kept, and judged.

    Args:
        raw, kept: bursts as read, and those that pass the filters.
        moments: of those kept.
    """

    raw: BurstRecord
    kept: BurstRecord
    moments: BurstMoments

    @classmethod
    def of(cls, raw: BurstRecord, filters: BurstFilters | None = None) -> Station:
        """Validate bursts as read and take their moments."""
        kept = validate_bursts(raw, filters)
        return cls(raw, kept, burst_moments(kept))

    @property
    def name(self) -> str:
        """Its title, or the name of its file."""
        return self.kept.title or self.kept.name

    @property
    def zero_shares(self) -> dict[str, float]:
        """Share of velocities that are exactly 0, 0 to 1, by component, of those read."""
        return {name: float((v == 0).sum()) / self.raw.bursts for name, v in self.raw.components.items()}

    @functools.cached_property
    def flags(self) -> tuple[str, ...]:
        """Why it cannot be trusted, with number and limit: no average takes it unless asked to."""
        return tuple(self._flags())

    def _flags(self) -> Iterator[str]:
        kept, found = self.kept, self.moments
        for name, share in self.zero_shares.items():
            if share > MOST_ZEROS:
                yield f"{100 * share:.0f} % of {name} are exactly 0 (limit {100 * MOST_ZEROS:g} %): not validated?"
        gone = 1 - kept.bursts / kept.received
        if gone > MOST_DROPPED:
            yield f"{100 * gone:.0f} % of the bursts dropped (limit {100 * MOST_DROPPED:g} %)"
        for name, values in self.raw.components.items():
            step, rms = resolution(values), found.components[name].rms
            # Rounding to a step d adds d^2/12 to the variance.
            share = step**2 / 12 / rms**2 if rms > 0 else math.inf
            if step == 0:
                yield f"{name} is constant, {float(values[0]):g} m/s: a dead channel"
            elif share > MOST_ROUNDING:
                yield (
                    f"{name} is resolved to {step:g} m/s: rounding alone is {100 * min(share, 1):.0f} % of its "
                    f"variance (limit {100 * MOST_ROUNDING:g} %)"
                )
        if not found.rate > 0:
            yield f"{kept.bursts} bursts: no rate, no intervals"
            return
        # The longest of N exponential intervals exceeds g with a chance of about N exp(-rate g).
        gap = found.rate * found.longest_gap
        chance = (kept.bursts - 1) * math.exp(-gap)
        if chance < GAP_CHANCE:
            yield (
                f"a gap of {1e3 * found.longest_gap:.3g} ms, {gap:.3g} mean intervals (chance in a Poisson process "
                f"{chance:.0e}, limit {GAP_CHANCE:g})"
            )
        if kept.frequency is not None and found.rate < FEWEST_PER_PERIOD * kept.frequency:
            per_period = found.rate / kept.frequency
            yield f"{per_period:.2g} bursts a period of {kept.frequency:g} Hz (limit {FEWEST_PER_PERIOD:g})"
