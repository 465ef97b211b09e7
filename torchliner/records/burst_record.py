"""Velocity in, one burst at a time: what a laser Doppler system records at one station."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, field, replace
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.records.case import OfOneTone
from torchliner.records.checked import check
from torchliner.records.declared import ANY, record, var, variables_of
from torchliner.records.outlets import Written

AWAY = "away from the liner"  # the sign of velocities
COMPONENTS = ("wall_normal", "streamwise")


@record
class BurstRecord(Written, OfOneTone):
    """Bursts of one station: a particle's passage each, at random times.

    Arrival times may repeat or step back, as some files have them; ``validate_bursts`` drops such
    bursts and counts them. They are float64: float32 resolves 1 us for 16 s only. One component is needed.

    Args:
        dropped: bursts left out so far, by reason; they are no longer in the arrays.
        notes: warnings, with numbers.
    Raises:
        TypeError, ValueError: an array, a length or a value that no record has.
    """

    arrival_time: Any = var("burst", unit="s", kind="places", text="arrival of the particle")
    wall_normal: Any = var("burst", unit="m/s", name="wall_normal_velocity", kind="places", positive=AWAY, default=None)
    streamwise: Any = var(
        "burst", unit="m/s", name="streamwise_velocity", kind="places", text="downstream", default=None
    )
    transit_time: Any = var(
        "burst", unit="s", range="[0, inf)", kind="places", text="weight against velocity bias", default=None
    )
    _: KW_ONLY
    x: float | None = var(unit="m", range=ANY, text="streamwise coordinate of the station", default=None)
    y: float | None = var(unit="m", range=ANY, text="its distance from the liner", default=None)
    z: float | None = var(unit="m", range=ANY, text="its spanwise coordinate", default=None)
    dropped: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    name: str = "bursts"

    SCHEMA: ClassVar = "torchliner bursts 1"
    GROUPS: ClassVar = (SCHEMA, "station")  # schema of a file of several, name of each

    def __post_init__(self) -> None:
        if self.wall_normal is None and self.streamwise is None:
            raise ValueError(f"{self.name}: no velocity; give wall_normal, streamwise or both")
        check(self)
        if not self.bursts:
            raise ValueError(f"{self.name}: arrival_time is empty; at least one burst is needed")

    @property
    def bursts(self) -> int:
        """N, those still in the arrays."""
        return len(self.arrival_time)

    @property
    def received(self) -> int:
        """Bursts before any were dropped."""
        return self.bursts + sum(self.dropped.values())

    @property
    def components(self) -> dict[str, Tensor]:
        """The velocities there are, wall-normal first, m/s, each (N,)."""
        return {n: getattr(self, n) for n in COMPONENTS if getattr(self, n) is not None}

    @property
    def weights(self) -> Tensor:
        """Transit times, s, or ones where none were recorded or all are 0, (N,)."""
        if self.transit_time is None or not bool((self.transit_time > 0).any()):
            return torch.ones_like(self.arrival_time)
        return self.transit_time

    def keep(self, mask: Tensor, dropped: Mapping[str, int]) -> BurstRecord:
        """The bursts of a mask, bool, (N,); the others are counted in ``dropped``, by reason. A ValueError where
        nothing would be left."""
        counted = {reason: number for reason, number in dropped.items() if number}
        if bool(mask.all()):
            return self
        if not bool(mask.any()):
            raise ValueError(f"{self.name}: all {self.bursts} bursts would be dropped: {counted}")
        there = [row.field for row in variables_of(BurstRecord) if row.dims and getattr(self, row.field) is not None]
        arrays = {name: getattr(self, name)[mask] for name in there}
        total = {r: self.dropped.get(r, 0) + counted.get(r, 0) for r in [*self.dropped, *counted]}
        return replace(self, **arrays, dropped=total)
