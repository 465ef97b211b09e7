"""The published recipe as others would write it: a loop over emission times, eq. (3.2).

Both return the windowed line of the reflected signal of each probe for one real incident signal.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


def numpy_recipe(speed: Array, taps: Array, maximum: float, wave: Array, analysis: Array) -> Array:
    """Plain NumPy: ``speed`` (P, n), ``taps`` (V, K) on uniform levels, linear interpolation."""
    probes, n = speed.shape
    levels, length = taps.shape
    lines = np.zeros(probes, dtype=complex)
    for p in range(probes):
        reflected = np.zeros(n + length)
        for k in range(n):
            place = speed[p, k] / maximum * (levels - 1)
            i = min(int(place), levels - 2)
            share = place - i
            kernel = (1 - share) * taps[i] + share * taps[i + 1]
            reflected[k : k + length] += wave[k] * kernel
        lines[p] = reflected[:n] @ analysis
    return lines


def numba_recipe(parallel: bool = True, fast: bool = False) -> Any:
    """The same loop compiled, over all cores; ``fast``: reordered sums."""
    import numba

    @numba.njit(parallel=parallel, fastmath=fast)  # type: ignore[untyped-decorator]
    def recipe(speed: Array, taps: Array, maximum: float, wave: Array, analysis: Array) -> Array:
        probes, n = speed.shape
        levels, length = taps.shape
        lines = np.zeros(probes, dtype=np.complex128)
        for p in numba.prange(probes):
            reflected = np.zeros(n + length, dtype=taps.dtype)
            for k in range(n):
                place = speed[p, k] / maximum * (levels - 1)
                i = min(int(place), levels - 2)
                high = taps.dtype.type((place - i) * wave[k])
                low = taps.dtype.type((1 - (place - i)) * wave[k])
                for m in range(length):
                    reflected[k + m] += low * taps[i, m] + high * taps[i + 1, m]
            total = 0j
            for k in range(n):
                total += reflected[k] * analysis[k]
            lines[p] = total
        return lines

    return recipe
