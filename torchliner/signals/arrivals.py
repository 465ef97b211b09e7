r"""Random samples onto a uniform grid: velocities known at the arrivals of particles alone.

Three ways, each linear in the values and fixed by the arrival times, so that what it does to a tone
can be computed for the very arrivals of a record (``torchliner.signals.attenuation``):

- ``linear`` (the paper, section 3.3) between neighbouring arrivals;
- ``hold``: the last value until the next arrival;
- ``band-limited``: least squares in splines on uniform knots.

No library among the dependencies fits a truncated Fourier series to irregular samples (that takes a
non-uniform FFT, and the fit is global). Splines of degree 5 on uniform knots 1/(2 B) apart, from
scipy (``BSpline.design_matrix``, ``solveh_banded``), tend to the functions band-limited to B as
their degree grows (Unser 1999) and have a short basis: the normal equations are banded, the cost is
that of a filter, and a gap spoils its neighbourhood alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import make_plain, real_tensor, require_choice, require_positive, tell
from torchliner.names import GAPS, GRID_METHODS

STEPS_A_PERIOD = 16  # of a tone, on a derived grid
STEPS_AN_ARRIVAL = 2  # folds at the mean rate, where Poisson arrivals leave 0.09 of a line
LONG_GAP = 20.0  # mean intervals; among 150 000 Poisson arrivals one in 3000 records has such a gap
BAND_SHARE = 0.25  # B over the mean rate: two arrivals a coefficient, twice the least density
MOST_POINTS, FEWEST = 1000, 1000  # of a grid, for an arrival; arrivals, for so few as show nothing
ROUNDING = 1e-9  # of a grid step: an arrival that near to a grid point is on it
DEGREE = 5
SMOOTHING = 1e-3  # second differences over the mean diagonal; 1e-4 gave turbulence 10 % too strong


@dataclass(frozen=True)
class UniformGrid:
    """Times start + k/rate, k = 0 .. samples - 1: s on the clock of the arrivals, and Hz."""

    start: float
    rate: float
    samples: int

    def __post_init__(self) -> None:
        make_plain(self)
        require_positive("rate of the grid (Hz)", self.rate)
        if self.samples < 2:
            raise ValueError(
                f"the arrivals leave {self.samples} grid points at {self.rate:g} Hz; two or more "
                "are needed, take a longer record or a higher rate"
            )

    @property
    def times(self) -> Tensor:
        """s, (T,), float64."""
        return self.start + torch.arange(self.samples, dtype=torch.float64) / self.rate


@dataclass(frozen=True)
class GridSignal:
    """Values on a grid, and what the arrivals were like.

    Args:
        values: (T,), or (stations, T); float64, in the unit given.  grid: of all stations.
        method, band: as asked.  mean_rate: arrivals a second, (stations,) or ().
        longest_gap, longest_gap_at: s, and s on the clock of the arrivals where it begins; alike.
        notes: what was warned of.
    """

    values: Tensor
    grid: UniformGrid
    method: str
    mean_rate: Tensor
    longest_gap: Tensor
    longest_gap_at: Tensor
    notes: tuple[str, ...] = ()
    band: float | None = None


def onto_grid(
    arrival_times: Any, values: Any, rate: float | None = None, method: str = "linear", *,
    frequency: float | None = None, band: float | None = None, longest_gap: float | None = None,
    gaps: str = "report", name: str = "arrivals",
) -> GridSignal:  # fmt: skip
    """Values at random times onto a uniform grid, one station or several of any lengths.

    Args:
        arrival_times: s, increasing, (N,); or a list of such, one a station.
        values: (N,), m/s or any unit; or a list, as the times.
        rate: Hz of the grid; None derives it, see ``derived_rate``.
        method: ``linear``, ``hold`` or ``band-limited``.
        frequency: Hz of the tone, for a derived rate.
        band: B of ``band-limited``, Hz; default a quarter of the station's mean rate.
        longest_gap: s; a longer gap between arrivals is reported or refused. Default: 20 mean
            intervals of the station.
        gaps: ``report`` (a warning with the number) or ``refuse``.
        name: how messages call the data.
    Returns:
        Values between the latest first and the earliest last arrival of the stations: nothing is
        extrapolated.
    Raises:
        ValueError: times do not increase, fewer than two samples, nan, lengths that differ, a rate
            or band that is not above 0, stations without common time, a gap that is refused.
    Warns:
        DataWarning: a gap is longer than ``longest_gap``.
    Source: Roncen et al. (2026), section 3.3 (linear). The other two are alternatives of ours.
    """
    require_choice("method", method, GRID_METHODS)
    require_choice("gaps", gaps, GAPS)
    stations, several = checked_stations(arrival_times, values, name)
    times = [each[0] for each in stations]
    grid = common_grid(times, derived_rate(times, frequency) if rate is None else rate)
    steps = [each.diff() for each in times]
    rates = torch.tensor([mean_rate(each) for each in times], dtype=torch.float64)
    lengths = torch.stack([step.max() for step in steps])
    places = torch.stack([t[step.argmax()] for t, step in zip(times, steps, strict=True)])
    notes = _long_gaps(rates, lengths, places, longest_gap, name)
    if notes and gaps == "refuse":
        raise ValueError(f"{notes[0]}; cut the record there, or accept it with gaps='report'")
    tell(notes)
    found = torch.stack([interpolate(t, v, grid, method, band) for t, v in stations])
    parts = (found, rates, lengths, places)
    found, rates, lengths, places = parts if several else (part[0] for part in parts)
    return GridSignal(found, grid, method, rates, lengths, places, notes, band)


def interpolate(
    arrival_times: Tensor, values: Tensor, grid: UniformGrid, method: str = "linear",
    band: float | None = None,
) -> Tensor:  # fmt: skip
    """One station's values on a grid that its arrivals span: (..., N) at (N,) to (..., T).

    No checks of the data: see ``onto_grid``.

    Raises:
        ValueError: the grid reaches beyond the arrivals.
    """
    slack, last = ROUNDING / grid.rate, grid.start + (grid.samples - 1) / grid.rate
    if grid.start < float(arrival_times[0]) - slack or last > float(arrival_times[-1]) + slack:
        raise ValueError(
            f"the grid runs from {grid.start:.9g} to {last:.9g} s, the arrivals from "
            f"{float(arrival_times[0]):.9g} to {float(arrival_times[-1]):.9g} s; nothing is "
            "extrapolated"
        )
    if method == "band-limited":
        band = BAND_SHARE * mean_rate(arrival_times) if band is None else band
        return spline_fit(arrival_times, values, grid.times, band)
    points = (grid.times + slack).to(values.device)
    times = arrival_times.to(values.device)
    before = torch.searchsorted(times, points, right=True) - 1
    if method == "hold":
        return values[..., before.clamp(min=0)]
    before = before.clamp(0, len(times) - 2)
    step = times[before + 1] - times[before]
    share = ((points - slack - times[before]) / step).clamp(0, 1)
    return torch.lerp(values[..., before], values[..., before + 1], share)


def derived_rate(arrival_times: Sequence[Tensor], frequency: float | None = None) -> float:
    """A grid rate, Hz: twice the highest mean rate of arrivals, 16 steps a period of the tone.

    With a tone it is rounded up to whole steps a period. A finer grid adds points, no information.
    """
    highest = STEPS_AN_ARRIVAL * max(mean_rate(each) for each in arrival_times)
    if frequency is None:
        return highest
    require_positive("frequency (Hz)", frequency)
    return frequency * max(STEPS_A_PERIOD, math.ceil(highest / frequency))


def common_grid(arrival_times: Sequence[Tensor], rate: float) -> UniformGrid:
    """The grid from the latest first arrival to the earliest last one.

    Raises:
        ValueError: the stations share no time, too little for two grid points, or so much that the
            times cannot be in s.
    """
    require_positive("rate of the grid (Hz)", rate)
    start = max(float(each[0]) for each in arrival_times)
    end = min(float(each[-1]) for each in arrival_times)
    if end <= start:
        raise ValueError(
            f"the stations share no time: one begins at {start:g} s, another ends at {end:g} s; "
            "count the times of each from its own start, or grid them one by one"
        )
    points, arrivals = (end - start) * rate, max(map(len, arrival_times))
    if points > MOST_POINTS * max(arrivals, FEWEST):
        raise ValueError(
            f"a grid of {rate:g} Hz over {end - start:g} s has {points:.3g} points for {arrivals} "
            f"arrivals, more than {MOST_POINTS} for each; are the times in s?"
        )
    return UniformGrid(start, float(rate), math.floor((end - start) * rate + ROUNDING) + 1)


def mean_rate(arrival_times: Tensor) -> float:
    """Arrivals a second: intervals over their sum."""
    return (len(arrival_times) - 1) / float(arrival_times[-1] - arrival_times[0])


def checked_stations(
    arrival_times: Any, values: Any = None, name: str = "arrivals"
) -> tuple[list[tuple[Tensor, Tensor]], bool]:
    """Pairs of times and values, (N,) each, checked, and whether a list of stations was given.

    Without ``values`` the times stand for them.
    """
    values = arrival_times if values is None else values
    if not _is_several(arrival_times):
        return [_checked(arrival_times, values, name)], False
    if not _is_several(values) or len(values) != len(arrival_times):
        count = len(values) if _is_several(values) else 1
        raise ValueError(f"{name}: {len(arrival_times)} stations of times, {count} of values")
    pairs = zip(arrival_times, values, strict=True)
    return [_checked(t, v, f"{name}, station {i}") for i, (t, v) in enumerate(pairs)], True


def _is_several(value: Any) -> bool:
    """Whether this is a list of stations and not the samples of one."""
    return isinstance(value, (list, tuple)) and len(value) > 0 and np.ndim(value[0]) > 0


def _checked(arrival_times: Any, values: Any, name: str) -> tuple[Tensor, Tensor]:
    times, numbers = real_tensor(arrival_times), real_tensor(values)
    if times.ndim != 1 or times.shape != numbers.shape:
        raise ValueError(
            f"{name}: times have shape {tuple(times.shape)}, values {tuple(numbers.shape)}; both "
            "are (N,), several stations are lists"
        )
    if len(times) < 2:
        raise ValueError(f"{name}: {len(times)} samples; two or more are needed")
    for kind, each in (("times", times), ("values", numbers)):
        bad = (~torch.isfinite(each)).nonzero()
        if len(bad):
            raise ValueError(
                f"{name}: {len(bad)} {kind} are nan or inf, the first is sample {int(bad[0])}; leave these samples out"
            )
    back = (times.diff() <= 0).nonzero()
    if len(back):
        i = int(back[0])
        raise ValueError(
            f"{name}: {len(back)} times do not increase, first {float(times[i]):.9g} s, then "
            f"{float(times[i + 1]):.9g} s (sample {i + 1}); sort them and keep one sample of each"
        )
    return times.cpu(), numbers


def _long_gaps(rates: Tensor, lengths: Tensor, places: Tensor, limit: float | None, name: str) -> tuple[str, ...]:
    if limit is not None:
        require_positive("longest_gap (s)", limit)
    limits = LONG_GAP / rates if limit is None else torch.full_like(rates, limit)
    long = lengths > limits
    if not bool(long.any()):
        return ()
    worst = int(torch.where(long, lengths, 0).argmax())
    several = f"{int(long.sum())} of {len(rates)} stations have gaps beyond the limit; "
    several = f"{len(long)} of {len(rates)} stations have gaps beyond the limit; "
    return (
        f"{name}: {several if len(rates) > 1 else ''}the longest gap between arrivals is "
        f"{1e3 * lengths[worst]:.3g} ms at {places[worst]:.6g} s, "
        f"{lengths[worst] * rates[worst]:.3g} mean intervals (limit {1e3 * limits[worst]:.3g} ms); "
        "what lies in it is made up",
    )


def spline_fit(arrival_times: Tensor, values: Tensor, points: Tensor, band: float) -> Tensor:
    """Least squares in splines, second differences of the coefficients weakly penalised.

    The penalty (P-splines, Eilers & Marx 1996) leaves constants and straight lines as they are, and
    is all that holds the curve where a gap leaves a coefficient without arrivals.

    Args:
        arrival_times: s, increasing, (N,).  values: (..., N).
        points: s, (T,), between the first and the last arrival.
        band: B, Hz; needs more than 2 B arrivals a second.
    Returns:
        (..., T), float64.
    """
    from scipy.interpolate import BSpline  # takes half a second or more to import
    from scipy.linalg import solveh_banded

    require_positive("band (Hz)", band)
    times = arrival_times.numpy()
    pieces = math.floor((times[-1] - times[0]) * 2 * band) + 1
    knots = times[0] + np.arange(-DEGREE, pieces + DEGREE + 1) / (2 * band)
    design = BSpline.design_matrix(times, knots, DEGREE)
    count = pieces + DEGREE
    normal = (design.T @ design).tocsr()
    bands = np.zeros((DEGREE + 1, count))  # upper form: row DEGREE - d holds diagonal d
    # D'D of the second differences has the diagonals 6, -4, 1 but for the ends.
    difference = np.array([1.0, -2.0, 1.0])
    for d in range(DEGREE + 1):
        bands[DEGREE - d, d:] = normal.diagonal(d)
        for i in range(3 - d):
            last = count - 2 + i
            bands[DEGREE - d, i + d : last + d] += SMOOTHING * len(times) / count * difference[i] * difference[i + d]
    flat = values.reshape(-1, len(times)).detach().cpu().numpy()
    coefficients = solveh_banded(bands, design.T @ flat.T)
    within = np.clip(points.numpy(), times[0], times[-1])
    found = BSpline.design_matrix(within, knots, DEGREE) @ coefficients
    return torch.from_numpy(found.T.copy()).reshape(*values.shape[:-1], -1).to(values.device)
