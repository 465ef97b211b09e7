"""Which |v| drives the kernel: six readings of the measured velocity."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from torchliner.records.slabs import Bounds
from torchliner.reduction.periodic import PeriodicPart
from torchliner.reduction.probe_velocity import ProbeVelocity
from torchliner.reduction.sources import Columns, Taken
from torchliner.reduction.survey import Survey

RUNNING_COLUMNS = 4096  # at once, in float64


class DriveSpeed:
    """|v| as the kernel sees it; a ``SpeedSource``."""

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
        self.means: list[Tensor] | list[None] = [None] * len(self.widths)
        if mean == "removed":
            self.means = list(seen.mean.split(self.widths))
        square = seen.mean_square - (seen.mean**2 if mean == "removed" else 0)
        self.rms = square.clamp(min=0).sqrt().to(self.dtype).split(self.widths)
        self._coefficients = [self._taken(i) for i in range(len(self.widths))]

    def _taken(self, group: int) -> Tensor | None:
        """Coefficients of what is taken off a group, (1 or K, P_g): its mean is the first row."""
        mean = self.means[group]
        if self.periodic is None or group < 2:
            return None if mean is None else mean[None].to(self.dtype)
        found = self.periodic.deviation.clone()
        if mean is not None:
            found[0] += mean
        return found.to(self.dtype)

    def bounds(self) -> Bounds:
        """Those of the velocity."""
        return self.velocity.bounds()

    def slabs(self, bounds: Bounds, groups: Sequence[int] | None = None) -> Iterator[list[Columns]]:
        """Velocity of each slab (begin, end), by group; of all groups unless some are named."""
        groups = range(len(self.widths)) if groups is None else groups
        if self.drive == "rms":
            for begin, end in bounds:
                yield [Columns(self.rms[i].expand(end - begin, -1)) for i in groups]
        elif self.drive == "running-rms":
            half = self.running_samples // 2
            wider = [(max(0, b - half), min(self.samples, e + half + 1)) for b, e in bounds]
            both = zip(bounds, wider, self._columns(wider, groups), strict=True)
            for (begin, end), (low, _), slab in both:
                yield [Columns(self._running(columns, begin, end, low)) for columns in slab]
        else:
            yield from self._columns(bounds, groups)

    def with_extremes(self, seen: Survey) -> Survey:
        """The survey with the extremes of v* themselves, by one more pass, in place of bounds."""
        smallest, largest = seen.smallest.clone(), seen.largest.clone()
        low, high = smallest[-self.widths[-1] :], largest[-self.widths[-1] :]  # views
        low.fill_(torch.inf)
        high.fill_(-torch.inf)
        assert self.periodic is not None
        for (begin, end), slab in self._groups(self.bounds(), averages=False):
            star = Taken(
                self._rows(begin, end), self.periodic.deviation.to(self.dtype),
                self.periodic.scale.to(self.dtype),
            ).off(slab[0])  # fmt: skip
            low.copy_(torch.minimum(low, star.amin(0)))
            high.copy_(torch.maximum(high, star.amax(0)))
        return dataclasses.replace(seen, smallest=smallest, largest=largest)

    def _groups(self, bounds: Bounds, averages: bool) -> Iterator[tuple[tuple[int, int], list[Tensor]]]:
        return zip(bounds, self.velocity.slabs(bounds, averages=averages), strict=True)

    def _rows(self, begin: int, end: int) -> Tensor:
        """1 and the harmonics, (t, K)."""
        if self.periodic is None:
            return torch.ones(end - begin, 1, dtype=self.dtype, device=self.device)
        return self.periodic.harmonics.rows(begin, end).T.to(self.device, self.dtype)

    def _columns(self, bounds: Bounds, groups: Sequence[int]) -> Iterator[list[Columns]]:
        """Probes, cell averages and, with a periodic part, v*."""
        for (begin, end), slab in self._groups(bounds, averages=1 in groups):
            rows = self._rows(begin, end).contiguous()
            found = []
            for i in groups:
                coefficients, scale = self._coefficients[i], None
                if i == 2 and self.periodic is not None:
                    scale = self.periodic.scale.to(self.dtype)
                taken = None
                if coefficients is not None:
                    taken = Taken(rows[:, : len(coefficients)], coefficients, scale)
                found.append(Columns(slab[i % 2], taken))
            yield found

    def _running(self, columns: Columns, begin: int, end: int, low: int) -> Tensor:
        """rms over a window of ``running_samples`` centred on each sample, cut at the ends."""
        width = columns.velocity.shape[1]
        if width > RUNNING_COLUMNS:
            cuts = range(0, width, RUNNING_COLUMNS)
            parts = [columns.part(slice(None), slice(i, i + RUNNING_COLUMNS)) for i in cuts]
            return torch.cat([self._running(part, begin, end, low) for part in parts], dim=1)
        half = self.running_samples // 2
        speed = columns.speed.to(torch.float64)
        running = torch.cat([torch.zeros_like(speed[:1]), (speed**2).cumsum(0)])
        steps = torch.arange(begin, end, device=self.device)
        first = (steps - half).clamp(min=0) - low
        after = (steps - half + self.running_samples).clamp(max=self.samples) - low
        square = (running[after] - running[first]) / (after - first)[:, None]
        return square.clamp(min=0).sqrt().to(self.dtype)
