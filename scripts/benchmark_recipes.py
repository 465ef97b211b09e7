"""The published recipe as others would write it: a loop over emission times, eq. (3.2).

Both return the windowed line of the reflected signal of each probe for one real incident signal.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from torchliner.engine.kernels import build_kernels
from torchliner.signals.windows import make_window

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


def loops(bench: Any) -> None:
    """Rows of ``benchmark.py``: on the recipe's own kernels (causal, uniform levels, linear)."""
    rate, tone, samples = bench.plane.sampling_rate, bench.plane.frequency, bench.plane.samples
    taps = build_kernels(
        bench.liner, rate, velocity_max=16.0, kind="causal", spacing="uniform", interpolation="linear"
    ).taps
    steps = torch.arange(samples, dtype=torch.float64)
    wave = torch.cos(2 * torch.pi * tone / rate * steps)
    turning = torch.exp(-2j * torch.pi * tone / rate * steps)
    analysis = (make_window("hann", samples).weights * turning).numpy()
    speed = bench.velocity.cpu().double().abs().T.contiguous().numpy()
    rows: list[tuple[str, Any, torch.Tensor]] = [("loop in NumPy, float64", numpy_recipe, taps)]
    if importlib.util.find_spec("numba") is None:
        print("loop in numba: not measured, numba is missing (pip install -e .[benchmark])")
    else:
        rows.append(("loop in numba, float64", numba_recipe(), taps))
        rows.append(("loop in numba, fastmath, float32", numba_recipe(fast=True), taps.float()))
    for name, recipe, own in rows:

        def run(probes: int, recipe: Any = recipe, own: torch.Tensor = own) -> float:
            start = bench.clock()
            recipe(speed[:probes], own.numpy(), 16.0, wave.numpy(), analysis)
            return bench.clock() - start

        run(1)
        probes = bench.fitting(run(2) / 2)
        bench.row(f"{name}, {probes} probes", run(probes), probes * samples)
