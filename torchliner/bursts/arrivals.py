r"""Random samples onto a uniform grid: velocities that are known at the arrivals of particles alone.

Each of the three methods is linear in the values and fixed by the arrival times, so that what it does to a tone can be
computed for the very arrivals of a record (``tone_damping``). ``linear`` (the paper, section 3.3) draws straight lines
between the arrivals, ``hold`` keeps the last value, ``band-limited`` is a least-squares fit in splines of degree 5 on
uniform knots 1/(2 B) apart, which tend to the functions band-limited to B as their degree grows (Unser 1999). The
normal equations are banded, so that the cost is that of a filter, and a gap spoils its neighbourhood alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import real_tensor, require_choice, require_positive, tell
from torchliner.names import GRID_METHODS

MOST_POINTS, FEWEST = 1000, 1000  # of a grid, for an arrival; arrivals, for so few as show nothing
STEPS_A_PERIOD = 16  # of a tone, on a derived grid
STEPS_AN_ARRIVAL = 2  # folds at the mean rate, where Poisson arrivals leave 0.09 of a line
LONG_GAP = 20.0  # mean intervals; among 150 000 Poisson arrivals one in 3000 records has such a gap
BAND_SHARE = 0.25  # B over the mean rate: two arrivals a coefficient, twice the least density
ROUNDING = 1e-9  # of a grid step: an arrival that near to a grid point is on it
DEGREE = 5
SMOOTHING = 1e-3  # second differences over the mean diagonal; 1e-4 gave turbulence 10 % too strong


@dataclass(frozen=True, eq=False)
class GridSignal:
    """A signal on a uniform grid from the first arrival to the last one; nothing is extrapolated.

    Args:
        values: on the grid, (T,), in the unit given.
        arrival_times: s, increasing, float64, (N,).  rate: of the grid, Hz.
        method: ``linear``, ``hold`` or ``band-limited``.  band: B of ``band-limited``, Hz.
        name: how messages call the data.
        start: of the grid, s on the clock of the arrivals.  samples: T.
        mean_rate: arrivals a second.  longest_gap: between them, and where it begins, s.
    """

    values: Tensor
    arrival_times: Tensor
    rate: float
    method: str
    band: float
    name: str
    start: float
    samples: int
    mean_rate: float
    longest_gap: tuple[float, float]

    @property
    def times(self) -> Tensor:
        """s, (T,), float64."""
        return self.start + torch.arange(self.samples, dtype=torch.float64) / self.rate

    def rebuilt(self, values: Tensor) -> Tensor:
        """Other values at the same arrivals on the same grid: (..., N) to (..., T)."""
        points, times = self.times, self.arrival_times
        if self.method == "band-limited":
            return _spline_fit(times, values, points, self.band)
        before = torch.searchsorted(times, points + ROUNDING / self.rate, right=True) - 1
        if self.method == "hold":
            return values[..., before]
        before = before.clamp(max=len(times) - 2)
        share = ((points - times[before]) / (times[before + 1] - times[before])).clamp(0, 1)
        return torch.lerp(values[..., before], values[..., before + 1], share)


def onto_grid(
    arrival_times: Any,
    values: Any,
    rate: float | None = None,
    method: str = "linear",
    *,
    frequency: float | None = None,
    band: float | None = None,
    name: str = "arrivals",
) -> GridSignal:
    """Values at random times onto a uniform grid.

    Args:
        arrival_times: s, increasing, (N,).  values: (N,), m/s or any unit.
        rate: of the grid, Hz; default twice the mean rate of the arrivals, with a tone at least 16 whole steps a
            period. A finer grid adds points, no information.
        method: ``linear``, ``hold`` or ``band-limited``.
        frequency: of the tone, Hz, for a default rate.
        band: B of ``band-limited``, Hz; default a quarter of the mean rate.
        name: how messages call the data.
    Raises:
        ValueError: times that do not increase, fewer than two samples, nan, unequal lengths, a grid that is too coarse
            or too fine.
    Warns:
        DataWarning: a gap longer than 20 mean intervals.
    Source: Roncen et al. (2026), section 3.3 (linear). The other two are alternatives of ours.
    """
    require_choice("method", method, GRID_METHODS)
    times, numbers = _checked(arrival_times, values, name)
    seconds = float(times[-1] - times[0])
    own = (len(times) - 1) / seconds
    if rate is None:
        rate = STEPS_AN_ARRIVAL * own
        if frequency is not None:
            require_positive("frequency (Hz)", frequency)
            rate = frequency * max(STEPS_A_PERIOD, math.ceil(rate / frequency))
    band = BAND_SHARE * own if band is None else band
    require_positive("rate of the grid (Hz)", rate)
    require_positive("band (Hz)", band)
    if not 1 <= seconds * rate + ROUNDING <= MOST_POINTS * max(len(times), FEWEST):
        raise ValueError(
            f"{name}: a grid of {rate:g} Hz over {seconds:g} s has {1 + seconds * rate:.3g} points for {len(times)} "
            f"arrivals; 2 to {MOST_POINTS} for each are possible: are the times in s?"
        )
    length, begin = float(times.diff().max()), float(times[times.diff().argmax()])
    samples, about = math.floor(seconds * rate + ROUNDING) + 1, (float(rate), method, float(band), name)
    signal = GridSignal(numbers, times, *about, float(times[0]), samples, own, (length, begin))
    if length * own > LONG_GAP:
        tell(
            f"{name}: the longest gap between arrivals is {1e3 * length:.3g} ms at {begin:.6g} s, "
            f"{length * own:.3g} mean intervals (limit {LONG_GAP:g}); what lies in it is made up"
        )
    return replace(signal, values=signal.rebuilt(numbers))


def _checked(arrival_times: Any, values: Any, name: str) -> tuple[Tensor, Tensor]:
    """Times and values, float64, (N,)."""
    times, numbers = real_tensor(arrival_times).cpu(), real_tensor(values).cpu()
    if times.ndim != 1 or times.shape != numbers.shape or len(times) < 2:
        shapes = f"times have shape {tuple(times.shape)}, values {tuple(numbers.shape)}"
        raise ValueError(f"{name}: {shapes}; both are (N,), two samples at least")
    bad, back = (~torch.isfinite(times + numbers)).nonzero(), (times.diff() <= 0).nonzero()
    if len(bad):
        raise ValueError(f"{name}: {len(bad)} samples are nan or inf, first sample {int(bad[0])}; leave them out")
    if len(back):
        here, after = times[int(back[0]) : int(back[0]) + 2].tolist()
        raise ValueError(
            f"{name}: {len(back)} times do not increase, first {here:.9g} s, then {after:.9g} s; sort them"
        )
    return times, numbers


def _spline_fit(arrival_times: Tensor, values: Tensor, points: Tensor, band: float) -> Tensor:
    """Least squares in splines, second differences of the coefficients weakly penalised (Eilers & Marx 1996).

    The penalty leaves straight lines as they are, and is all that holds the curve where a gap leaves no arrivals.
    """
    from scipy.interpolate import BSpline  # takes half a second or more to import
    from scipy.linalg import solveh_banded
    from scipy.sparse import diags_array

    times = arrival_times.numpy()
    count = math.floor((times[-1] - times[0]) * 2 * band) + 1 + DEGREE
    knots = times[0] + np.arange(-DEGREE, count + 1) / (2 * band)
    design = BSpline.design_matrix(times, knots, DEGREE)
    difference = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count))
    normal = design.T @ design + SMOOTHING * len(times) / count * (difference.T @ difference)
    bands = np.zeros((DEGREE + 1, count))  # upper form: row DEGREE - d holds diagonal d
    for d in range(DEGREE + 1):
        bands[DEGREE - d, d:] = normal.diagonal(d)
    flat = values.reshape(-1, len(times)).detach().numpy()
    coefficients = solveh_banded(bands, design.T @ flat.T)
    within = np.clip(points.numpy(), times[0], times[-1])
    found = BSpline.design_matrix(within, knots, DEGREE) @ coefficients
    return torch.from_numpy(found.T.copy()).reshape(*values.shape[:-1], -1)
