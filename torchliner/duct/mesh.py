"""Rectangular elements of a duct: columns along x that meet the liner's edges, rows across it."""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from torchliner.checks import require_positive, tell
from torchliner.duct.case import DuctCase
from torchliner.duct.flow_profiles import Array

SAME = 1e-9  # of the duct's length or height
# Points per wavelength, by degree, that keep the error of a wave below 2e-3 of it per wavelength
# (measured over 8 wavelengths, one row of elements); 7 from degree 6 on.
FEWEST = {1: 30.0, 2: 16.0, 3: 11.0, 4: 9.0, 5: 8.0}
SPARE = 1.25


@dataclass(frozen=True, eq=False)
class DuctMesh:
    """Elements of polynomial degree p in both directions, 3 (p + 1)^2 unknowns each.

    Args:
        case: the duct.
        x: column edges, m, increasing from ``start`` to ``end``; every liner edge is one of them.
        y: row edges, m, increasing from 0 to H.  degree: p, at least 1.
    Raises:
        ValueError: edges that do not increase, do not span the duct or miss a liner edge.
    """

    case: DuctCase
    x: Array
    y: Array
    degree: int = 4

    def __post_init__(self) -> None:
        require_positive("mesh degree", self.degree)
        case = self.case
        for name, low, high in (("x", case.start, case.end), ("y", 0.0, case.height)):
            edges, tolerance = np.array(getattr(self, name), np.float64), SAME * (high - low)
            spans = edges.ndim == 1 and len(edges) > 1 and (np.abs(edges[[0, -1]] - (low, high)) <= tolerance).all()
            if not spans or (np.diff(edges) <= tolerance).any():
                raise ValueError(
                    f"mesh {name} must be edges that increase from {low:g} to {high:g} m, those of the duct"
                )
            object.__setattr__(self, name, edges)
        for edge in itertools.chain.from_iterable(case.liner):
            if np.abs(self.x - edge).min() > SAME * (case.end - case.start):
                raise ValueError(f"the liner's edge at x = {edge:g} m lies inside a column; make it an edge")

    @property
    def unknowns(self) -> int:
        """3 (p + 1)^2 for each element."""
        return 3 * (self.degree + 1) ** 2 * (len(self.x) - 1) * (len(self.y) - 1)

    @cached_property
    def widths(self) -> Array:
        """Of the columns, m; those equal but for rounding are made equal, to 1e-13 m."""
        return np.round(np.diff(self.x), 13)

    @cached_property
    def patch_numbers(self) -> NDArray[np.int64]:
        """Which lined patch a column lies on, -1 for none; (C,)."""
        middles = (self.x[1:] + self.x[:-1]) / 2
        numbers = np.full(len(middles), -1)
        for number, (start, end) in enumerate(self.case.liner):
            numbers[(middles > start) & (middles < end)] = number
        return numbers

    @property
    def lined(self) -> NDArray[np.bool_]:
        """Whether a column's lower wall is lined, (C,)."""
        return self.patch_numbers >= 0

    @property
    def lined_widths(self) -> Array:
        """Of the lined columns, m."""
        return self.widths[self.lined]

    def warn_if_coarse(self, frequency: float) -> None:
        """Warn where the wave against the flow has fewer points per wavelength than the degree needs: an element counts
        as p + 1 points along its longer side."""
        largest, fewest = max(self.widths.max(), np.diff(self.y).max()), FEWEST.get(self.degree, 7.0)
        points = _shortest_wave(self.case, frequency) * (self.degree + 1) / largest
        if points < fewest:
            tell(
                f"the mesh is coarse for {frequency:g} Hz: {points:.3g} points per wavelength of the wave against the "
                f"flow, below {fewest:g} for degree {self.degree}",
                depth=3,
            )


def build_mesh(
    case: DuctCase,
    frequency: float,
    *,
    degree: int = 4,
    column: float | None = None,
    row: float | None = None,
    wall_cell: float | None = None,
) -> DuctMesh:
    """A mesh for one frequency and all below it.

    Args:
        case: the duct.  frequency: the highest, Hz.  degree: p.
        column, row: largest elements along and across the duct, m; default: a fifth of the height or 1.25 times the
            points per wavelength of ``FEWEST``, whichever is less.
        wall_cell: height of the elements at the walls, m; default: 0.5 mm or a hundredth of the height, whichever is
            less, in a sheared flow, ``row`` otherwise.
    Raises:
        ValueError: a frequency, size or degree not above 0.
    """
    sizes = {"frequency (Hz)": frequency, "column (m)": column, "row (m)": row, "wall_cell (m)": wall_cell}
    for name, size in {"degree": degree, **sizes}.items():
        if size is not None:
            require_positive(f"mesh {name}", size)
    largest = min(case.height / 5, _shortest_wave(case, frequency) * (degree + 1) / (SPARE * FEWEST.get(degree, 7.0)))
    row, column = row or largest, column or largest
    sheared = float(np.ptp(case.profile.mach([0.0, case.height / 2]))) > 0
    cells = [wall_cell or (min(0.5e-3, case.height / 100) if sheared else row)]  # doubling from the wall
    while sum(cells) + min(2 * cells[-1], row) < case.height / 2 and 2 * cells[-1] < row:
        cells.append(2 * cells[-1])
    cells = cells if cells[0] < row else []
    half = np.concatenate([np.cumsum([0, *cells])[:-1], sum(cells) + _even(case.height / 2 - sum(cells), row)])
    y = np.concatenate([half, case.height - half[-2::-1]])
    x = [np.array([case.start])]
    for low, high in itertools.pairwise(sorted({case.start, case.end, *itertools.chain(*case.liner)})):
        x.append(low + _even(high - low, column)[1:])
    return DuctMesh(case, np.concatenate(x), y, degree)


def _shortest_wave(case: DuctCase, frequency: float) -> float:
    """Length of the plane wave against the flow, (1 - M_b) c/f, m."""
    return (1 - case.profile.bulk_mach) * case.profile.sound_speed / frequency


def _even(length: float, largest: float) -> Array:
    return np.linspace(0, length, max(1, math.ceil(length / largest - SAME)) + 1)
