"""Parts of records that are not whole yet, so that what was summed is not summed again."""

from __future__ import annotations

import functools
import importlib
import shutil
from pathlib import Path
from typing import Any

import torch

from torchliner.io.whole_file import written_whole
from torchliner.reduction.parts import MomentsPart
from torchliner.tdibc.slices import Span

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
    """Parts as files of a folder, each there as a whole or not at all."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def _path(self, reading: int, span: Span) -> Path:
        return self.folder / f"reading{reading}_from{span[0]:012d}_{span[1]}.part"

    def has(self, reading: int, span: Span) -> bool:
        """Whether ``save`` was given a part of this reading."""
        return self._path(reading, span).exists()

    def load(self, reading: int, span: Span) -> MomentsPart:
        """It.

        Raises:
            ValueError: the file holds something else.
        """
        path = self._path(reading, span)
        try:
            _allow_classes()
            found = torch.load(path, weights_only=True)
        except Exception as error:
            words = str(error).splitlines()[0][:80]
            raise ValueError(
                f"{path} is no part of moments ({words}); delete it: it is summed again"
            ) from error
        if not isinstance(found, MomentsPart):
            raise ValueError(
                f"{path} holds a {type(found).__name__}; delete it: it is summed again"
            )
        return found

    def save(self, reading: int, span: Span, part: MomentsPart) -> None:
        """Keep a part.

        Raises:
            OSError: the disk is full, the folder is write-protected.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        with written_whole(self._path(reading, span)) as temporary:
            torch.save(part, temporary)

    def clear(self) -> None:
        """Delete what is not needed any more."""
        shutil.rmtree(self.folder, ignore_errors=True)
