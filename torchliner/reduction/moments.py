"""The record of moments: all that a plane has to say, of the size of a few time samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.reduction.basis import Chebyshev, Levels
from torchliner.reduction.periodic import PeriodicPart
from torchliner.reduction.plan import PassPlan
from torchliner.reduction.speed_sums import GroupMoments
from torchliner.reduction.survey import Survey


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
    basis: Chebyshev | Levels | None
    groups: tuple[GroupMoments, ...]
