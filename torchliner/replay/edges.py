"""A window placed in a record, and what is emitted outside it.

Edge rules:
- ``finite`` (default): the velocity record is used as it is. The tone was on before the record and
  stays on after it. In the engines that form the reflected signal, what is emitted outside reaches
  into the record through the mean kernel of the first (last) K samples, K being the kernel's
  length, or of the whole record if that is shorter. So a frozen |v| gives the kernel's response
  exactly, and stationary turbulence has no start-up bias. ``spectral`` weighs emission times, so
  that no reply is lost beyond an end.
- ``silent``: eq. (3.2) to the letter: no wave outside the record. Start-up error with a Hann window
  3e-4 for 16 periods.
- ``wrap``: the record is periodic; it needs whole periods.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.signals.windows import Window


@dataclass(frozen=True)
class Record:
    """A window placed in a record.

    Args:
        samples: n, samples of the velocity record.
        start: first sample under the window (the pre-roll before it only emits).
        window: N samples, at most n - start.
        edge: one of ``EDGE_RULES``.
        sampling_rate: Hz.
    """

    samples: int
    start: int
    window: Window
    edge: str
    sampling_rate: float

    @property
    def end(self) -> int:
        """Sample after the last under the window."""
        return self.start + len(self.window.weights)

    def weights(self, begin: int, end: int) -> Tensor:
        """The window at samples begin .. end - 1, 0 outside it: float64, (t,)."""
        found = torch.zeros(end - begin, dtype=torch.float64)
        low, high = max(begin, self.start), min(end, self.end)
        if low < high:
            under = slice(low - self.start, high - self.start)
            found[low - begin : high - begin] = self.window.weights[under]
        return found
