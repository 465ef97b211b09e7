"""Velocity in: wall-normal velocity at many probes over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, replace
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor
from torchliner.names import resolve
from torchliner.records.case import AtProbes
from torchliner.records.checked import signal_tensor
from torchliner.records.declared import record, var
from torchliner.records.outlets import Drawn, Written
from torchliner.records.slabs import StoredVelocity


@record
class VelocityPlane(Drawn, Written, AtProbes):
    """Wall-normal velocity at many probes, uniformly sampled in time.

    Args:
        velocity: m/s, positive AWAY from the liner; real floating tensor or array of shape (..., T)
            with probe axes (z, x), (x) or (probe); or a ``StoredVelocity``.
    Raises:
        TypeError, ValueError: velocity is not real floating point; a shape or a value that no plane has.
    """

    velocity: Any
    _: KW_ONLY
    height: float | None = var(unit="m", range="(0, inf)", text="distance of the plane from the liner", default=None)
    area: Any = var(
        "probes", unit="m2", kind="places", range="[0, inf)", text="area of each probe, in their order", default=None
    )
    name: str = "velocity"

    FILE: ClassVar = "torchliner.io.plane_writer:write_plane"
    PLOT: ClassVar = "torchliner.report.curves:draw_velocity"

    def __post_init__(self) -> None:
        if isinstance(self.velocity, Tensor) or not isinstance(self.velocity, StoredVelocity):
            object.__setattr__(self, "velocity", signal_tensor(self.velocity, f"{self.name}: velocity"))
        super().__post_init__()
        if self.area is not None and len(self.area) != self.probes:
            raise ValueError(f"{self.name}: area has {len(self.area)} values; {self.probes} are needed")

    @property
    def _shape(self) -> tuple[int, ...]:
        return tuple(self.velocity.shape)

    @classmethod
    def from_xarray(cls, data: Any, **stated: Any) -> VelocityPlane:
        """A plane from a DataArray or Dataset of xarray as CF has it (docs/formats.md); what is lazy there stays so.

        ``stated``: what it does not say, as for ``read_plane``, and fields of this record. Errors are those of
        ``read_plane``.
        """
        plane: VelocityPlane = resolve("torchliner.io.foreign:from_xarray")(data, **stated)
        return plane

    @property
    def device(self) -> torch.device:
        """Of the velocity; the CPU where that is in a file."""
        return self.velocity.device if isinstance(self.velocity, Tensor) else torch.device("cpu")

    def asked(self, frequency: Any = None) -> Tensor:
        """Frequencies asked for, else the tone that is stated, Hz, (F,); a ValueError where neither is known, or one is
        at or above half the sampling rate."""
        return frequency_tensor(frequency, self.sampling_rate, record=self).cpu()

    def read(self, begin: int, end: int) -> Tensor:
        """Samples begin .. end - 1 of every probe, (t, P); a view where the layout allows."""
        if isinstance(self.velocity, Tensor):
            slab = self.velocity.movedim(-1, 0)[begin:end]
            return slab.reshape(slab.shape[0], -1)
        return self.velocity.read(begin, end)

    def first_fault(self, probe: int) -> int:
        """The first sample that is nan or inf of a probe that is known to have one; its number among all."""
        for begin in range(0, self.samples, 1 << 14):
            wrong = ~torch.isfinite(self.read(begin, min(begin + (1 << 14), self.samples))[:, probe])
            if bool(wrong.any()):
                return begin + int(wrong.int().argmax())
        raise ValueError(f"{self.name}: sums of v^2 at probe {probe} are beyond the range of numbers; check the unit")

    def load(self) -> VelocityPlane:
        """The same plane with its velocity in memory."""
        return self if isinstance(self.velocity, Tensor) else replace(self, velocity=self.velocity.load())


def restated(plane: VelocityPlane, facts: Mapping[str, Any]) -> VelocityPlane:
    """With other facts about the case; numbers and names stand in the provenance, too."""
    said = {name: fact for name, fact in facts.items() if isinstance(fact, str | int | float)}
    told = {"restated": said} if said else {}
    return replace(plane, **facts, provenance={**plane.provenance, **told})
