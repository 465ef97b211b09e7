"""An educed impedance at some places, and how far it may be off because its record is finite."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.conversions import absorption_from_reflection, admittance_from_reflection, impedance_from_reflection
from torchliner.records.declared import Variable, part, record, var

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
        return cls(*(torch.cat(each, axis) for each in zip(*(vars(part).values() for part in parts), strict=True)))


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


@record
class Educed:
    """Z of probes, cells or the whole liner under one averaging, normalised by rho c, (..., F).

    Args:
        interval: because the record is finite; None where none was asked for or none can be had.
    """

    reflection: Tensor = var(kind="complex", text="reflection coefficient")
    interval: Interval | None = part(default=None)

    DERIVED: ClassVar = (Variable("impedance", name="{}"), Variable("absorption", text="absorption coefficient"))

    @property
    def impedance(self) -> Tensor:
        """Z, (..., F)."""
        return impedance_from_reflection(self.reflection)

    @property
    def resistance(self) -> Tensor:
        """Re Z, (..., F)."""
        return self.impedance.real

    @property
    def reactance(self) -> Tensor:
        """Im Z, (..., F)."""
        return self.impedance.imag

    @property
    def admittance(self) -> Tensor:
        """1/Z, (..., F)."""
        return admittance_from_reflection(self.reflection)

    @property
    def absorption(self) -> Tensor:
        """1 - |R|^2, (..., F)."""
        return absorption_from_reflection(self.reflection)

    @property
    def low(self) -> Tensor | None:
        """Lower bounds of resistance (real part) and reactance (imaginary part), (..., F); None without interval."""
        return None if self.interval is None else self.interval.low

    @property
    def high(self) -> Tensor | None:
        """Upper bounds, likewise."""
        return None if self.interval is None else self.interval.high

    def map(self, function: Callable[[Tensor], Tensor]) -> Educed:
        """The same with every tensor put through a function, such as a selection of places."""
        return Educed(function(self.reflection), None if self.interval is None else self.interval.map(function))

    @classmethod
    def stacked(cls, several: Sequence[Educed]) -> Educed:
        """Several averagings in one, along a new first axis; all or none have intervals."""
        intervals = [each.interval for each in several if each.interval is not None]
        if len(intervals) not in (0, len(several)):
            raise ValueError(f"{len(intervals)} of {len(several)} averagings have intervals; a file needs all or none")
        bounds = [torch.stack(each) for each in zip(*(vars(one).values() for one in intervals), strict=True)]
        return cls(torch.stack([each.reflection for each in several]), Interval(*bounds) if intervals else None)
