"""A plane ready to be replayed."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.reduction.basis import Response, response_of
from torchliner.reduction.drive import DriveSpeed
from torchliner.reduction.line_means import LineReader
from torchliner.reduction.moments import PlaneSums
from torchliner.reduction.periodic import PeriodicPart
from torchliner.reduction.survey import Survey
from torchliner.replay.edges import Record
from torchliner.replay.incident import LineSums
from torchliner.replay.kernels import KernelTable, build_kernels
from torchliner.replay.levels import VelocityGrid
from torchliner.signals.blocks import Blocks
from torchliner.signals.tones import WindowSums, line_sums
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
        drive: |v| for the engines that form the reflected signal; None for data already reduced.
        sums: what the readings of the plane left.
        reader: lines at ``frequency`` from the moments; None without moments.
        model_error: largest error in R of the interpolation over |v| behind ``reader``.
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
    drive: DriveSpeed | None
    sums: PlaneSums
    reader: LineReader | None
    model_error: float | None
    sent: Tensor | None
    blocks: Blocks | None
    grid: VelocityGrid
    kernels: KernelTable | None
    notes: tuple[str, ...]

    @property
    def top_speed(self) -> float:
        """Largest |v| of the data, no more than the liner knows, m/s."""
        return top_speed(self.survey, self.liner)

    def response(self, liner: LinerModel) -> Response:
        """R of another liner, by the model or by impulse responses as chosen."""
        if self.kernels is None:
            return response_of(liner)
        old = self.kernels
        return kernel_response(build_kernels(liner, old.grid, old.sampling_rate, kind=old.kind, band=old.band))

    def read_with(self, response: Response) -> LineSums:
        """``line_sums`` of another response on the same moments."""
        assert self.reader is not None
        return dataclasses.replace(self, reader=self.reader.of(response)).line_sums

    @functools.cached_property
    def window_sums(self) -> WindowSums:
        """The window's own sums at each frequency, on the device of the drive."""
        window = WindowSums.of(self.record.window.weights, self.record.start, self.frequency, self.plane.sampling_rate)
        device = self.device
        turned = None
        if self.reader is not None and self.reader.turns.shape[1] > 1:
            turns, weights = self.reader.turns, self.record.window.weights
            found = line_sums(weights, turns.flatten(), self.plane.sampling_rate, self.record.start)
            turned = found.reshape(turns.shape).to(device)
        return WindowSums(window.zero.to(device), window.twice.to(device), turned)

    @functools.cached_property
    def line_sums(self) -> LineSums:
        """Windowed lines of the replies to complex tones, from the moments, of all columns."""
        assert self.reader is not None
        forward = torch.cat([self.reader.forward(group) for group in self.sums.groups])
        turned = torch.cat([self.reader.turned(group) for group in self.sums.groups])
        return LineSums.with_turns(forward, turned)

    def block_means(self, columns: slice) -> LineSums | None:
        """Means of R and what turns over blocks, (S, columns, F); None if not kept."""
        if self.reader is None:
            return None
        found, at = [], 0
        for group in self.sums.groups:
            width = group.totals.shape[-1]
            low, high = max(columns.start - at, 0), min(columns.stop - at, width)
            at += width
            if low < high:
                part = self.reader.of_blocks(group.part(slice(low, high)))
                if part is None:
                    return None
                found.append(part)
        forward, turned = (
            each[0] if len(each) == 1 else torch.cat(each, dim=1)  # which copies
            for each in zip(*found, strict=True)
        )
        return LineSums.with_turns(forward, turned)

    @property
    def keeps_blocks(self) -> bool:
        """Whether the moments of blocks are there."""
        return bool(self.sums.groups) and self.sums.groups[0].of_blocks is not None

    @property
    def periodic(self) -> PeriodicPart | None:
        """What was taken off for the order ``coherent first``."""
        return self.sums.periodic

    @property
    def device(self) -> torch.device:
        """Where the sums are."""
        return self.survey.mean.device

    @property
    def driving(self) -> DriveSpeed:
        """|v| for the engines that form the reflected signal."""
        assert self.drive is not None  # ``reduced`` refuses these engines for moments
        return self.drive

    @property
    def readings(self) -> int:
        """How often the samples were read through so far; of reduced data none are."""
        return 0 if self.drive is None else self.drive.velocity.readings

    @property
    def averaged(self) -> slice:
        """The columns of the cell averages."""
        return slice(self.plane.probes, self.plane.probes + self.cells.count)

    @property
    def in_cells(self) -> Tensor:
        """Probes without faults that belong to a cell, (P,)."""
        return self.used & (self.cells.labels >= 0)

    @functools.cached_property
    def velocity_amplitude(self) -> Tensor:
        """Half the complex peak amplitude of v into the liner (which is -v), m/s, (N, F)."""
        return self.window_sums.tone_amplitude(-self.survey.line)

    def whole_speed(self) -> Tensor:
        """All of |v| at once, (N, n), for the reference engine."""
        slabs = self.driving.slabs([(0, self.driving.samples)])
        return torch.cat([part.speed for slab in slabs for part in slab], dim=1).T


def top_speed(seen: Survey, liner: LinerModel) -> float:
    """Largest |v| of the data, no more than the liner knows, m/s."""
    peak = float(seen.peak.detach().nan_to_num(0).max())
    return max(min(peak, liner.speed_max or peak), 1e-3)


def kernel_response(kernels: KernelTable) -> Response:
    """H at the speeds of the kernels' own levels, in the order of ``basis.Response``."""
    return lambda frequency, _: kernels.response(frequency).T
