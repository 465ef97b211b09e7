"""A plane after the first pass, and ready to be replayed."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.replay.drive import DriveSpeed
from torchliner.replay.edges import Record
from torchliner.replay.kernels import KernelTable
from torchliner.replay.levels import VelocityGrid
from torchliner.replay.survey import Survey
from torchliner.signals.blocks import Blocks
from torchliner.signals.tones import WindowSums
from torchliner.tdibc.choices import Choices

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Examined:
    """A plane after the first pass.

    Args:
        plane: as given.
        frequency: Hz, (F,).
        record: window and edge rule.
        cells: probes by cell; the cell averages follow the probes in every (P + C, ...) tensor.
        used: probes without faults, (P,).
        seen: first pass, over probes and cell averages.
        drive: |v| for the engines.
        sent: incident signal on the record, (n,); None for tones.
        blocks: of the record, for error bars; None where there are none.
        notes: doubts so far.
    """

    plane: VelocityPlane
    frequency: Tensor
    record: Record
    cells: Cells
    used: Tensor
    seen: Survey
    drive: DriveSpeed
    sent: Tensor | None
    blocks: Blocks | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Prepared(Examined):
    """A plane ready to be replayed.

    Args:
        liner, chosen: as given.
        grid: velocity levels.
        kernels: None where no impulse response is needed.
    """

    liner: LinerModel
    chosen: Choices
    grid: VelocityGrid
    kernels: KernelTable | None

    @functools.cached_property
    def window_sums(self) -> WindowSums:
        """The window's own sums at each frequency, on the device of the drive."""
        window = WindowSums.of(
            self.record.window.weights, self.record.start, self.frequency, self.plane.sampling_rate
        )
        device = self.drive.device
        return WindowSums(window.zero.to(device), window.twice.to(device))

    @property
    def velocity_amplitude(self) -> Tensor:
        """Half the complex peak amplitude of v into the liner (which is -v), m/s, (P + C, F)."""
        return self.window_sums.tone_amplitude(-self.seen.line)

    def whole_speed(self) -> Tensor:
        """All of |v| at once, (P + C, n), for the reference engine."""
        slabs = self.drive.slabs([(0, self.drive.samples)])
        return torch.cat([part.speed for slab in slabs for part in slab], dim=1).T
