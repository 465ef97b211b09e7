"""How far a result may be off because its record is finite."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Interval:
    """Statistical interval of an impedance, resistance and reactance each by itself.

    Args:
        low, high: bounds, complex128, of one shape: the real parts bound the resistance, the
            imaginary parts the reactance.
        standard_error: of resistance (real part) and reactance (imaginary part).
        runs: number of independent runs of the record behind it, real, of the same shape.
        bias: what a mean of admittances of probes is off in the mean, because the admittance of
            a short record is not linear in it; to second order, complex. The bounds are without
            it, the value is not. 0 for single probes.
    """

    low: Tensor
    high: Tensor
    standard_error: Tensor
    runs: Tensor
    bias: Tensor

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


@dataclass(frozen=True, eq=False)
class PointUncertainty:
    """Statistical intervals of ``PointImpedances``, in both orders of averaging.

    Args:
        cells, cells_pressure_first: (C, F).
        liner, liner_pressure_first: (F,).
        settings: level, what was resampled, blocks.
    """

    cells: Interval
    cells_pressure_first: Interval
    liner: Interval
    liner_pressure_first: Interval
    settings: Mapping[str, Any] = field(default_factory=dict)
