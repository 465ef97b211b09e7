"""A station of bursts as read, as kept, and whether it can be used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from torchliner.records import BurstRecord
from torchliner.signals.burst_flags import station_flags, zero_shares
from torchliner.signals.burst_moments import BurstMoments, ComponentMoments, burst_moments
from torchliner.signals.burst_validation import BurstFilters, validate_bursts


@dataclass(frozen=True)
class Station:
    """One station.

    Args:
        raw, kept: bursts as read, and those that pass the filters.
        moments: of those kept.
        flags: why it cannot be trusted, in words.
        zero_shares: share of velocities that are exactly 0, by component, of those read.
    """

    raw: BurstRecord
    kept: BurstRecord
    moments: BurstMoments
    flags: list[str]
    zero_shares: dict[str, float]

    @property
    def name(self) -> str:
        """Its title, or the name of its file."""
        return self.kept.title or self.kept.name

    def component(self, name: str) -> ComponentMoments | None:
        """Moments of ``wall_normal`` or ``streamwise``, if it was measured."""
        return self.moments.components.get(name)


def inspect_stations(
    records: Sequence[BurstRecord], filters: BurstFilters | None = None
) -> list[Station]:
    """Validate each station, take its moments and judge it.

    Args:
        records: stations as read.
        filters: what is dropped before moments are taken.
    """
    stations = []
    for raw in records:
        kept = validate_bursts(raw, filters)
        found = burst_moments(kept)
        flags = station_flags(raw, kept, found)
        stations.append(Station(raw, kept, found, flags, zero_shares(raw)))
    return stations
