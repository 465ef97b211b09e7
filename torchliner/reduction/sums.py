"""The inner sums of a pass, by the compiled kernel where there is one, else by torch alone."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import torch
from torch import Tensor

from torchliner.compiled.library import available
from torchliner.compiled.threads import one_thread
from torchliner.reduction import eager, native
from torchliner.reduction.sources import Taken


def compiled(slab: Tensor) -> bool:
    """Whether the compiled sums take a slab."""
    return slab.device.type == "cpu" and available()


def sums_alone(device: torch.device) -> contextlib.AbstractContextManager[None]:
    """Let the compiled sums, where there are any, have the processors to themselves."""
    own = device.type == "cpu" and available()
    return one_thread() if own else contextlib.nullcontext()


def add(
    slab: Tensor, lines: Sequence[eager.Lines] = (), speeds: eager.Speeds | None = None,
    taken: Taken | None = None,
) -> None:  # fmt: skip
    """Add what is asked of a slab to running sums; see ``eager.add``."""
    (native if compiled(slab) else eager).add(slab, lines, speeds, taken)
