"""Impedances that another method found at points, cells and the whole liner."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Any, ClassVar

from torch import Tensor

from torchliner.checks import index_of_frequency
from torchliner.records.declared import part, record, require_shapes, var
from torchliner.records.educed import PointUncertainty
from torchliner.records.notes import Note
from torchliner.records.outlets import Result

CELL = ("cell", "frequency")


@record
class PointImpedances(Result):
    """What stands beside an educed map: impedances by a method that replays nothing.

    All impedances are normalised by rho c, exp(+j omega t), v into the liner; nan where a point belongs to no cell.

    Args:
        name: of the method, for legends and tables.
        choices: every option.
        notes: warnings, with numbers.
        uncertainty: statistical intervals, because the record is finite; None without any.
    """

    name: str
    frequency: Tensor = var("frequency", unit="Hz", text="frequency of the tone")
    cell_x: Tensor = var("cell", unit="m", text="streamwise coordinate of a cell, nan where unknown")
    cell_z: Tensor = var("cell", unit="m", text="spanwise coordinate of a cell, likewise")
    cell_impedance: Tensor = var(
        *CELL, name="cell_{}", wide=True, text="of each cell, from the admittance averaged over points"
    )
    cell_impedance_pressure_first: Tensor = var(
        *CELL, name="cell_{}_pressure_first", wide=True, text="of each cell, pressure averaged first"
    )
    liner_impedance: Tensor = var(
        "frequency", name="liner_{}", wide=True, text="of the whole surface, from the admittance averaged over points"
    )
    liner_impedance_pressure_first: Tensor = var(
        "frequency", name="liner_{}_pressure_first", wide=True, text="of the whole surface, pressure averaged first"
    )
    coherence: Tensor = var(*CELL, text="squared coherence of the two pressures, mean over the points of a cell")
    point_x: Tensor = var("point", unit="m", text="streamwise coordinate of a point, nan where unknown")
    point_z: Tensor = var("point", unit="m", text="spanwise coordinate of a point, likewise")
    point_impedance: Tensor = var("point", "frequency", name="point_{}", wide=True, text="at each point")
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[Note | str, ...] = ()
    uncertainty: PointUncertainty | None = part(default=None)

    SCHEMA: ClassVar = "torchliner points 1"
    PLACES: ClassVar = {"points": ("point",), "cells": ("cell",), "liners": ()}
    TOGETHER: ClassVar = True

    def __post_init__(self) -> None:
        require_shapes(self, self.name)

    @property
    def answer(self) -> Tensor:
        """Z of the whole surface from the admittance averaged over points, (F,)."""
        return self.liner_impedance

    def bounds_of_liner(self, order: str = "", index: int = 0) -> tuple[complex, complex] | None:
        """Of the whole surface's statistical interval at one frequency; None without any. ``order``: "" for the
        admittance averaged over points, "_pressure_first"."""
        known = self.uncertainty
        return None if known is None else getattr(known, f"liner{order}").bounds(index)

    def at(self, frequency: float) -> int | None:
        """Index of a frequency (Hz), None if it is not among these."""
        return index_of_frequency(self.frequency, frequency)

    def _answer(self) -> Any:
        known = self.uncertainty
        return (self.answer, None, None) if known is None else (self.answer, known.liner, known.settings.get("level"))
