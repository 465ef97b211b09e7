"""A plane as the one loop reads it: slabs in the precision and on the device of the work."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.engine.threads import alive_together
from torchliner.records import VelocityPlane
from torchliner.records.slabs import read_ahead


@dataclass(frozen=True, eq=False)
class PlaneRecord:
    """Velocity of a plane, in memory or in its file, as a ``sums.Record``.

    Args:
        plane: what is read; from a file the next slab is read while this one is worked on.
        dtype, device: of the work.
        excluded: probes that are read as 0, bool, (P,), on ``device``; None for none.
        progress: called with numbers of samples read.
    """

    plane: VelocityPlane
    dtype: torch.dtype
    device: torch.device
    excluded: Tensor | None = None
    progress: Callable[[int], object] | None = None

    @property
    def samples(self) -> int:
        """T."""
        return self.plane.samples

    @property
    def columns(self) -> int:
        """P."""
        return self.plane.probes

    def slabs(self, bounds: Sequence[tuple[int, int]]) -> Iterator[Tensor]:
        """Samples begin .. end - 1 of each of ``bounds``, (t, P)."""
        stored = self.plane.stored
        if stored is None:
            return self._worked_on(self.plane.read(*each) for each in bounds)
        # Counted now: while slabs are worked on in threads torch says that it has one.
        return self._worked_on(read_ahead(stored, bounds, self.device, alive_together()))

    def _worked_on(self, read: Iterable[Tensor]) -> Iterator[Tensor]:
        for slab in read:
            here = slab.to(self.device, self.dtype)
            yield here if self.excluded is None else here.masked_fill(self.excluded, 0)
            if self.progress is not None:
                self.progress(len(slab))
