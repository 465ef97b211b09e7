r"""Random samples onto a uniform grid: velocities that are known at the arrivals of particles alone.

``linear`` (the paper, section 3.3) draws straight lines between the arrivals, ``hold`` keeps the last value,
``band-limited`` is a least-squares fit in splines of degree 5 on uniform knots 1/(2 B) apart, which tend to the
functions band-limited to B as their degree grows (Unser 1999).

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

from torchliner.checks import frequency_tensor, real_tensor, require_choice, require_positive
from torchliner.names import GRID_METHODS
from torchliner.pressure.spectra import tone_amplitudes, window_weights

MOST_POINTS, FEWEST = 1000, 1000  # of a grid, for an arrival; arrivals, for so few as show nothing
STEPS_A_PERIOD = 16  # of a tone, on a derived grid
STEPS_AN_ARRIVAL = 2  # folds at the mean rate, where Poisson arrivals leave 0.09 of a line
BAND_SHARE = 0.25  # B over the mean rate: two arrivals a coefficient, twice the least density
ROUNDING = 1e-9  # of a grid step: an arrival that near to a grid point is on it
DEGREE = 5
SMOOTHING = 1e-3  # second differences over the mean diagonal; 1e-4 gave turbulence 10 % too strong
LEAST_FACTOR = 0.3  # of a tone; below, a correction would raise noise by more than a factor 3


@dataclass(frozen=True, eq=False)
class GridSignal:
    """A signal on a uniform grid from the first arrival to the last one; nothing is extrapolated."""

    values: Tensor  # (T,)
    arrival_times: Tensor  # s, (N,)
    rate: float  # of the grid, Hz
    method: str
    band: float  # B of ``band-limited``, Hz
    name: str

    @property
    def start(self) -> float:
        """Of the grid, s on the clock of the arrivals."""
        return float(self.arrival_times[0])

    @property
    def duration(self) -> float:
        """From the first arrival to the last one, s."""
        return float(self.arrival_times[-1]) - self.start

    @property
    def mean_rate(self) -> float:
        """Arrivals a second."""
        return (len(self.arrival_times) - 1) / self.duration

    @property
    def times(self) -> Tensor:
        """s, (T,), float64."""
        samples = math.floor(self.duration * self.rate + ROUNDING) + 1
        return self.start + torch.arange(samples, dtype=torch.float64) / self.rate

    def rebuilt(self, values: Tensor) -> Tensor:
        """Other values at the same arrivals on the same grid: (..., N) to (..., T)."""
        points, times = self.times, self.arrival_times
        if self.method == "band-limited":
            return _spline_fit(times.numpy(), values, points.numpy(), self.band)
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
    Source: Roncen et al. (2026), section 3.3 (linear). The other two are alternatives of ours.
    """
    require_choice("method", method, GRID_METHODS)
    times, numbers = real_tensor(arrival_times).cpu(), real_tensor(values).cpu()
    same = times.ndim == 1 and times.shape == numbers.shape and len(times) > 1
    if not same or not bool(torch.isfinite(times + numbers).all()):
        shapes = f"times have shape {tuple(times.shape)}, values {tuple(numbers.shape)}"
        raise ValueError(f"{name}: {shapes}; both are (N,), two finite samples at least")
    if len(back := (times.diff() <= 0).nonzero()):
        raise ValueError(f"{name}: {len(back)} times do not increase, first after {float(times[back[0]]):.9g} s")
    signal = GridSignal(numbers, times, rate or 0.0, method, band or 0.0, name)
    own, seconds = signal.mean_rate, signal.duration
    if rate is None:
        rate = STEPS_AN_ARRIVAL * own
        if frequency is not None:
            rate = frequency * max(STEPS_A_PERIOD, math.ceil(rate / frequency))
    band = BAND_SHARE * own if band is None else band
    require_positive("rate of the grid (Hz)", rate)
    require_positive("band (Hz)", band)
    if not 1 <= seconds * rate + ROUNDING <= MOST_POINTS * max(len(times), FEWEST):
        raise ValueError(
            f"{name}: a grid of {rate:g} Hz over {seconds:g} s has {1 + seconds * rate:.3g} points for {len(times)} "
            f"arrivals; 2 to {MOST_POINTS} for each are possible: are the times in s?"
        )
    signal = replace(signal, rate=float(rate), band=float(band))
    return replace(signal, values=signal.rebuilt(numbers))


def _spline_fit(times: np.ndarray, values: Tensor, points: np.ndarray, band: float) -> Tensor:
    """Least squares in splines, second differences of the coefficients weakly penalised (Eilers & Marx 1996).

    The penalty leaves straight lines as they are, and is all that holds the curve where a gap leaves no arrivals. The
    equations are banded, so that the cost is that of a filter.
    """
    from scipy.interpolate import BSpline  # takes half a second or more to import
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    count = math.floor((times[-1] - times[0]) * 2 * band) + 1 + DEGREE
    knots = times[0] + np.arange(-DEGREE, count + 1) / (2 * band)
    design = BSpline.design_matrix(times, knots, DEGREE)
    difference = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count))
    normal = design.T @ design + SMOOTHING * len(times) / count * (difference.T @ difference)
    coefficients = splu(normal.tocsc()).solve(design.T @ values.reshape(-1, len(times)).detach().numpy().T)
    found = BSpline.design_matrix(np.clip(points, times[0], times[-1]), knots, DEGREE) @ coefficients
    return torch.from_numpy(found.T.copy()).reshape(*values.shape[:-1], -1)


@dataclass(frozen=True, eq=False)
class ToneAttenuation:
    """What a grid makes of tones: the line of A is G A + H A*, under weights of a window, (T,)."""

    factor: Tensor  # G, complex128, (F,)
    image: Tensor  # H, complex128, (F,)
    frequency: Tensor  # Hz, (F,)
    weights: Tensor

    def line(self, signal: GridSignal) -> Tensor:
        """Of the tones as they are in a gridded signal, phase at the grid's start, complex128, (F,)."""
        return tone_amplitudes(signal.values, self.frequency, signal.rate, self.weights)

    def true_amplitude(self, line: Tensor) -> Tensor:
        """A from the windowed lines GA + HA* of the gridded signal, (F,), exactly."""
        determinant = self.factor.abs() ** 2 - self.image.abs() ** 2
        return (self.factor.conj() * line - self.image * line.conj()) / determinant


def tone_attenuation(signal: GridSignal, frequency: Any, window: str = "hann") -> ToneAttenuation:
    """The complex factors on a tone's windowed line for the arrivals, grid and method of a signal.

    Args:
        signal: from ``onto_grid``; its values do not count.
        frequency: Hz, one or several.
        window: of ``names.WINDOWS``, over the record.
    Raises:
        ValueError: a frequency above half the mean rate, outside the band of the fit or not below half the grid's rate.
    """
    wanted = frequency_tensor(frequency)
    highest = float(wanted.max())
    if signal.mean_rate < 2 * highest:
        raise ValueError(
            f"{signal.name}: {signal.mean_rate:.6g} arrivals a second in the mean are fewer than two a period of "
            f"{highest:g} Hz, which cannot be put on a grid (correction='none' leaves a stated tone as it is)"
        )
    if signal.method == "band-limited" and highest >= signal.band:
        raise ValueError(
            f"{signal.name}: {highest:g} Hz is not below the band of the fit, {signal.band:g} Hz; these arrivals carry "
            f"a quarter of the mean rate, {BAND_SHARE * signal.mean_rate:g} Hz"
        )
    frequency_tensor(wanted, signal.rate)
    weights, lines = window_weights(window, len(signal.values)), []
    for f in wanted:
        turns = 2 * torch.pi * f * (signal.arrival_times - signal.start)
        both = signal.rebuilt(torch.stack([turns.cos(), turns.sin()]))  # two signals in memory at a time
        lines.append(tone_amplitudes(both, f[None], signal.rate, weights)[:, 0])
    # The line is linear over the reals: A = a + jb is v = 2a cos - 2b sin, whose line 2aC - 2bS is GA + HA* for all
    # a, b with G = C + jS, H = C - jS.
    cosine, sine = torch.stack(lines, 1)
    return ToneAttenuation(cosine + 1j * sine, cosine - 1j * sine, wanted, weights)


def corrected_coherent_part(signal: GridSignal, attenuation: ToneAttenuation) -> GridSignal:
    """The signal with each tone's own part put back to its amplitude, and noise at the line with it, all else
    untouched; a ValueError where a factor is below 0.3, since that would raise noise by more than 3."""
    smallest = float(attenuation.factor.abs().min())
    if smallest < LEAST_FACTOR:
        raise ValueError(
            f"{signal.name}: {signal.method} reconstruction leaves {smallest:.3g} of the tone (limit "
            f"{LEAST_FACTOR:g}); take more arrivals, or no correction (correction='none')"
        )
    line = attenuation.line(signal)
    more = attenuation.true_amplitude(line) - line
    turns = 2 * torch.pi * torch.outer(attenuation.frequency, signal.times - signal.start)
    return replace(signal, values=signal.values + 2 * (more.real @ turns.cos() - more.imag @ turns.sin()))
