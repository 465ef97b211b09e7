r"""What a reconstruction from random samples does to a tone.

Each method of ``torchliner.signals.arrivals`` is linear in the values. A tone
:math:`v = A e^{j\omega t} + A^* e^{-j\omega t}` known at the arrivals alone therefore has, on the
grid, the windowed line

.. math:: \hat A = G A + H A^*,

where G is the line of the reconstruction of :math:`e^{j\omega t_i}` and H that of its conjugate:
two numbers of the arrival times, of the window and of the method, known exactly. G is the
attenuation; H, which has no mean over arrivals, is what lets :math:`\hat A` depend on the phase.

For a Poisson process of rate :math:`\lambda` the distances B, F from any instant to the arrivals
before and after are independent and exponential. With :math:`x = \omega/\lambda`:

- hold: :math:`\langle G\rangle = \langle e^{-j\omega B}\rangle = 1/(1+jx)`.
- linear: given D = B + F, of density :math:`\lambda^2 D e^{-\lambda D}`, B is uniform on (0, D) and
  the mean of :math:`[F e^{-j\omega B} + B e^{j\omega F}]/D` over it is
  :math:`2(1-\cos\omega D)/(\omega D)^2`; over D, by Frullani's integral,
  :math:`\langle G\rangle = \ln(1+x^2)/x^2`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_choice, require_positive, tell
from torchliner.names import GRID_METHODS
from torchliner.signals.arrivals import (
    BAND_SHARE,
    UniformGrid,
    checked_stations,
    common_grid,
    derived_rate,
    interpolate,
    mean_rate,
)
from torchliner.signals.transfer import segment_amplitudes

DAMPED = 0.95  # warned of below
ARRIVALS_A_PERIOD = 8.0  # warned of below
CLOSED_FORMS = ("linear", "hold")
REMEDY = "correct the tone with corrected_coherent_part"


@dataclass(frozen=True)
class ToneAttenuation:
    """The factors of a tone's line for given arrivals: line = factor A + image A*.

    Args:
        factor, image: G and H, complex128, (S, F), or (stations, S, F); S segments.
        frequency: Hz, (F,).  mean_rate: arrivals a second, () or (stations,).
        grid: the grid they hold for.  method, window, band: as asked.  notes: what was warned of.
    """

    factor: Tensor
    image: Tensor
    frequency: Tensor
    mean_rate: Tensor
    grid: UniformGrid
    method: str
    window: Any
    band: float | None = None
    notes: tuple[str, ...] = ()

    def true_amplitude(self, line: Tensor) -> Tensor:
        """A from the windowed lines GA + HA* of the gridded signal, (..., F), exactly."""
        determinant = self.factor.abs() ** 2 - self.image.abs() ** 2
        return (self.factor.conj() * line - self.image * line.conj()) / determinant


def poisson_attenuation(frequency: Any, rate: Any, method: str = "linear") -> Tensor:
    """Mean factor G of a tone for Poisson arrivals on a fine grid, complex128.

    Args:
        frequency: Hz.  rate: mean rate of the arrivals, Hz; broadcasts against the frequency.
        method: ``linear`` or ``hold``; the band-limited fit has no closed form.
    Source: derived in the module's docstring; linear interpolation at 1500 Hz gives
        0.84, 0.94, 0.98 for 15, 25, 50 kHz.
    """
    require_choice("method with a closed form", method, CLOSED_FORMS)
    high, low = (torch.as_tensor(each, dtype=torch.float64) for each in (frequency, rate))
    require_positive("frequency (Hz)", high.min())
    require_positive("mean rate (Hz)", low.min())
    turns = 2 * math.pi * high / low
    if method == "hold":
        return 1 / (1 + 1j * turns)
    return (torch.log1p(turns**2) / turns**2).to(torch.complex128)


def tone_attenuation(
    arrival_times: Any, frequency: Any, rate: float | None = None, method: str = "linear",
    window: Any = "hann", *, segment: float | None = None, band: float | None = None,
    grid: UniformGrid | None = None, name: str = "arrivals",
) -> ToneAttenuation:  # fmt: skip
    """The complex factors on a tone's windowed line for these very arrivals.

    Args:
        arrival_times: s, (N,), or a list of such.  frequency: Hz, one or several.
        rate, method, band: of the grid, as for ``onto_grid``; or ``grid`` itself.
        window: any window of scipy, over each segment.
        segment: s, overlapping by half; None for one segment of the whole record.
        name: how messages call the data.
    Raises:
        ValueError: the mean rate is below twice a frequency, a frequency is outside ``band`` or not
            below half the grid's rate, the grid reaches beyond the arrivals, or as ``onto_grid``.
    Warns:
        DataWarning: a factor below 0.95, with the number; fewer than 8 arrivals a period.
    """
    require_choice("method", method, GRID_METHODS)
    stations, several = checked_stations(arrival_times, name=name)
    times = [each[0] for each in stations]
    wanted = frequency_tensor(frequency)
    for i, each in enumerate(times):
        place = f"{name}, station {i}" if several else name
        _require_dense(each, wanted, band, method, place)
    if grid is None:
        fine = derived_rate(times, float(wanted.max())) if rate is None else rate
        grid = common_grid(times, fine)
    frequency_tensor(wanted, grid.rate)
    lines = [_pushed(each, wanted, grid, method, band, window, segment) for each in times]
    both = torch.stack(lines) if several else lines[0]
    rates = torch.tensor([mean_rate(each) for each in times], dtype=torch.float64)
    # The fit of a line is linear over the reals: A = a + jb is v = 2a cos - 2b sin, whose line
    # 2aC - 2bS equals GA + HA* for all a, b with G = C + jS, H = C - jS.
    cosine, sine = both.unbind(-2)
    found = ToneAttenuation(
        cosine + 1j * sine, cosine - 1j * sine, wanted, rates if several else rates[0], grid,
        method, window, band,
    )  # fmt: skip
    notes = _warnings_of(found, name)
    tell(notes)
    return replace(found, notes=notes)


def _pushed(
    times: Tensor, frequency: Tensor, grid: UniformGrid, method: str, band: float | None,
    window: Any, segment: float | None,
) -> Tensor:  # fmt: skip
    """Lines of the reconstructions of cosine and sine, (S, 2, F); two signals in memory."""
    turns = 2 * torch.pi * torch.outer(frequency.cpu(), times - grid.start)
    lines = [
        segment_amplitudes(
            interpolate(times, torch.stack([row.cos(), row.sin()]), grid, method, band),
            frequency[i : i + 1], grid.rate, window=window, segment=segment,
        )
        for i, row in enumerate(turns)
    ]  # fmt: skip
    return torch.cat(lines, -1)


def _require_dense(times: Tensor, frequency: Tensor, band: float | None, method: str, name: str) -> None:
    rate, highest = mean_rate(times), float(frequency.max())
    if rate < 2 * highest:
        raise ValueError(
            f"{name}: {rate:.6g} arrivals a second in the mean are fewer than two a period of "
            f"{highest:g} Hz; a tone above half the mean rate cannot be put on a grid"
        )
    limit = BAND_SHARE * rate if band is None else band
    if method == "band-limited" and highest >= limit:
        raise ValueError(
            f"{name}: {highest:g} Hz is not below the band of the fit, {limit:g} Hz; a band of a "
            f"quarter of the mean rate, {BAND_SHARE * rate:g} Hz, is what these arrivals carry"
        )


def _warnings_of(found: ToneAttenuation, name: str) -> tuple[str, ...]:
    notes, slowest = [], float(found.mean_rate.min())
    for i, frequency in enumerate(found.frequency.tolist()):
        size = found.factor[..., i].abs()
        if float(size.min()) < DAMPED:
            squared = ""
            if found.method in CLOSED_FORMS:
                twice = float(poisson_attenuation(2 * frequency, slowest, found.method).abs())
                squared = f", and at {2 * frequency:g} Hz, where |v| varies, to about {twice:.2f}"
            notes.append(
                f"{name}: {found.method} reconstruction from {slowest:.6g} arrivals a second damps "
                f"the tone of {frequency:g} Hz to {float(size.mean()):.3f} (least "
                f"{float(size.min()):.3f}){squared}; {REMEDY}"
            )
        if slowest < ARRIVALS_A_PERIOD * frequency:
            notes.append(
                f"{name}: {slowest / frequency:.3g} arrivals a period of {frequency:g} Hz, fewer "
                f"than {ARRIVALS_A_PERIOD:g}: |v(t)| between them is guessed"
            )
    return tuple(notes)
