"""Which |v| drives the kernel: six readings of the measured velocity."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from torchliner.records.slabs import Bounds
from torchliner.replay.probe_velocity import ProbeVelocity
from torchliner.replay.sources import Columns
from torchliner.replay.survey import Survey

RUNNING_COLUMNS = 4096  # at once, in float64


class DriveSpeed:
    """|v| as the kernel sees it, for the engines; a ``SpeedSource``."""

    def __init__(
        self,
        velocity: ProbeVelocity,
        drive: str,
        mean: str,
        seen: Survey,
        running_samples: int,
    ) -> None:
        self.velocity = velocity
        self.samples, self.widths = velocity.samples, velocity.widths
        self.dtype, self.device = velocity.dtype, velocity.device
        self.drive = drive
        self.running_samples = running_samples
        self.offsets: list[Tensor] | list[None] = [None] * len(self.widths)
        if mean == "removed":
            self.offsets = list(seen.mean.to(self.dtype).split(self.widths))
        square = seen.mean_square - (seen.mean**2 if mean == "removed" else 0)
        self.rms = square.clamp(min=0).sqrt().to(self.dtype).split(self.widths)

    def bounds(self) -> Bounds:
        """Those of the velocity."""
        return self.velocity.bounds()

    def slabs(self, bounds: Bounds) -> Iterator[list[Columns]]:
        """Velocity of each slab (begin, end), by group."""
        if self.drive == "rms":
            for begin, end in bounds:
                yield [Columns(rms.expand(end - begin, -1)) for rms in self.rms]
        elif self.drive == "running-rms":
            half = self.running_samples // 2
            wider = [(max(0, b - half), min(self.samples, e + half + 1)) for b, e in bounds]
            for (begin, end), (low, _), groups in zip(
                bounds, wider, self.velocity.slabs(wider), strict=True
            ):
                yield [
                    Columns(self._running(slab, offset, begin, end, low))
                    for slab, offset in zip(groups, self.offsets, strict=True)
                ]
        else:
            for groups in self.velocity.slabs(bounds):
                yield [Columns(v, offset) for v, offset in zip(groups, self.offsets, strict=True)]

    def _running(
        self, slab: Tensor, offset: Tensor | None, begin: int, end: int, low: int
    ) -> Tensor:
        """rms over a window of ``running_samples`` centred on each sample, cut at the ends."""
        if slab.shape[1] > RUNNING_COLUMNS:
            cuts = range(0, slab.shape[1], RUNNING_COLUMNS)
            parts = [slice(left, left + RUNNING_COLUMNS) for left in cuts]
            return torch.cat(
                [
                    self._running(
                        slab[:, part], None if offset is None else offset[part], begin, end, low
                    )
                    for part in parts
                ],
                dim=1,
            )
        half = self.running_samples // 2
        slab = (slab if offset is None else slab - offset).to(torch.float64)
        running = torch.cat([torch.zeros_like(slab[:1]), (slab**2).cumsum(0)])
        steps = torch.arange(begin, end, device=self.device)
        first = (steps - half).clamp(min=0) - low
        after = (steps - half + self.running_samples).clamp(max=self.samples) - low
        square = (running[after] - running[first]) / (after - first)[:, None]
        return square.clamp(min=0).sqrt().to(self.dtype)
