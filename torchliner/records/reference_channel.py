"""A signal recorded beside the bursts that carries the phase of the sound."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_positive
from torchliner.records.declared import ANY, check, record, var
from torchliner.records.probes import signal_tensor


@record
class ReferenceChannel:
    """Loudspeaker voltage or microphone, uniformly sampled on the clock of the arrivals.

    Only its phase and its coherence with v count, so its unit is free.

    Args:
        sampling_rate: Hz.
        name: how messages call it.
    Raises:
        TypeError: values are not real floating point.
        ValueError: another shape, values that are not finite, a signal that is constant.
    """

    values: Any = var("time", range=ANY, text="any unit")
    sampling_rate: float
    start: float = var(unit="s", range=ANY, text="time of the first sample on the clock of the arrivals", default=0.0)
    name: str = "reference"

    def __post_init__(self) -> None:
        values = signal_tensor(self.values, "reference", self.name, "values").to(torch.float64)
        object.__setattr__(self, "values", values)
        require_positive(f"{self.name}: sampling_rate (Hz)", self.sampling_rate)
        check(self)
        if len(values) < 2 or float(values.min()) == float(values.max()):
            raise ValueError(f"{self.name} is constant, {float(values[0]):g}; it holds no tone")

    @property
    def end(self) -> float:
        """Time of the last sample, s."""
        return self.start + (len(self.values) - 1) / self.sampling_rate

    def at(self, times: Tensor) -> Tensor:
        """Values at times on the clock of the arrivals, between the samples linearly.

        Args:
            times: s, (t,).
        Raises:
            ValueError: the channel does not cover them.
        """
        first, last = float(times[0]), float(times[-1])
        slack = 1e-9 * max(1.0, abs(last))
        if first < self.start - slack or last > self.end + slack:
            raise ValueError(
                f"{self.name} runs from {self.start:.6g} to {self.end:.6g} s, the velocity from {first:.6g} to "
                f"{last:.6g} s; record the whole of it, or state start, the time of its first sample on the clock of "
                "the arrivals"
            )
        place = ((times - self.start) * self.sampling_rate).clamp(0, len(self.values) - 1)
        before = place.floor().to(torch.int64).clamp(max=len(self.values) - 2)
        return torch.lerp(self.values[before], self.values[before + 1], place - before)
