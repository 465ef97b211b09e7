"""Which |v| drives the kernel: five readings of the measured velocity."""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.eduction.survey import Survey
from torchliner.records import VelocityPlane

DRIVES = ("instantaneous", "rms", "running-rms")
MEANS = ("kept", "removed")


class ProbeVelocity:
    """v of the plane's probes, followed by the averages over its cells as further probes.

    The averages are formed as the data stream by, so both orders of averaging cost one pass.
    """

    def __init__(
        self,
        plane: VelocityPlane,
        cells: Tensor,
        dtype: torch.dtype,
        device: torch.device,
        used: Tensor | None = None,
    ) -> None:
        """``cells``: averaging matrix (P, C); ``used``: probes to keep, others read as 0."""
        self.plane = plane
        self.samples = plane.samples
        self.probes = plane.probes + cells.shape[1]
        self.cells = cells.to(device)
        self.dtype = dtype
        self.device = device
        self.used = None if used is None or bool(used.all()) else used.to(device)

    def read(self, begin: int, end: int) -> Tensor:
        """Samples begin .. end - 1, m/s, (t, P + C)."""
        slab = self.plane.read(begin, end).to(self.device)
        if self.used is not None:
            slab = torch.where(self.used, slab, torch.zeros((), dtype=slab.dtype))
        average = slab.to(torch.float64) @ self.cells
        return torch.cat([slab.to(self.dtype), average.to(self.dtype)], dim=1)


class DriveSpeed:
    """|v| as the kernel sees it, for the engines."""

    def __init__(
        self,
        velocity: ProbeVelocity,
        drive: str,
        mean: str,
        seen: Survey,
        running_samples: int,
    ) -> None:
        self.velocity = velocity
        self.samples, self.probes = velocity.samples, velocity.probes
        self.dtype, self.device = velocity.dtype, velocity.device
        self.drive = drive
        self.running_samples = running_samples
        self.offset = seen.mean.to(self.dtype) if mean == "removed" else None
        square = seen.mean_square - (seen.mean**2 if mean == "removed" else 0)
        self.rms = square.clamp(min=0).sqrt().to(self.dtype)

    def read(self, begin: int, end: int) -> Tensor:
        """|v| of samples begin .. end - 1, m/s, (t, P + C)."""
        if self.drive == "rms":
            return self.rms.expand(end - begin, -1)
        if self.drive == "running-rms":
            return self._running(begin, end)
        slab = self.velocity.read(begin, end)
        return (slab if self.offset is None else slab - self.offset).abs()

    def _running(self, begin: int, end: int) -> Tensor:
        """rms over a window of ``running_samples`` centred on each sample, cut at the ends."""
        half = self.running_samples // 2
        low, high = max(0, begin - half), min(self.samples, end + half + 1)
        slab = self.velocity.read(low, high)
        slab = (slab if self.offset is None else slab - self.offset).to(torch.float64)
        running = torch.cat([torch.zeros_like(slab[:1]), (slab**2).cumsum(0)])
        steps = torch.arange(begin, end, device=self.device)
        first = (steps - half).clamp(min=0) - low
        after = (steps - half + self.running_samples).clamp(max=self.samples) - low
        square = (running[after] - running[first]) / (after - first)[:, None]
        return square.clamp(min=0).sqrt().to(self.dtype)
