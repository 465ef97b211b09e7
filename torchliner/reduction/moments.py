"""The record of moments: all that a plane has to say, in the size of some hundred time samples."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.names import resolve
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.reduction.basis import Basis
from torchliner.reduction.periodic import PeriodicPart
from torchliner.reduction.plan import PassPlan
from torchliner.reduction.speed_sums import GroupMoments
from torchliner.reduction.survey import Survey

SETTINGS = (  # of an eduction, that the moments contain
    "drive", "mean", "order", "pre_roll", "running_window", "oncoming_rms", "window",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class PlaneSums:
    """What the readings of a plane leave.

    Args:
        plan: pieces, blocks and rows of the pass.
        tones: Hz, of the survey's lines and coherence, (F,).
        survey: of all columns.
        cells: those that hold probes.
        used: probes without faults, (P,).
        periodic: what was taken off for the order ``coherent first``; None in other orders.
        basis: functions of |v|; None where no moments were summed.
        groups: moments of the probes, of the cells' velocities and, with a periodic part, of the
            probes with the coherent velocity of their cell.
    """

    plan: PassPlan
    tones: Tensor
    survey: Survey
    cells: Cells
    used: Tensor
    periodic: PeriodicPart | None
    basis: Basis | None
    groups: tuple[GroupMoments, ...]


class ReducedVelocity:
    """Stands where the velocity of a plane was of which moments alone are left."""

    def __init__(self, shape: tuple[int, ...], dtype: torch.dtype, name: str) -> None:
        self.shape, self.dtype, self.name = shape, dtype, name

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """Refused.

        Raises:
            ValueError: always.
        """
        raise ValueError(
            f"{self.name} holds moments of |v|; its {self.shape[-1]} time samples are gone, which "
            "this needs; take the plane that was reduced"
        )

    def load(self) -> Tensor:
        """Refused, as ``read``."""
        return self.read(0, self.shape[-1])


@dataclass(frozen=True, eq=False)
class Moments:
    """What ``torchliner.moments`` leaves of a plane: Z of any liner at any frequency from it.

    Args:
        plane: with everything but its velocity.
        sums: moments, survey and periodic part.
        settings: choices that went into them, by name: they cannot be chosen again.
        cell_pitch: L_c of the cells, m, or None.
        notes: warnings of the reduction.
    """

    plane: VelocityPlane
    sums: PlaneSums
    settings: dict[str, Any]
    cell_pitch: float | None
    notes: tuple[str, ...] = ()

    def educe(self, liner: Any, frequency: Any = None, **choices: Any) -> Any:
        """``torchliner.educe`` of these moments: the same map, without reading data."""
        return resolve("torchliner.tdibc.educe:educe")(self, liner, frequency, **choices)

    def write(self, path: str | Path) -> None:
        """Write one netCDF-4 file, which ``torchliner.read_moments`` reads (docs/formats.md)."""
        resolve("torchliner.io.moments_file:write_moments")(self, path)

    @property
    def size(self) -> int:
        """Bytes of the moments."""
        return sum(
            value.nbytes
            for group in self.sums.groups
            for each in fields(group)
            if (value := getattr(group, each.name)) is not None
        )
