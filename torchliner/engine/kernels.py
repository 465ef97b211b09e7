r"""Impulse responses of the reflection coefficient, one for each level of |v|.

The published recipe is the inverse transform of R(omega, |v|) at fixed |v|, of which the taps at t >= 0 are kept, eqs
(3.1)-(3.3). But the empirical nonlinear terms are not causal at fixed |v|: the taps that are dropped carry up to a
third of the resistance. The velocity is recorded, so nothing forbids taps before zero: the default is a two-sided
filter, fitted by least squares to R on a band.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import make_plain, require_choice, require_positive
from torchliner.engine.nodes import lagrange
from torchliner.engine.sums import is_differentiated, one_thread
from torchliner.liners.model import Liner, LinerModel, reflection_of
from torchliner.names import INTERPOLATIONS, KERNELS, SPACINGS

BAND = (300.0, 3500.0)  # Hz, that of the paper's rig
BEFORE, AFTER = 2e-3, 10e-3  # s of taps before and after zero
REGULARISATION = 1e-7
HIGHEST = 0.49  # of the sampling rate: the end of the band
TESTED = 8  # frequencies to one over the length of a kernel
MOST_LEVELS = 10_000  # with 600 taps such a table takes 50 MB
STENCILS = {"linear": (0, 1), "cubic": (-1, 0, 1, 2)}  # levels, counted from the one below |v|
ROUNDING = 1e-6  # relative: a largest |v| that was found in float32


@dataclass(frozen=True)
class VelocityGrid:
    """Levels of |v| from 0 to ``maximum``, uniform in |v| or in its square root.

    Args:
        maximum: largest |v|, m/s, of a whole data set: the result of a probe must not depend on its neighbours.
        levels: V, 4 to 10 000.
        spacing: ``sqrt`` or ``uniform`` (the paper).
        interpolation: ``cubic`` (local Lagrange polynomials) or ``linear`` (the paper).
    Source: Roncen et al. (2026), section 3.1: 200 uniform levels, linear. Levels uniform in the root of |v| resolve
        where the loss turns from |v|^2 to |v|: the error in R falls from 2e-2 to 6e-6 at 20 m/s.
    """

    maximum: float
    levels: int = 200
    spacing: str = "sqrt"
    interpolation: str = "cubic"

    def __post_init__(self) -> None:
        make_plain(self)
        require_positive("velocity_max (m/s)", self.maximum)
        require_choice("level spacing", self.spacing, SPACINGS)
        require_choice("interpolation", self.interpolation, INTERPOLATIONS)
        if not 4 <= self.levels <= MOST_LEVELS:
            raise ValueError(f"levels is {self.levels}; it must be 4 to {MOST_LEVELS}")

    @property
    def speeds(self) -> Tensor:
        """|v| of each level, m/s, float64, (V,)."""
        steps = torch.arange(self.levels, dtype=torch.float64) / (self.levels - 1)
        return self.maximum * (steps**2 if self.spacing == "sqrt" else steps)

    def locate(self, speed: Tensor) -> tuple[Tensor, list[Tensor]]:
        """First of the levels between which |v| (m/s, any shape) is interpolated, int64, and the weight of each.

        Beyond ``maximum`` the weights are nan: no result comes from extrapolated kernels, nothing is read back.
        """
        share = torch.where(speed <= self.maximum * (1 + ROUNDING), speed, torch.nan) / self.maximum
        if self.spacing == "sqrt":
            share = share.clamp(min=1e-30).sqrt()  # not 0, where the derivative of a root is infinite
        place = share * (self.levels - 1)
        nodes = STENCILS[self.interpolation]
        base = place.detach().floor().clamp(-nodes[0], self.levels - 1 - nodes[-1]).nan_to_num(-nodes[0])
        return base.to(torch.int64) + nodes[0], lagrange(place - base, nodes)


def interpolate(table: Tensor, index: Tensor, weights: Sequence[Tensor]) -> Tensor:
    """Rows of a table (V, K), real or complex, gathered from ``index`` on, (...), and combined by weights: (..., K)."""
    if table.is_complex() or is_differentiated(table, *weights):
        return torch.stack([table[index + i] * weight[..., None] for i, weight in enumerate(weights)]).sum(0)
    stencils = index.reshape(-1, 1) + torch.arange(len(weights), device=index.device)
    shares = torch.stack([weight.flatten() for weight in weights], dim=1)
    # The same sum without a temporary; it has no forward derivative.
    found = torch.nn.functional.embedding_bag(stencils, table, per_sample_weights=shares, mode="sum")
    return found.unflatten(0, index.shape)


@dataclass(frozen=True, eq=False)
class KernelTable:
    """Impulse responses h[m; |v|], m = first .. first + K - 1, at one sampling rate."""

    taps: Tensor  # float64, (V, K), of ``grid``, V levels of |v|
    first: int  # m of the first tap, 0 or negative
    sampling_rate: float
    grid: VelocityGrid
    band: tuple[float, float]  # Hz, where the response is that of the liner
    kind: str
    error: float  # largest |H - R| in the band, at the levels
    level_error: float  # of the interpolation between them
    gain: float  # largest |H| at any frequency and level

    def response(self, frequency: Tensor) -> Tensor:
        """H(f; |v|) at the levels, complex128, (V, F)."""
        return tap_response(self.taps, self.first, frequency, self.sampling_rate)


@one_thread()
def build_kernels(
    liner: Liner,
    sampling_rate: float,
    *,
    velocity_max: float,
    kind: str = "two-sided",
    levels: int = 200,
    spacing: str = "sqrt",
    interpolation: str = "cubic",
    band: tuple[float, float] = BAND,
    before: float = BEFORE,
    after: float = AFTER,
    regularisation: float = REGULARISATION,
) -> KernelTable:
    """Kernel table of a liner; differentiable in the parameters of the liner.

    Args:
        liner: gives Z(f, |v|).
        sampling_rate: of the data, Hz.
        velocity_max, levels, spacing, interpolation: of ``VelocityGrid``.
        kind: ``two-sided``: least squares on ``band``, Hz. ``causal``: the inverse transform up to Nyquist without the
            taps before zero, whose resistance is up to a third too low.
        before, after: s of taps on either side of zero.
        regularisation: Tikhonov parameter, relative to the largest singular value of the least squares.
    Source: Roncen et al. (2026), eqs (3.1)-(3.3), section 3.1. To the letter of the paper:
        ``kind="causal", levels=200, spacing="uniform", interpolation="linear"``. Departures from print: (3.3) is
        printed one-sided, the transform is the Hermitian one with R(0) = 1; the defaults are two-sided kernels and
        cubics in the root of the speed.
    """
    grid = VelocityGrid(velocity_max, levels, spacing, interpolation)
    speeds = grid.speeds
    taps, first = kernel_taps(liner, speeds, sampling_rate, kind, band, before, after, regularisation)
    inside = band[0], min(band[1], HIGHEST * sampling_rate)
    with torch.no_grad():
        points = max(TESTED, round(TESTED * (inside[1] - inside[0]) * taps.shape[1] / sampling_rate))
        tested, middle = torch.linspace(*inside, points, dtype=torch.float64), (speeds[1:] + speeds[:-1]) / 2
        wanted = reflection_of(liner, tested, speeds[:, None])
        between = interpolate(wanted, *grid.locate(middle)) - reflection_of(liner, tested, middle[:, None])
        away = tap_response(taps, first, tested, sampling_rate) - wanted
        error, level_error = (float(each.abs().max()) for each in (away, between))
        gain = float(torch.fft.rfft(taps, n=TESTED * taps.shape[1]).abs().max())
    return KernelTable(taps, first, sampling_rate, grid, inside, kind, error, level_error, gain)


def kernel_band(needed: Sequence[float], liner: LinerModel, sampling_rate: float) -> tuple[float, float]:
    """Where kernels are to be the liner, Hz: the rig's band and the frequencies ``needed``, Hz; ValueError where the
    liner or the sampling rate (Hz) does not reach that far."""
    least, most = min(needed), max(needed)
    known = liner.frequency_range or (0.0, math.inf)
    low, high = max(min(BAND[0], least), known[0]), min(max(BAND[1], most), known[1], HIGHEST * sampling_rate)
    if least < low or most > high:
        raise ValueError(
            f"R is needed from {least:g} to {most:g} Hz; the kernels hold from {low:g} to {high:g} Hz, the range of "
            "the liner below 0.49 of the sampling rate: narrow the wave"
        )
    return low, high


@one_thread()
def kernel_taps(
    liner: Liner,
    speeds: Tensor,
    sampling_rate: float,
    kind: str = "two-sided",
    band: tuple[float, float] = BAND,
    before: float = BEFORE,
    after: float = AFTER,
    regularisation: float = REGULARISATION,
) -> tuple[Tensor, int]:
    """Impulse responses at any |v|, m/s, (V,), as of ``build_kernels``: taps (V, K), and m of the first."""
    require_choice("kernel", kind, KERNELS)
    require_positive("sampling_rate (Hz)", sampling_rate)
    low, high = band[0], min(band[1], HIGHEST * sampling_rate)
    if not 0 < low < high:
        raise ValueError(
            f"band is {band[0]:g} Hz to {band[1]:g} Hz; it must run upwards, to 0.49 of {sampling_rate:g} Hz"
        )
    last = round(after * sampling_rate)
    if kind == "causal":
        size = 1 << (8 * last + 7).bit_length()  # so long that its own period folds nothing into the taps kept
        frequency = torch.fft.rfftfreq(size, 1 / sampling_rate, dtype=torch.float64)[1:]
        at_zero = torch.ones(len(speeds), 1, dtype=torch.complex128)  # R(0) = 1
        spectrum = torch.cat([at_zero, reflection_of(liner, frequency, speeds[:, None])], dim=1)
        return torch.fft.irfft(spectrum, n=size)[:, : last + 1].contiguous(), 0
    first = -round(before * sampling_rate)
    times = torch.arange(first, last + 1, dtype=torch.float64) / sampling_rate
    # Six frequencies for each pair of the 2 (high - low) T unknowns in a duration T, closer at the ends of the band.
    points = max(32, round(6 * (high - low) * float(times[-1] - times[0])))
    theta = torch.linspace(0, torch.pi, points, dtype=torch.float64)
    frequency = (low + high) / 2 - (high - low) / 2 * theta.cos()
    turns, wanted = torch.outer(2 * torch.pi * frequency, times), reflection_of(liner, frequency, speeds[:, None])
    rows, target = torch.cat([turns.cos(), -turns.sin()]), torch.cat([wanted.real, wanted.imag], dim=1)
    normal = rows @ rows.T  # the dual form: 2F unknowns, fewer than taps
    damping = regularisation**2 * torch.linalg.eigvalsh(normal)[-1]
    return torch.linalg.solve(normal + damping * torch.eye(len(normal)), target.T).T @ rows, first


def tap_response(taps: Tensor, first: int, frequency: Tensor, sampling_rate: float) -> Tensor:
    """H(f; |v|) of taps from ``first`` on, complex128, (V, F)."""
    lags = torch.arange(taps.shape[1], dtype=torch.float64) + first
    return taps.to(torch.complex128) @ torch.exp(-1j * torch.outer(lags, 2 * torch.pi * frequency / sampling_rate))
