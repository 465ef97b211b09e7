"""A way out where a device is too small."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import torch

from torchliner.eduction.drive import ProbeVelocity

T = TypeVar("T")


def with_smaller_slabs(velocity: ProbeVelocity, work: Callable[[], T]) -> tuple[T, list[str]]:
    """Run ``work``; where memory runs out, again with slabs half as long.

    Returns: its result, and a note if it had to be started again.
    Raises:
        RuntimeError: the device does not even hold slabs of one sample.
    """
    first_rows = None
    while True:
        begin, end = velocity.bounds()[0]
        rows = end - begin
        try:
            found = work()
        except (RuntimeError, MemoryError) as error:
            if not _out_of_memory(error):
                raise
            if rows == 1:
                raise RuntimeError(
                    f"{velocity.device} is out of memory even with slabs of one sample of "
                    f"{sum(velocity.widths)} probes ({error}); use another device, or fewer probes"
                ) from error
            first_rows = rows if first_rows is None else first_rows
            velocity.most_rows = rows // 2
            if velocity.device.type == "cuda":
                torch.cuda.empty_cache()
            continue
        if first_rows is None:
            return found, []
        return found, [
            f"{velocity.device} ran out of memory with slabs of {first_rows} samples; slabs of "
            f"{rows} were used"
        ]


def _out_of_memory(error: Exception) -> bool:
    text = str(error)
    return isinstance(error, (torch.OutOfMemoryError, MemoryError)) or (
        "out of memory" in text or "can't allocate memory" in text
    )
