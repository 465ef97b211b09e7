"""Impedances that another method found at points, cells and the whole liner."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from torch import Tensor

from torchliner.checks import index_of_frequency, require_complex
from torchliner.records.notes import Note
from torchliner.records.outlets import Result
from torchliner.records.uncertainty import PointUncertainty


@dataclass(frozen=True, eq=False)
class PointImpedances(Result):
    """What stands beside an educed map: impedances by a method that replays nothing.

    All impedances are normalised by rho c, exp(+j omega t), v into the liner.

    Args:
        name: of the method, for legends and tables.
        frequency: Hz, (F,).
        cell_x, cell_z: centres of the cells, m, (C,); nan where unknown.
        cell_impedance: 1 / mean of the admittance over the points of a cell, complex, (C, F).
        cell_impedance_pressure_first: pressure averaged over the cell, then divided, (C, F).
        liner_impedance, liner_impedance_pressure_first: the same over the whole surface, (F,).
        coherence: squared, of the two pressures, mean over a cell's points, (C, F); nan if unknown.
        point_x, point_z: m, (P,); nan where unknown.
        point_impedance: (P, F); nan where a point belongs to no cell.
        choices: every option.
        notes: warnings, with numbers.
        uncertainty: statistical intervals, because the record is finite; None without any.
    Raises:
        TypeError: an impedance is not complex.
        ValueError: shapes disagree.
    """

    name: str
    frequency: Tensor
    cell_x: Tensor
    cell_z: Tensor
    cell_impedance: Tensor
    cell_impedance_pressure_first: Tensor
    liner_impedance: Tensor
    liner_impedance_pressure_first: Tensor
    coherence: Tensor
    point_x: Tensor
    point_z: Tensor
    point_impedance: Tensor
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[Note | str, ...] = ()
    uncertainty: PointUncertainty | None = None

    def __post_init__(self) -> None:
        cells, points, count = len(self.cell_x), len(self.point_x), len(self.frequency)
        wanted = {
            "cell_z": (cells,),
            "cell_impedance": (cells, count),
            "cell_impedance_pressure_first": (cells, count),
            "liner_impedance": (count,),
            "liner_impedance_pressure_first": (count,),
            "coherence": (cells, count),
            "point_z": (points,),
            "point_impedance": (points, count),
        }
        for label, shape in wanted.items():
            value = getattr(self, label)
            if "impedance" in label:
                require_complex(f"{self.name}: {label}", value)
            if tuple(value.shape) != shape:
                raise ValueError(
                    f"{self.name}: {label} has shape {tuple(value.shape)}; {cells} cells, {points} "
                    f"points and {count} frequencies need {shape}"
                )

    @property
    def answer(self) -> Tensor:
        """Z of the whole surface from the admittance averaged over points, (F,)."""
        return self.liner_impedance

    def bounds_of_liner(self, order: str = "", index: int = 0) -> tuple[complex, complex] | None:
        """Of the whole surface's statistical interval at one frequency; None without any.

        Args:
            order: "" for the admittance over points, "_pressure_first".
            index: of the frequency.
        """
        known = self.uncertainty
        return None if known is None else getattr(known, f"liner{order}").bounds(index)

    def bounds_of_cell(self, cell: int, order: str = "", index: int = 0) -> tuple[complex, complex] | None:
        """Of one cell's statistical interval; as ``bounds_of_liner``."""
        known = self.uncertainty
        return None if known is None else getattr(known, f"cells{order}").bounds(cell, index)

    def at(self, frequency: float) -> int | None:
        """Index of a frequency (Hz), None if it is not among these."""
        return index_of_frequency(self.frequency, frequency)
