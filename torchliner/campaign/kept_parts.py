"""What is summed of records that are not whole yet, so that it is not summed again."""

from __future__ import annotations

import functools
import importlib
import shutil
import time
from pathlib import Path
from typing import Any

import torch

from torchliner.io.whole_file import written_whole
from torchliner.reduction.parts import MomentsPart

EVERY = 60.0  # s
SHARE = 0.02  # of the time
CLASSES = (  # that a part is made of; nothing else is taken from such a file
    "torchliner.fluid:Fluid",
    "torchliner.records.cells:Cells",
    "torchliner.records.velocity_plane:VelocityPlane",
    "torchliner.reduction.basis:Chebyshev",
    "torchliner.reduction.basis:Levels",
    "torchliner.reduction.block_sums:BlockSums",
    "torchliner.reduction.coherence:ToneCoherence",
    "torchliner.reduction.coherence:_Segments",
    "torchliner.reduction.moments:ReducedVelocity",
    "torchliner.reduction.parts:MomentsPart",
    "torchliner.reduction.periodic:Harmonics",
    "torchliner.reduction.periodic:PeriodicSums",
    "torchliner.reduction.plan:PassPlan",
    "torchliner.reduction.readings:Wanted",
    "torchliner.reduction.speed_sums:SpeedSums",
    "torchliner.reduction.survey:SurveySums",
    "torchliner.signals.blocks:Blocks",
    "builtins:range",
)


@functools.cache
def _allow_classes() -> None:
    """Let torch make ``CLASSES`` of a file."""
    homes = [home.split(":") for home in CLASSES]
    found: list[Any] = [getattr(importlib.import_module(module), name) for module, name in homes]
    torch.serialization.add_safe_globals(found)


class KeptParts:
    """The part of a record that is summed so far, a file for each reading, whole or not there.

    It is as large as the moments; so it is written once a minute at most, and seldom enough that
    it takes no more than ``SHARE`` of the time.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.took = 0.0  # s, the last time
        self.last = time.monotonic()

    def _path(self, reading: int) -> Path:
        return self.folder / f"reading{reading}.part"

    def due(self) -> bool:
        """Whether it is time to write."""
        return time.monotonic() - self.last >= max(EVERY, self.took / SHARE)

    def load(self, reading: int) -> MomentsPart | None:
        """What was kept of a reading; None if there is nothing.

        Raises:
            ValueError: the file holds something else.
        """
        path = self._path(reading)
        if not path.exists():
            return None
        try:
            _allow_classes()
            found = torch.load(path, weights_only=True)
        except Exception as error:
            words = str(error).splitlines()[0][:80]
            raise ValueError(f"{path} is no part of moments ({words}); delete it: it is summed again") from error
        if not isinstance(found, MomentsPart):
            raise ValueError(f"{path} holds a {type(found).__name__}; delete it: it is summed again")
        return found

    def save(self, reading: int, part: MomentsPart) -> None:
        """Keep a part if it is time.

        Raises:
            OSError: the disk is full, the folder is write-protected.
        """
        if not self.due():
            return
        start = time.monotonic()
        self.folder.mkdir(parents=True, exist_ok=True)
        with written_whole(self._path(reading)) as temporary:
            torch.save(part, temporary)
        self.last = time.monotonic()
        self.took = self.last - start

    def clear(self) -> None:
        """Delete what is not needed any more."""
        shutil.rmtree(self.folder, ignore_errors=True)
