"""Cell-periodic modulation of a profile along x, and its decay with height."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from torchliner.duct.flow_profiles import Array

FEWEST_PROBES = 4  # to a cell
MOST_HARMONICS = 8
WHOLE = 0.01  # of a cell, by which probes may miss a whole number of cells
FEWEST_HEIGHTS = 3  # for a decay law
MOST_SCATTER = 1.3


class Modulation(NamedTuple):
    """Harmonics of the cell pitch in a profile along x.

    Args:
        mean: of the profile over whole cells, m/s.
        harmonics: peak amplitude of harmonics 1, 2, ... of the pitch, m/s.
        between: rms of the waves half way between them (1 1/2, 2 1/2, ... to a cell), m/s, which nothing periodic in
            the cell can have: what scatter alone gives. None for one cell.
        cells: whole cells behind it.
    """

    mean: float
    harmonics: tuple[float, ...]
    between: float | None
    cells: int

    @property
    def rms(self) -> float:
        """Of the cell-periodic part, m/s."""
        return math.hypot(*self.harmonics) / math.sqrt(2)

    def over_mean(self, value: float | None) -> float | None:
        """A velocity over the mean of the profile."""
        return None if value is None else value / self.mean if self.mean > 0 else math.nan


def cell_modulation(x: ArrayLike, values: ArrayLike, pitch: float) -> Modulation:
    """Cell-periodic part of a profile along x, m/s at evenly rising x, m, (N,); ``pitch`` is L_c, m.

    Harmonics are fitted by least squares over whole cells, together with a mean and, from two cells on, a linear growth
    along x and the waves between the harmonics: no probe has to sit at the same place of every cell.

    Raises:
        ValueError: the probes span no whole cell, or fewer than four of them are in one (with several cells more than
            four are needed, for the waves between the harmonics).
    """
    places, profile = np.asarray(x, np.float64), np.asarray(values, np.float64)
    spacing = float(np.diff(places).mean())
    cells = math.floor(len(places) * spacing / pitch + WHOLE)
    most = math.ceil(pitch / (2 * spacing)) - (1 if cells == 1 else 2)
    if cells < 1 or most < 1 or pitch / spacing < FEWEST_PROBES - 1e-6:
        raise ValueError(
            f"the probes span {1e3 * len(places) * spacing:.4g} mm with {pitch / spacing:.3g} to a cell of "
            f"{1e3 * pitch:.4g} mm; a whole cell with {FEWEST_PROBES} is needed at least, of several cells more"
        )
    inside = places - places[0] < cells * pitch - (0.5 - WHOLE) * spacing
    phase = (places[inside] - places[0]) / pitch
    orders = np.arange(1.0, min(MOST_HARMONICS, most) + 0.5)
    count, steady = len(orders), [np.ones_like(phase)]
    if cells > 1:
        orders = np.concatenate([orders, orders + 0.5])
        steady.append(phase - phase.mean())
    turns = 2 * np.pi * np.outer(phase, orders)
    columns = np.concatenate([np.stack(steady, 1), np.cos(turns), np.sin(turns)], 1)
    found, *_ = np.linalg.lstsq(columns, profile[inside], rcond=None)
    sizes = np.hypot(*found[len(steady) :].reshape(2, -1))
    between = float(np.sqrt((sizes[count:] ** 2).sum() / 2)) if cells > 1 else None
    return Modulation(float(found[0]), tuple(sizes[:count].tolist()), between, cells)


class Decay(NamedTuple):
    """a exp(-y/l): amplitude a at y = 0, length l (m; negative where the amplitude grows with height), and the factor
    by which the heights stray from it (rms; 1 for none)."""

    amplitude: float
    length: float
    scatter: float

    @property
    def follows(self) -> bool:
        """Whether the amplitude falls, and strays from the fit by less than a factor 1.3."""
        return self.length > 0 and self.scatter <= MOST_SCATTER

    def at(self, height: ArrayLike) -> Array:
        """The fitted amplitude at a height, m."""
        return self.amplitude * np.exp(-np.asarray(height, np.float64) / self.length)


def fit_decay(heights: Sequence[float], amplitudes: Sequence[float]) -> Decay | None:
    """Least squares of ln(amplitude) over height, m; None with fewer than three heights or an amplitude not above 0."""
    if len(heights) < FEWEST_HEIGHTS or not all(a > 0 for a in amplitudes):
        return None
    places, logs = np.asarray(heights), np.log(amplitudes)
    slope, start = np.polyfit(places, logs, 1).tolist()
    stray = float(np.sqrt(np.mean((logs - slope * places - start) ** 2)))
    return Decay(math.exp(start), -1 / slope if slope else math.inf, math.exp(stray))
