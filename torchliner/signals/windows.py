"""Analysis windows and their expansion in cosines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.names import did_you_mean

NAMES = [
    *("boxcar", "triang", "blackman", "hamming", "hann", "bartlett", "flattop", "parzen", "bohman"),
    *("blackmanharris", "nuttall", "barthann", "cosine", "tukey", "lanczos", "kaiser", "gaussian"),
    *("general_hamming", "chebwin", "dpss", "taylor"),
]
# The two that nearly all use, as (mean, cosine).
PLAIN = {"hann": (0.5, 0.5), "boxcar": (1.0, 0.0)}
LEAST_LINE = 1e-3  # of a window's mean
MOST_LINES = 11  # a sum of more cosines is cheaper through the kernel tables


@dataclass(frozen=True)
class Window:
    """A periodic window of N samples.

    Args:
        weights: float64, shape (N,).
        lines: orders q and complex coefficients c_q with w[k] = sum_q c_q exp(2 pi j q k/N), if
            they are few (Hann: 3); else empty.
        name: as given.
    """

    weights: Tensor
    lines: tuple[tuple[int, complex], ...]
    name: str

    @property
    def orders(self) -> tuple[int, ...]:
        """Lines that it mixes into one, in multiples of 1/N of the rate: those of its cosines, else
        those above 1e-3 of its own, at most ``MOST_LINES``."""
        if self.lines:
            return tuple(q for q, _ in self.lines)
        size = torch.fft.rfft(self.weights).abs()[: MOST_LINES // 2 + 1]
        far = int((size > LEAST_LINE * size[0]).nonzero().max())
        return tuple(range(-far, far + 1))


def make_window(name: Any, samples: int) -> Window:
    """A window of scipy by name, in its periodic form.

    Args:
        name: ``hann`` and so on; windows with a parameter as a tuple or as text,
            ``("kaiser", 8.0)`` or ``"kaiser,8"``.
        samples: N.
    Raises:
        TypeError: no name: an array of weights, a number.
        ValueError: scipy knows no such window, or it needs a parameter.
    """
    named = name[0] if isinstance(name, (tuple, list)) and name else name
    if not isinstance(named, str):
        raise TypeError(
            f"window is {type(name).__name__}; it is given by name, as 'hann', 'kaiser,8' or "
            "('kaiser', 8.0), so that it fits any length"
        )
    label = str(name) if isinstance(name, str) else ",".join(str(part) for part in name)
    kind, *parameters = label.split(",")
    if label in PLAIN:
        mean, cosine = PLAIN[label]
        weights = np.full(samples, mean)
        if cosine:
            weights -= cosine * np.cos(2 * np.pi * (np.arange(samples) / samples))
        # Known; a transform of some 1e5 samples would take longer than the replay of a station.
        lines: tuple[tuple[int, complex], ...] = ((0, complex(mean)),)
        if cosine:
            lines += ((1, complex(-cosine / 2)), (-1, complex(-cosine / 2)))
        few = len(lines) > max(1, samples // 2)
        return Window(torch.from_numpy(weights), () if few else lines, label)
    from scipy.signal import get_window  # takes half a second or more to import

    try:
        arguments: Any = (kind, *(float(p) for p in parameters)) if parameters else kind
        weights = np.asarray(get_window(arguments, samples, fftbins=True), dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"unknown window {label!r}{did_you_mean(kind, NAMES)}: {error}; "
            "any window of scipy.signal.get_window will do"
        ) from error
    return Window(torch.from_numpy(weights.copy()), _cosine_lines(weights), label)


def _cosine_lines(weights: np.ndarray) -> tuple[tuple[int, complex], ...]:
    count = len(weights)
    spectrum = np.fft.fft(weights) / count
    kept = np.flatnonzero(np.abs(spectrum) > 1e-13 * np.abs(spectrum).max())
    if len(kept) > min(MOST_LINES, max(1, count // 2)):
        return ()
    # Orders above N/2 stand for negative ones.
    return tuple((int(q) if q <= count // 2 else int(q) - count, complex(spectrum[q])) for q in kept)
