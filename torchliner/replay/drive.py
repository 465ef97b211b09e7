"""Which |v| drives the kernel: six readings of the measured velocity."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import torch
from torch import Tensor

from torchliner.records.slabs import Bounds
from torchliner.replay.periodic import PeriodicPart
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
        periodic: PeriodicPart | None = None,
    ) -> None:
        """``periodic``: of the probes, which then come a third time, each with its own incoherent
        velocity and the coherent one of its cell; ``seen`` has these columns too."""
        self.velocity, self.periodic = velocity, periodic
        self.samples, self.widths = velocity.samples, velocity.widths
        if periodic is not None:
            self.widths = (*self.widths, self.widths[0])
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
                bounds, wider, self._groups(wider), strict=True
            ):
                yield [
                    Columns(self._running(slab, offset, begin, end, low))
                    for slab, offset in zip(groups, self.offsets, strict=True)
                ]
        else:
            for groups in self._groups(bounds):
                yield [Columns(v, offset) for v, offset in zip(groups, self.offsets, strict=True)]

    def with_extremes(self, seen: Survey) -> Survey:
        """The survey with the extremes of v* themselves, by one more pass, in place of bounds."""
        smallest, largest = seen.smallest.clone(), seen.largest.clone()
        low, high = smallest[-self.widths[-1] :], largest[-self.widths[-1] :]  # views
        low.fill_(torch.inf)
        high.fill_(-torch.inf)
        for groups in self._groups(self.bounds()):
            low.copy_(torch.minimum(low, groups[-1].amin(0)))
            high.copy_(torch.maximum(high, groups[-1].amax(0)))
        return dataclasses.replace(seen, smallest=smallest, largest=largest)

    def _groups(self, bounds: Bounds) -> Iterator[list[Tensor]]:
        """Probes, cell averages and, with a periodic part, v*."""
        for (begin, end), groups in zip(bounds, self.velocity.slabs(bounds), strict=True):
            if self.periodic is not None:
                away = self.periodic.of_time(begin, end, self.dtype)
                scale = self.periodic.scale.to(self.dtype)
                groups.append(torch.addcmul(away.neg_(), groups[0], scale, out=away))
            yield groups

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
