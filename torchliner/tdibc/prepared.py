"""A plane ready to be replayed."""

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
from torchliner.replay.lines import interpolation_error
from torchliner.replay.survey import Survey
from torchliner.signals.blocks import Blocks
from torchliner.signals.tones import WindowSums
from torchliner.tdibc.choices import Choices

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Prepared:
    """A plane after the first pass, with all that a replay needs.

    Args:
        plane, liner, chosen: as given.
        frequency: Hz, (F,).
        record: window and edge rule.
        cells: probes by cell. In every tensor over columns the C cell averages follow the P
            probes and, for the order ``coherent first``, the probes once more with the coherent
            velocity of their cells: N = P + C or 2 P + C.
        used: probes without faults, (P,).
        survey: first pass, over all columns.
        drive: |v| for the engines.
        sent: incident signal on the record, (n,); None for tones.
        blocks: of the record, for error bars; None where there are none.
        grid: velocity levels.
        kernels: None where no impulse response is needed.
        notes: warnings so far.
    """

    plane: VelocityPlane
    liner: LinerModel
    chosen: Choices
    frequency: Tensor
    record: Record
    cells: Cells
    used: Tensor
    survey: Survey
    drive: DriveSpeed
    sent: Tensor | None
    blocks: Blocks | None
    grid: VelocityGrid
    kernels: KernelTable | None
    notes: tuple[str, ...]

    @functools.cached_property
    def window_sums(self) -> WindowSums:
        """The window's own sums at each frequency, on the device of the drive."""
        window = WindowSums.of(
            self.record.window.weights, self.record.start, self.frequency, self.plane.sampling_rate
        )
        device = self.drive.device
        return WindowSums(window.zero.to(device), window.twice.to(device))

    @functools.cached_property
    def level_error(self) -> float | None:
        """Largest error in R of the interpolation between levels, where it enters; else None."""
        if not self.chosen.uses_kernel_response and (
            self.liner.speed_law(self.frequency) is not None
        ):
            return None
        with torch.no_grad():
            return max(
                interpolation_error(self.liner, f, self.grid) for f in self.frequency.tolist()
            )

    @property
    def averaged(self) -> slice:
        """The columns of the cell averages."""
        return slice(self.plane.probes, self.plane.probes + self.cells.count)

    @property
    def in_cells(self) -> Tensor:
        """Probes without faults that belong to a cell, (P,)."""
        return self.used & (self.cells.labels >= 0)

    @property
    def velocity_amplitude(self) -> Tensor:
        """Half the complex peak amplitude of v into the liner (which is -v), m/s, (N, F)."""
        return self.window_sums.tone_amplitude(-self.survey.line)

    def whole_speed(self) -> Tensor:
        """All of |v| at once, (N, n), for the reference engine."""
        slabs = self.drive.slabs([(0, self.drive.samples)])
        return torch.cat([part.speed for slab in slabs for part in slab], dim=1).T
