"""How far a result may be off because its record is finite."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any

import torch
from torch import Tensor

from torchliner.records.declared import part, record, var

STATISTICAL = "statistical (blocks of the record)"


@record
class Interval:
    """Statistical interval of an impedance: real parts are of its resistance, imaginary parts of its reactance.

    The bias is that of a mean of admittances of probes, of which that of a short record is not linear in v; to second
    order, 0 for single probes. The bounds are without it, the value is not.
    """

    low: Tensor = var(name="{}_low", wide=True, text=f"lower bound, {STATISTICAL},")
    high: Tensor = var(name="{}_high", wide=True, text=f"upper bound, {STATISTICAL},")
    standard_error: Tensor = var(name="{}_standard_error", wide=True, text="standard error")
    runs: Tensor = var(name="interval_runs", wide=True, text="number of independent runs of the record")
    bias: Tensor = var(name="{}_bias", wide=True, text="bias, taken off the bounds alone,")

    def map(self, function: Callable[[Tensor], Tensor]) -> Interval:
        """The same with every field put through a function."""
        return Interval(*(function(value) for value in vars(self).values()))

    @property
    def widths(self) -> Tensor:
        """Of R and of X, float64, (2, ...): a complex difference of infinite bounds is nan."""
        return torch.stack([self.high.real - self.low.real, self.high.imag - self.low.imag])

    def bounds(self, *place: int) -> tuple[complex, complex]:
        """Both ends at one place, as plain numbers."""
        return complex(self.low[place]), complex(self.high[place])

    @classmethod
    def joined(cls, parts: Sequence[Interval], axis: int = 0) -> Interval:
        """Several, one after another along an axis."""
        names = vars(parts[0])
        return cls(*(torch.cat([getattr(part, name) for part in parts], axis) for name in names))


@record
class PointUncertainty:
    """Statistical intervals of ``PointImpedances``, in both orders of averaging.

    Args:
        settings: level, what was resampled, blocks.
    """

    cells: Interval = part("cell_", "cell", "frequency", text="of each cell")
    cells_pressure_first: Interval = part("cell_pressure_first_", "cell", "frequency", text="of each cell, likewise")
    liner: Interval = part("liner_", "frequency", text="of the whole surface")
    liner_pressure_first: Interval = part("liner_pressure_first_", "frequency", text="of the whole surface, likewise")
    settings: Mapping[str, Any] = field(default_factory=dict)
