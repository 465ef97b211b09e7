"""The inner sums of a pass, by the compiled kernel where there is one, else by torch alone."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from torchliner.compiled.library import available
from torchliner.compiled.threads import one_thread
from torchliner.reduction import eager, native
from torchliner.reduction.sources import Taken


def zeros(shape: Sequence[int], dtype: torch.dtype, device: torch.device) -> Tensor:
    """To add to; numpy asks for huge pages, whose first touch costs a fifth of that of small ones
    (29 against 6 ms for 45 MB, which is as long as the sums of a plane in memory take)."""
    if device.type != "cpu":
        return torch.zeros(tuple(shape), dtype=dtype, device=device)
    return torch.from_numpy(np.zeros(shape, str(dtype).removeprefix("torch.")))


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
