r"""Correlation and spectrum of random samples from their pairs, without a reconstruction.

Pairs of samples are sorted by their lag into slots. With local normalisation each slot is divided
by the mean squares of the very samples that fell into it, which takes most of the scatter out
(Tummers & Passchier 1996, after Mayo 1974; Benedict, Nobach & Tropea 2000):

.. math:: \rho_k = \frac{\sum v_i v_j}{\sqrt{\sum v_i^2 \sum v_j^2}},
    \quad |t_j-t_i-k\Delta| < \Delta/2.

No sample is paired with itself, so noise of single bursts does not enter. A slot averages over its
width: a line at f is reduced by :math:`\mathrm{sinc}(f\Delta)`, which is known and small.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchliner.bursts.arrivals import checked_bursts
from torchliner.checks import require_positive

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SlottedCorrelation:
    """Correlation over lags k times the slot width.

    Args:
        lag: s, (K + 1,).
        coefficient: rho, (K + 1,); nan where no pair fell.
        pairs: in each slot, (K + 1,).
        variance: of the samples, square of their unit.
    """

    lag: Array
    coefficient: Array
    pairs: Array
    variance: float


def slotted_correlation(
    arrival_times: Any, values: Any, slot: float, longest_lag: float, name: str = "arrivals"
) -> SlottedCorrelation:
    """Correlation coefficient of random samples by slots with local normalisation.

    Args:
        arrival_times: s, increasing, (N,).
        values: (N,); their mean is removed.
        slot: width of a slot, s.
        longest_lag: s.
        name: how messages call the data.
    Raises:
        ValueError: slot or lag is not above 0, or the lag is below the slot or above the record.
    """
    times, signal = (each.numpy() for each in checked_bursts(arrival_times, values, name))
    require_positive("slot (s)", slot)
    require_positive("longest_lag (s)", longest_lag)
    if not slot <= longest_lag <= times[-1] - times[0]:
        raise ValueError(
            f"{name}: longest_lag is {longest_lag:g} s; it must lie between the slot, {slot:g} s, "
            f"and the record, {times[-1] - times[0]:g} s"
        )
    signal = signal - signal.mean()
    count = round(longest_lag / slot) + 1
    sums = np.zeros((4, count))  # products, squares of either, pairs
    # Neighbours of order n at once; lags only grow with n, so the first order beyond all ends it.
    for order in range(1, len(times)):
        lag = times[order:] - times[:-order]
        number = np.floor(lag / slot + 0.5).astype(np.int64)
        inside = number < count
        if not inside.any():
            break
        first, second = signal[:-order][inside], signal[order:][inside]
        for row, weight in zip(sums, (first * second, first**2, second**2, None), strict=True):
            row += np.bincount(number[inside], weight, minlength=count)
    with np.errstate(invalid="ignore", divide="ignore"):
        coefficient = np.asarray(sums[0] / np.sqrt(sums[1] * sums[2]), dtype=np.float64)
    lags, pairs = (np.asarray(each, dtype=np.float64) for each in (np.arange(count), sums[3]))
    return SlottedCorrelation(slot * lags, coefficient, pairs, float(signal.var()))


def slotted_spectrum(found: SlottedCorrelation, window: str = "hann") -> tuple[Array, Array]:
    """Frequencies (K + 1,), Hz, and one-sided power spectral density, unit squared per Hz.

    The cosine transform of the correlation under the falling half of a window. Its integral up to
    1/(2 slot) is the variance times rho(0). Statistical error can make it negative.

    Args:
        found: from ``slotted_correlation``.
        window: any window of scipy.
    Raises:
        ValueError: a slot is empty.
    """
    from scipy.fft import dct  # takes half a second or more to import
    from scipy.signal import get_window

    empty = np.flatnonzero(~np.isfinite(found.coefficient))
    if len(empty):
        raise ValueError(
            f"{len(empty)} slots hold no pair, the first at a lag of {found.lag[empty[0]]:g} s; "
            "widen the slots or take a longer record"
        )
    lags = len(found.lag) - 1
    slot = float(found.lag[1])
    falling = get_window(window, 2 * lags + 1, fftbins=False)[lags:]
    # The transform of type I halves both ends: rho_0 + 2 sum rho_k cos(2 pi f k slot) + the last.
    density = 2 * slot * found.variance * dct(found.coefficient * falling, type=1)
    return np.arange(lags + 1) / (2 * lags * slot), np.asarray(density, dtype=np.float64)
