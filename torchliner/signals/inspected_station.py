"""A station of bursts as read, as kept, and what makes it doubtful: no average takes it unless
asked to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from torchliner.records import BurstRecord
from torchliner.signals.burst_moments import BurstMoments, ComponentMoments, burst_moments
from torchliner.signals.burst_validation import BurstFilters, resolution, validate_bursts

MOST_ZEROS = 0.25  # share of exact zeros in a component
MOST_DROPPED = 0.10  # share of the bursts
GAP_CHANCE = 1e-3  # of a gap so long in a Poisson process of the same rate
MOST_ROUNDING = 0.05  # share of the variance
FEWEST_PER_PERIOD = 2.0  # bursts in a period of the tone


@dataclass(frozen=True)
class Station:
    """One station.

    Args:
        raw, kept: bursts as read, and those that pass the filters.  moments: of those kept.
        flags: why it cannot be trusted, in words.
    """

    raw: BurstRecord
    kept: BurstRecord
    moments: BurstMoments
    flags: list[str]

    @property
    def zero_shares(self) -> dict[str, float]:
        """Share of velocities that are exactly 0, 0 to 1, by component, of those read."""
        return _zero_shares(self.raw)

    @property
    def name(self) -> str:
        """Its title, or the name of its file."""
        return self.kept.title or self.kept.name

    def component(self, name: str) -> ComponentMoments | None:
        """Moments of ``wall_normal`` or ``streamwise``, if it was measured."""
        return self.moments.components.get(name)


def inspect_stations(records: Sequence[BurstRecord], filters: BurstFilters | None = None) -> list[Station]:
    """Validate each station as read, take its moments and judge it."""
    kept = [validate_bursts(raw, filters) for raw in records]
    found = [burst_moments(each) for each in kept]
    return [
        Station(raw, each, moments, station_flags(raw, each, moments))
        for raw, each, moments in zip(records, kept, found, strict=True)
    ]


def station_flags(raw: BurstRecord, kept: BurstRecord, found: BurstMoments) -> list[str]:
    """Doubts about a station in words, each with its number and limit.

    Zeros are counted in ``raw``, before any are dropped; ``found`` are the moments of ``kept``.
    """
    flags = []
    for name, share in _zero_shares(raw).items():
        if share > MOST_ZEROS:
            flags.append(
                f"{100 * share:.0f} % of {name} are exactly 0 (limit {100 * MOST_ZEROS:g} %): not "
                "validated, or the wall's light; dropping them does not mend the rest"
            )
    gone = 1 - kept.bursts / kept.received
    if gone > MOST_DROPPED:
        flags.append(f"{100 * gone:.0f} % of the bursts dropped (limit {100 * MOST_DROPPED:g} %)")
    for name, moments in found.components.items():
        values = raw.components[name]
        if float(values.min()) == float(values.max()):
            flags.append(f"{name} is constant, {float(values[0]):g} m/s: a dead channel")
            continue
        step = resolution(values)
        # Rounding to a step d adds d^2/12 to the variance.
        share = step**2 / 12 / moments.rms**2 if moments.rms > 0 else math.inf
        if share > MOST_ROUNDING:
            flags.append(
                f"{name} is resolved to {step:g} m/s: rounding alone is "
                f"{'all' if share >= 1 else f'{100 * share:.0f} %'} of its variance "
                f"(limit {100 * MOST_ROUNDING:g} %)"
            )
    if not found.rate > 0:
        return [*flags, f"{kept.bursts} bursts: no rate, no intervals"]
    # The longest of N exponential intervals exceeds g with a chance of about N exp(-rate g).
    chance = (kept.bursts - 1) * math.exp(-found.rate * found.longest_gap)
    if chance < GAP_CHANCE:
        flags.append(
            f"a gap of {1e3 * found.longest_gap:.3g} ms, {found.rate * found.longest_gap:.3g} mean "
            f"intervals (chance in a Poisson process {chance:.0e}, limit {GAP_CHANCE:g})"
        )
    if kept.frequency is not None and found.rate < FEWEST_PER_PERIOD * kept.frequency:
        flags.append(
            f"{found.rate / kept.frequency:.2g} bursts a period of {kept.frequency:g} Hz (limit {FEWEST_PER_PERIOD:g})"
        )
    return flags


def _zero_shares(record: BurstRecord) -> dict[str, float]:
    return {n: float((v == 0).sum()) / record.bursts for n, v in record.components.items()}
