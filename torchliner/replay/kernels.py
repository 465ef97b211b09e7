r"""Impulse responses of the reflection coefficient, one per velocity level.

The published recipe takes the inverse transform of R(omega, |v|) at fixed |v| and keeps the taps at
t >= 0 (eqs 3.1-3.3). But the empirical nonlinear terms are not causal at fixed |v|: the real and
imaginary parts of R are not a Hilbert pair, and the dropped taps carry up to a third of the
resistance. The data are recorded, so nothing forbids taps before zero: the default is a two-sided
least-squares filter on a band. A causal filter of this length cannot come near that error: 1e-3
already costs gains of tens to hundreds outside the band, so it would amplify any noise.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import require_choice
from torchliner.compiled.threads import one_thread
from torchliner.liners.model import Liner
from torchliner.liners.response import reflection_of
from torchliner.names import KERNELS
from torchliner.reduction.basis import Basis
from torchliner.replay.levels import VelocityGrid, interpolate

BAND = (300.0, 3500.0)  # Hz, that of the paper's test rig
BEFORE = 2e-3  # s of taps before zero
AFTER = 10e-3  # s of taps after zero
Grid = VelocityGrid | Basis  # |v| of a table

REGULARISATION = 1e-7  # Tikhonov, relative to the largest singular value of the design matrix


@dataclass(frozen=True)
class KernelTable:
    """Impulse responses h[m; |v|], m = first .. first + K - 1, at one sampling rate.

    Args:
        taps: float64, shape (V, K).
        first: index of the first tap, <= 0.
        sampling_rate: Hz.
        grid: velocity levels, V of them.
        band: Hz, where the response stands for the liner's.
        kind: ``two-sided`` or ``causal``.
        error: largest |H - R| in the band over all levels.
        gain: largest |H| at any frequency over all levels.
    """

    taps: Tensor
    first: int
    sampling_rate: float
    grid: Grid
    band: tuple[float, float]
    kind: str
    error: float
    gain: float

    @property
    def lags(self) -> Tensor:
        """Tap indices m, float64, shape (K,)."""
        return torch.arange(self.taps.shape[-1], dtype=torch.float64) + self.first

    def response(self, frequency: Tensor) -> Tensor:
        """H(f; |v|) at the levels, complex128, shape (V, F)."""
        return _response(self.taps, self.lags, frequency, self.sampling_rate)

    def require_band(self, frequency: Tensor) -> None:
        """Refuse frequencies at which the filter does not stand for the liner."""
        low, high = self.band
        outside = [f for f in frequency.tolist() if not low <= f <= high]
        if outside:
            raise ValueError(
                f"frequency {outside[0]:g} Hz is outside the kernel's band, {low:g}-{high:g} Hz; "
                "widen it with band=(low, high)"
            )


def reflection_at_levels(liner: Liner, frequency: Tensor, grid: Grid) -> Tensor:
    """R(f, |v|) of a liner at the levels of a grid, complex128, shape (V, F)."""
    return reflection_of(liner, frequency, grid.speeds[:, None])


def level_error(liner: Liner, frequency: Tensor, grid: VelocityGrid) -> float:
    """Largest error in R of the levels' interpolation, halfway between levels."""
    middle = (grid.speeds[1:] + grid.speeds[:-1]) / 2
    found = interpolate(reflection_at_levels(liner, frequency, grid), *grid.locate(middle))
    return float((found - reflection_of(liner, frequency, middle[:, None])).abs().max())


@one_thread()
def build_kernels(
    liner: Liner,
    grid: Grid,
    sampling_rate: float,
    *,
    kind: str = "two-sided",
    band: tuple[float, float] = BAND,
    before: float = BEFORE,
    after: float = AFTER,
    regularisation: float = REGULARISATION,
) -> KernelTable:
    """Kernel table of a liner.

    Args:
        liner: gives Z(f, |v|).
        grid: velocity levels.
        sampling_rate: Hz.
        kind: ``two-sided``, least squares on ``band``; ``causal``, the Hermitian inverse transform
            up to Nyquist with the taps before zero dropped, which is (3.2) and (3.3) to the letter
            and, because R at fixed |v| is not causal, off by up to a third of the resistance.
        band: Hz.
        before, after: s of taps kept on either side of zero.
        regularisation: Tikhonov parameter of the least squares, relative.
    Raises:
        ValueError: an unknown kind, or a band that is empty or reaches beyond Nyquist.
    Source: Roncen et al. (2026), eqs (3.1)-(3.3). Departures: (3.3) is printed one-sided; the
        transform is the Hermitian one with R(0) = 1. Default kernel two-sided, see above.
    """
    require_choice("kernel", kind, KERNELS)
    low, high = band
    if not 0 < low < high:
        raise ValueError(f"band is {low:g}-{high:g} Hz; it must run from above 0 upwards")
    if high > 0.49 * sampling_rate:
        if low >= 0.49 * sampling_rate:
            raise ValueError(f"band starts at {low:g} Hz, beyond the rate {sampling_rate:g} Hz")
        high = 0.49 * sampling_rate
    if kind == "two-sided":
        first, last = -round(before * sampling_rate), round(after * sampling_rate)
        taps = _fit(liner, grid, (first, last, sampling_rate), (low, high), regularisation)
    else:
        first = 0
        taps = _causal_part(liner, grid, sampling_rate, round(after * sampling_rate) + 1)
    error, gain = _quality(taps, first, sampling_rate, (low, high), liner, grid)
    return KernelTable(taps, first, sampling_rate, grid, (low, high), kind, error, gain)


def _quality(
    taps: Tensor,
    first: int,
    sampling_rate: float,
    band: tuple[float, float],
    liner: Liner,
    grid: Grid,
) -> tuple[float, float]:
    """Largest |H - R| in the band, between the frequencies of the fit too, and largest |H|."""
    size = 1 << (8 * taps.shape[1] - 1).bit_length()
    spectrum = torch.fft.rfft(taps.detach(), n=size)
    frequency = torch.fft.rfftfreq(size, 1 / sampling_rate, dtype=torch.float64)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    edges = torch.tensor(band, dtype=torch.float64)
    lags = torch.arange(taps.shape[1], dtype=torch.float64) + first
    shift = torch.exp(-2j * torch.pi * frequency[inside] / sampling_rate * first)
    found = torch.cat([spectrum[:, inside] * shift, _response(taps.detach(), lags, edges, sampling_rate)], dim=1)
    with torch.no_grad():
        wanted = reflection_at_levels(liner, torch.cat([frequency[inside], edges]), grid)
    return float((found - wanted).abs().max()), float(spectrum.abs().max())


def _response(taps: Tensor, lags: Tensor, frequency: Tensor, sampling_rate: float) -> Tensor:
    turn = 2 * torch.pi * frequency / sampling_rate
    waves = torch.exp(-1j * torch.outer(lags, turn))
    return taps.to(torch.complex128) @ waves


def _fit(
    liner: Liner,
    grid: Grid,
    lags: tuple[int, int, float],
    band: tuple[float, float],
    regularisation: float,
) -> Tensor:
    """Least-squares taps at K lags (first, last, sampling rate) for R on the band, (V, K)."""
    frequency, rows, factors, pivots = _normal_equations(lags, band, regularisation)
    wanted = reflection_at_levels(liner, frequency, grid)
    target = torch.cat([wanted.real, wanted.imag], dim=1)
    return torch.linalg.lu_solve(factors, pivots, target.T).T @ rows


@functools.lru_cache(maxsize=4)  # an audit or a fit builds hundreds of tables at one rate
def _normal_equations(
    lags: tuple[int, int, float], band: tuple[float, float], regularisation: float
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Frequencies (F,), rows (2F, K) and the factors of the damped normal equations: no liner."""
    first, last, rate = lags
    times = torch.arange(first, last + 1, dtype=torch.float64) / rate
    # The band holds about 2 (high - low) T real unknowns over a duration T; six frequencies to
    # each pair, clustered towards the band's ends like Chebyshev nodes, leave nothing unseen.
    points = max(32, round(6 * (band[1] - band[0]) * float(times[-1] - times[0])))
    theta = torch.linspace(0, torch.pi, points, dtype=torch.float64)
    frequency = (band[0] + band[1]) / 2 - (band[1] - band[0]) / 2 * theta.cos()
    waves = torch.outer(2 * torch.pi * frequency, times)
    rows = torch.cat([waves.cos(), -waves.sin()])
    # Fewer equations than taps: the dual form solves 2F unknowns instead of K.
    normal = rows @ rows.T
    scale = torch.linalg.eigvalsh(normal)[-1]
    damped = normal + regularisation**2 * scale * torch.eye(2 * points, dtype=torch.float64)
    return frequency, rows, *torch.linalg.lu_factor(damped)


def _causal_part(liner: Liner, grid: Grid, sampling_rate: float, count: int) -> Tensor:
    """The first ``count`` taps at t >= 0 of the Hermitian inverse transform, (V, count)."""
    # Eight times the kept length, so that the transform's own period folds nothing into it.
    size = 1 << (8 * count - 1).bit_length()
    frequency = torch.fft.rfftfreq(size, 1 / sampling_rate, dtype=torch.float64)
    spectrum = torch.ones(grid.levels, len(frequency), dtype=torch.complex128)  # R(0) = 1
    spectrum[:, 1:] = reflection_at_levels(liner, frequency[1:], grid)
    return torch.fft.irfft(spectrum, n=size)[:, :count].contiguous()
