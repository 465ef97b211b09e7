r"""Random samples onto a uniform grid: velocities that are known at the arrivals of particles alone.

``linear`` (the paper, section 3.3) draws straight lines between the arrivals, ``hold`` keeps the last value,
``band-limited`` is a least-squares fit in splines of degree 5 on uniform knots 1/(2 B) apart, which tend to the
functions band-limited to B as their degree grows (Unser 1999). The normal equations are banded, so that the cost is
that of a filter, and a gap spoils its neighbourhood alone.

Each method is linear in the values and fixed by the arrival times, so that what it does to a tone is known for the very
arrivals of a record: :math:`v = A e^{j\omega t} + A^* e^{-j\omega t}` has, on the grid, the windowed line
:math:`\hat A = G A + H A^*`, where G is the line of the reconstruction of :math:`e^{j\omega t_i}` and H that of its
conjugate. G is the attenuation; H, which has no mean over arrivals, lets :math:`\hat A` depend on the phase.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, real_tensor, require_choice, require_positive, tell
from torchliner.names import GRID_METHODS
from torchliner.tones import tone_amplitudes, window_weights

MOST_POINTS, FEWEST = 1000, 1000  # of a grid, for an arrival; arrivals, for so few as show nothing
STEPS_A_PERIOD = 16  # of a tone, on a derived grid
STEPS_AN_ARRIVAL = 2  # folds at the mean rate, where Poisson arrivals leave 0.09 of a line
LONG_GAP = 20.0  # mean intervals; among 150 000 Poisson arrivals one in 3000 records has such a gap
BAND_SHARE = 0.25  # B over the mean rate: two arrivals a coefficient, twice the least density
ROUNDING = 1e-9  # of a grid step: an arrival that near to a grid point is on it
DEGREE = 5
SMOOTHING = 1e-3  # second differences over the mean diagonal; 1e-4 gave turbulence 10 % too strong
LEAST_FACTOR = 0.3  # of a tone; below, a correction would raise noise by more than a factor 3


@dataclass(frozen=True, eq=False)
class GridSignal:
    """A signal on a uniform grid from the first arrival to the last one; nothing is extrapolated.

    Args:
        values: on the grid, (T,), in the unit given.
        arrival_times: s, increasing, float64, (N,).  rate: of the grid, Hz.
        method: ``linear``, ``hold`` or ``band-limited``.  band: B of ``band-limited``, Hz.
        name: how messages call the data.
        samples: T.  mean_rate: arrivals a second.  longest_gap: between them, and where it begins, s.
    """

    values: Tensor
    arrival_times: Tensor
    rate: float
    method: str
    band: float
    name: str
    samples: int
    mean_rate: float
    longest_gap: tuple[float, float]

    @property
    def start(self) -> float:
        """Of the grid, s on the clock of the arrivals."""
        return float(self.arrival_times[0])

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
    times, numbers = real_tensor(arrival_times).cpu(), real_tensor(values).cpu()
    if times.ndim != 1 or times.shape != numbers.shape or len(times) < 2:
        shapes = f"times have shape {tuple(times.shape)}, values {tuple(numbers.shape)}"
        raise ValueError(f"{name}: {shapes}; both are (N,), two samples at least")
    steps, bad = times.diff(), (~torch.isfinite(times + numbers)).nonzero()
    if len(bad):
        raise ValueError(f"{name}: {len(bad)} samples are nan or inf, first sample {int(bad[0])}; leave them out")
    if len(back := (steps <= 0).nonzero()):
        here, after = times[int(back[0]) : int(back[0]) + 2].tolist()
        raise ValueError(
            f"{name}: {len(back)} times do not increase, first {here:.9g} s, then {after:.9g} s; sort them"
        )
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
    length, begin = float(steps.max()), float(times[steps.argmax()])
    about = (float(rate), method, float(band), name, math.floor(seconds * rate + ROUNDING) + 1, own, (length, begin))
    signal = GridSignal(numbers, times, *about)
    if length * own > LONG_GAP:
        tell(
            f"{name}: the longest gap between arrivals is {1e3 * length:.3g} ms at {begin:.6g} s, "
            f"{length * own:.3g} mean intervals (limit {LONG_GAP:g}); what lies in it is made up"
        )
    return replace(signal, values=signal.rebuilt(numbers))


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


@dataclass(frozen=True, eq=False)
class ToneAttenuation:
    """The factors of a tone's line for the arrivals of a signal: line = factor A + image A*.

    Args:
        factor, image: G and H, complex128, (F,).  frequency: Hz, (F,).  weights: of the window, (T,).
    """

    factor: Tensor
    image: Tensor
    frequency: Tensor
    weights: Tensor

    def line(self, signal: GridSignal) -> Tensor:
        """Of the tones as they are in a gridded signal, phase at the grid's start, complex128, (F,)."""
        return tone_amplitudes(signal.values, self.frequency, signal.rate, self.weights)

    def true_amplitude(self, line: Tensor) -> Tensor:
        """A from the windowed lines GA + HA* of the gridded signal, (F,), exactly."""
        determinant = self.factor.abs() ** 2 - self.image.abs() ** 2
        return (self.factor.conj() * line - self.image * line.conj()) / determinant


def tone_attenuation(signal: GridSignal, frequency: Any, window: Any = "hann") -> ToneAttenuation:
    """The complex factors on a tone's windowed line for the arrivals, grid and method of a signal.

    Args:
        signal: from ``onto_grid``; its values do not count.
        frequency: Hz, one or several.
        window: any window of scipy, over the record.
    Raises:
        ValueError: a frequency above half the mean rate, outside the band of the fit or not below half the grid's rate.
    """
    wanted, grid = frequency_tensor(frequency), signal
    highest = float(wanted.max())
    if grid.mean_rate < 2 * highest:
        raise ValueError(
            f"{grid.name}: {grid.mean_rate:.6g} arrivals a second in the mean are fewer than two a period of "
            f"{highest:g} Hz, which cannot be put on a grid (correction='none' leaves a stated tone as it is)"
        )
    if grid.method == "band-limited" and highest >= grid.band:
        raise ValueError(
            f"{grid.name}: {highest:g} Hz is not below the band of the fit, {grid.band:g} Hz; these arrivals carry a "
            f"quarter of the mean rate, {BAND_SHARE * grid.mean_rate:g} Hz"
        )
    frequency_tensor(wanted, grid.rate)
    weights, lines = window_weights(window, grid.samples), []
    for f in wanted:
        turns = 2 * torch.pi * f * (grid.arrival_times - grid.start)
        both = grid.rebuilt(torch.stack([turns.cos(), turns.sin()]))  # two signals in memory at a time
        lines.append(tone_amplitudes(both, f[None], grid.rate, weights)[:, 0])
    # The line is linear over the reals: A = a + jb is v = 2a cos - 2b sin, whose line 2aC - 2bS is GA + HA* for all
    # a, b with G = C + jS, H = C - jS.
    cosine, sine = torch.stack(lines, 1)
    return ToneAttenuation(cosine + 1j * sine, cosine - 1j * sine, wanted, weights)


def corrected_coherent_part(signal: GridSignal, attenuation: ToneAttenuation, *, noise: bool = False) -> GridSignal:
    """The signal with each tone's own part put back to its amplitude, all else untouched.

    Noise at the line is raised by 1/G with it; what the reconstruction took from the turbulence stays lost.

    Args:
        attenuation: from ``tone_attenuation`` of that signal.
        noise: take out the whole reconstruction of the tone, the noise that it made of it too.
    Raises:
        ValueError: a factor below 0.3 (the correction would raise noise by more than 3).
    """
    smallest = float(attenuation.factor.abs().min())
    if smallest < LEAST_FACTOR:
        raise ValueError(
            f"{signal.name}: {signal.method} reconstruction leaves {smallest:.3g} of the tone, and a correction would "
            f"raise noise {1 / smallest:.3g} times (limit: factor {LEAST_FACTOR:g}); take more arrivals, or no "
            "correction (correction='none')"
        )

    def tones(amplitude: Tensor, times: Tensor) -> Tensor:
        turns = 2 * torch.pi * torch.outer(attenuation.frequency, times - signal.start)
        return 2 * (amplitude.real @ turns.cos() - amplitude.imag @ turns.sin())

    line = attenuation.line(signal)
    amplitude = attenuation.true_amplitude(line)
    made = signal.rebuilt(tones(amplitude, signal.arrival_times)) if noise else tones(line, signal.times)
    return replace(signal, values=signal.values + tones(amplitude, signal.times) - made)
