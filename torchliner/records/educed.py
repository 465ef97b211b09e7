"""An educed impedance at some places, how far it may be off because its record is finite; and impedances that another
method found at points, cells and the whole liner."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.conversions import absorption_from_reflection, admittance_from_reflection, impedance_from_reflection
from torchliner.records.checked import require_shapes
from torchliner.records.declared import Variable, flat, part, record, var
from torchliner.records.notes import Note
from torchliner.records.outlets import Result

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
        bounds = () if self.interval is None else vars(self.interval).values()
        return Educed(function(self.reflection), Interval(*map(function, bounds)) if bounds else None)

    @classmethod
    def stacked(cls, several: Sequence[Educed]) -> Educed:
        """Several averagings in one, along a new first axis; all or none have intervals."""
        intervals = [each.interval for each in several if each.interval is not None]
        if len(intervals) not in (0, len(several)):
            raise ValueError(f"{len(intervals)} of {len(several)} averagings have intervals; a file needs all or none")
        bounds = [torch.stack(each) for each in zip(*(vars(one).values() for one in intervals), strict=True)]
        return cls(torch.stack([each.reflection for each in several]), Interval(*bounds) if intervals else None)


class Averaged(Result):
    """A result with Z of the whole liner in several averagings, by name; ``averaging`` is the one to quote."""

    liner: Mapping[str, Educed]
    averaging: str
    choices: Mapping[str, Any]

    @property
    def averagings(self) -> tuple[str, ...]:
        """Those that it holds."""
        return tuple(self.liner)

    @property
    def answer(self) -> Tensor:
        """Z of the whole liner in the averaging that was chosen, (F,): the value to quote."""
        return self.liner[self.averaging].impedance

    @property
    def level(self) -> float | None:
        """Of the statistical intervals, 0 to 1; None without any."""
        return None if self.liner[self.averaging].interval is None else self.choices.get("interval")

    def bounds_of_liner(self, averaging: str = "", index: int = 0) -> tuple[complex, complex] | None:
        """Of the statistical interval at one frequency, None without any; default in the averaging chosen."""
        interval = self.liner[averaging or self.averaging].interval
        return None if interval is None else interval.bounds(index)

    def _answer(self) -> Any:
        return self.answer, self.liner[self.averaging].interval, self.level


@record
class PointImpedances(Averaged):
    """What stands beside an educed map: impedances by a method that replays nothing.

    All impedances are normalised by rho c, exp(+j omega t), v into the liner; nan where a point belongs to no cell.

    Args:
        name: of the method, for legends and tables.
        cells, liner: by averaging: ``admittance`` over points, ``pressure-first``.
        choices: every option.
        notes: warnings, with numbers.
    """

    name: str
    frequency: Tensor = var("frequency", unit="Hz", text="frequency of the tone")
    cell_x: Tensor = var("cell", unit="m", text="streamwise coordinate of a cell, nan where unknown")
    cell_z: Tensor = var("cell", unit="m", text="spanwise coordinate of a cell, likewise")
    cells: Mapping[str, Educed] = part("cell_", "averaging", "cell", "frequency", text="of each cell", by="averagings")
    liner: Mapping[str, Educed] = part("liner_", "averaging", "frequency", text="of the whole liner", by="averagings")
    coherence: Tensor = var(
        "cell", "frequency", text="squared coherence of the two pressures, mean over the points of a cell"
    )
    point_x: Tensor = var("point", unit="m", text="streamwise coordinate of a point, nan where unknown")
    point_z: Tensor = var("point", unit="m", text="spanwise coordinate of a point, likewise")
    points: Educed = part("point_", "point", "frequency", text="at each point")
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[Note | str, ...] = ()
    averaging: str = "admittance"

    DERIVED: ClassVar = (
        Variable("averagings", dims=("averaging",), kind="text", name="averaging", text="averaging over the points"),
    )
    SCHEMA: ClassVar = "torchliner points 1"
    PLACES: ClassVar = {"points": ("point",), "cells": ("cell",), "liners": ()}
    TOGETHER: ClassVar = True

    def __post_init__(self) -> None:
        require_shapes(flat(self, derived=False), self.name)
