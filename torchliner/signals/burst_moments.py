"""Moments of bursts, plain and weighted by transit time, and when the bursts came."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.records import BurstRecord

HISTOGRAM_REACH, HISTOGRAM_BINS = 8.0, 32  # in mean intervals


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
    r"""Means, rms values and third moments, and the statistics of arrival.

    A particle is the likelier to arrive the faster the flow, so the mean over bursts favours fast
    ones; :math:`\sum v_i\tau_i/\sum\tau_i` with the transit times gives back the mean over time.

    Args:
        record: bursts in the order of time.
    """
    plain = torch.ones_like(record.arrival_time)
    components = {
        name: ComponentMoments(*_moments(values, plain), *_moments(values, record.weights))
        for name, values in record.components.items()
    }
    steps = record.arrival_time.diff()
    duration = float(steps.sum())
    known = len(steps) > 0 and duration > 0
    nan = float("nan")
    return BurstMoments(
        components, record.transit_time is not None and bool((record.transit_time > 0).any()),
        duration, len(steps) / duration if known else nan, float(steps.max()) if known else nan,
        float(steps.std(correction=0) / steps.mean()) if known else nan,
    )  # fmt: skip


def _moments(values: Tensor, weights: Tensor) -> tuple[float, float, float]:
    share = weights / weights.sum()
    mean = (share * values).sum()
    rest = values - mean
    square, cube = (share * rest**2).sum(), (share * rest**3).sum()
    return float(mean), float(square.sqrt()), float(cube)


def interval_histogram(record: BurstRecord) -> tuple[Tensor, Tensor]:
    """Histogram of the times between bursts, 32 bins up to 8 mean intervals.

    Args:
        record: at least two bursts in the order of time.
    Returns:
        Edges of the bins, s, (B + 1,); share of the intervals per second, 1/s, (B,).
    Raises:
        ValueError: fewer than two bursts, or times that do not increase.
    """
    steps = record.arrival_time.diff()
    if len(steps) == 0 or float(steps.min()) < 0 or float(steps.sum()) <= 0:
        raise ValueError(
            f"{record.name}: a histogram of intervals needs at least two bursts in the order of "
            "time; validate_bursts drops the others"
        )
    reach = HISTOGRAM_REACH * float(steps.mean())
    edges = torch.linspace(0, reach, HISTOGRAM_BINS + 1, dtype=torch.float64)
    counts, _ = torch.histogram(steps[steps < edges[-1]], edges)
    return edges, counts / (len(steps) * edges.diff())
