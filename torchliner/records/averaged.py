"""An educed impedance at some places, with its statistical interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar

import torch
from torch import Tensor

from torchliner.conversions import absorption_from_reflection, admittance_from_reflection, impedance_from_reflection
from torchliner.records.declared import Variable, part, record, var
from torchliner.records.uncertainty import Interval


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
