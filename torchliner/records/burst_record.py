"""Velocity in, one burst at a time: what a laser Doppler system records at one station."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import make_plain, require_choice, require_positive_where_stated
from torchliner.fluid import Fluid
from torchliner.names import SOURCE_SIDES
from torchliner.records.outlets import Written
from torchliner.records.probes import signal_tensor
from torchliner.records.unit_checks import require_flow_and_level

UNITS = {"arrival_time": "s", "transit_time": "s", "wall_normal": "m/s", "streamwise": "m/s"}
COMPONENTS = ("wall_normal", "streamwise")


@dataclass(frozen=True, eq=False)
class BurstRecord(Written):
    """Bursts of one station: a particle's passage each, at random times.

    Arrival times may repeat or step back, as some files have them; ``validate_bursts`` drops such
    bursts and counts them.

    Args:
        arrival_time: s, (N,), float64 (float32 resolves 1 us for 16 s only).
        wall_normal: m/s, positive AWAY from the liner, (N,), or None.
        streamwise: m/s, positive downstream, (N,), or None; one of the two is needed.
        transit_time: s, at least 0, (N,): the weight against velocity bias; None if not recorded.
        x, y, z: of the station, m: along the liner, away from it, across; None where unknown.
        dropped: bursts left out so far, by reason; they are no longer in the arrays.
        fluid: gas of the data.
        frequency: tone, Hz.  incident_level: nominal SPL, dB.  mach: bulk Mach number.
        source_side: where the sound comes from, one of ``SOURCE_SIDES``.
        displacement_thickness: delta*, m.  liner: name of the liner below.
        reference: independent impedances of the same case, normalised, by name.
        title, provenance: where the data come from.
        notes: warnings, with numbers.
        name: how messages call it (a file's name).
    Raises:
        TypeError: an array is not real floating point.
        ValueError: no burst, no component, unequal lengths, values that are not finite, a negative
            transit time, a scalar out of range.
    """

    arrival_time: Any
    wall_normal: Any = None
    streamwise: Any = None
    transit_time: Any = None
    x: float | None = field(default=None, kw_only=True)
    y: float | None = field(default=None, kw_only=True)
    z: float | None = field(default=None, kw_only=True)
    dropped: Mapping[str, int] = field(default_factory=dict, kw_only=True)
    fluid: Fluid = field(default_factory=Fluid, kw_only=True)
    frequency: float | None = field(default=None, kw_only=True)
    incident_level: float | None = field(default=None, kw_only=True)
    mach: float | None = field(default=None, kw_only=True)
    source_side: str = field(default="unknown", kw_only=True)
    displacement_thickness: float | None = field(default=None, kw_only=True)
    liner: str = field(default="", kw_only=True)
    reference: Mapping[str, complex] = field(default_factory=dict, kw_only=True)
    title: str = field(default="", kw_only=True)
    provenance: Mapping[str, Any] = field(default_factory=dict, kw_only=True)
    notes: tuple[str, ...] = field(default=(), kw_only=True)
    name: str = field(default="bursts", kw_only=True)

    def __post_init__(self) -> None:
        make_plain(self)
        self._check_arrays()
        require_flow_and_level(self)
        for label in ("x", "y", "z"):
            value = getattr(self, label)
            if value is not None and not abs(value) < float("inf"):
                raise ValueError(f"{self.name}: {label} is {value}; a finite number is needed")
        require_positive_where_stated(self, "frequency", "displacement_thickness")
        require_choice(f"{self.name}: source_side", self.source_side, SOURCE_SIDES)
        for reason, count in self.dropped.items():
            if count < 0:
                raise ValueError(f"{self.name}: dropped[{reason!r}] is {count}; at least 0")

    def _check_arrays(self) -> None:
        if self.wall_normal is None and self.streamwise is None:
            raise ValueError(f"{self.name}: no velocity; give wall_normal, streamwise or both")
        for label, unit in UNITS.items():
            value = getattr(self, label)
            if value is None and label != "arrival_time":
                continue
            tensor = signal_tensor(value, label, self.name, unit).to(torch.float64)
            if tensor.ndim != 1 or len(tensor) == 0:
                raise ValueError(
                    f"{self.name}: {label} has shape {tuple(tensor.shape)}; a list of at least one burst is needed"
                )
            if label != "arrival_time" and len(tensor) != self.bursts:
                raise ValueError(
                    f"{self.name}: {label} has {len(tensor)} values, arrival_time {self.bursts}; "
                    "they belong to the same bursts"
                )
            bad = ~torch.isfinite(tensor)
            if bool(bad.any()):
                raise ValueError(
                    f"{self.name}: {label} holds {int(bad.sum())} values that are not finite, the "
                    f"first at burst {int(bad.nonzero()[0])}; leave those bursts out"
                )
            object.__setattr__(self, label, tensor)
        if self.transit_time is not None and bool((self.transit_time < 0).any()):
            worst = int(self.transit_time.argmin())
            raise ValueError(
                f"{self.name}: transit_time is {float(self.transit_time[worst]):g} s at burst {worst}; it is at least 0"
            )

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
    def position(self) -> tuple[float, float, float] | None:
        """(x, y, z), m, if all three are known."""
        if self.x is None or self.y is None or self.z is None:
            return None
        return (self.x, self.y, self.z)

    @property
    def weights(self) -> Tensor:
        """Transit times, s, or ones where none were recorded or all are 0, (N,)."""
        if self.transit_time is None or not bool((self.transit_time > 0).any()):
            return torch.ones_like(self.arrival_time)
        return self.transit_time

    def keep(self, mask: Tensor, dropped: Mapping[str, int]) -> BurstRecord:
        """The bursts of a mask; the others are counted.

        Args:
            mask: bool, (N,).
            dropped: how many are left out for which reason, in words.
        Raises:
            ValueError: the counts are not those of the mask, or nothing would be left.
        """
        count = int((~mask).sum())
        if count != sum(dropped.values()):
            raise ValueError(f"{self.name}: {count} bursts are masked, {dict(dropped)} counted")
        if count == 0:
            return self
        counted = {reason: number for reason, number in dropped.items() if number}
        if count == self.bursts:
            raise ValueError(f"{self.name}: all {count} bursts would be dropped: {counted}")
        arrays = {n: v[mask] for n in UNITS if (v := getattr(self, n)) is not None}
        total = {r: self.dropped.get(r, 0) + counted.get(r, 0) for r in [*self.dropped, *counted]}
        return replace(self, **arrays, dropped=total)
