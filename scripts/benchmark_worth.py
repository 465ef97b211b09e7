"""Times of the error bars and of the audit, against what gives the same numbers without them."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

import torchliner as tl
from torchliner.signals.bootstrap import beyond_runs, neighbour_correlation

LOOPED = 4  # probes of the plain loop
DRAWS = 999
# Choices whose rows an audit has, as runs of their own.
ALONE: tuple[dict[str, Any], ...] = (
    {}, {"window": "boxcar"}, {"window": "blackman"}, {"edge": "silent"}, {"response": "kernel"},
    {"kernel": "causal"}, {"response": "kernel", "spacing": "uniform", "interpolation": "linear"},
    {"mean": "removed"}, {"drive": "rms"}, {"drive": "running-rms"}, {"phase": "self-consistent"},
)  # fmt: skip


def error_bars(plane: tl.VelocityPlane, liner: tl.SDoFLiner) -> None:
    """``educe`` with and without intervals, and a plain loop over draws and probes."""
    count = plane.probes * plane.samples

    def timed(run: Callable[[], Any]) -> tuple[float, Any]:
        run()
        start = time.perf_counter()
        found = run()
        return time.perf_counter() - start, found

    print("error bars: ns per velocity sample, and per probe")
    without, _ = timed(lambda: tl.educe(plane, liner, interval=None))
    seconds, found = timed(lambda: tl.educe(plane, liner))
    for name, amount in (("educe without intervals", without), ("educe, 95 % intervals", seconds)):
        print(f"  {name:44s} {1e9 * amount / count:8.1f} ns  {1e6 * amount / plane.probes:8.0f} us")
    start = time.perf_counter()
    errors = [plain_loop(plane, liner, found, probe) for probe in range(LOOPED)]
    each = (time.perf_counter() - start) / LOOPED
    mine = (seconds - without) / plane.probes
    print(f"  {'the same bootstrap, a loop over draws':44s} {'':11s}  {1e6 * each:8.0f} us  "
          f"({each / mine:.0f} times the intervals' share; standard errors differ by "
          f"{max(errors):.1%})")  # fmt: skip


def plain_loop(
    plane: tl.VelocityPlane, liner: tl.SDoFLiner, found: tl.ImpedanceMap, probe: int
) -> float:
    """Moving blocks of the whole series of R of one probe, one draw after the other."""
    assert found.uncertainty is not None
    frequency = found.frequency
    speed = plane.velocity[probe].abs().double()
    response = tl.reflection_from_impedance(liner.impedance(frequency, speed)).numpy()
    settings = found.uncertainty.settings
    blocks, long = settings["blocks"], plane.sampling_rate / float(frequency[0])
    borders = (
        np.round(np.arange(blocks + 1) * long * settings["periods_per_block"])
        .astype(int)
        .clip(max=plane.samples)
    )
    runs = float(found.uncertainty.probes.runs[probe, 0])
    length = round(blocks / runs)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(plane.samples) / plane.samples)
    means = np.array([response[a:b].mean() for a, b in itertools.pairwise(borders)])
    away = response - means.mean()
    generator = np.random.default_rng(0)
    draws = []
    for _ in range(DRAWS):
        pieces, filled = [], 0
        while filled < plane.samples:
            first = generator.integers(0, blocks - length + 1)
            pieces.append(away[borders[first] : borders[first + length]])
            filled += len(pieces[-1])
        series = np.concatenate(pieces)[: plane.samples]
        draws.append((window * series).sum() / window.sum())
    reflection = complex(found.reflection[probe, 0])
    rho = neighbour_correlation(torch.from_numpy(means)[:, None])
    scale = np.sqrt(blocks / (blocks - length) * float(beyond_runs(rho, torch.tensor(length))))
    z = [(1 + r) / (1 - r) for r in reflection + scale * (np.array(draws) - np.mean(draws))]
    mine = float(found.uncertainty.probes.standard_error[probe, 0].real)
    return abs(float(np.std(np.real(z))) / mine - 1)


def audit_rows(plane: tl.VelocityPlane, liner: tl.SDoFLiner) -> None:
    """The audit of one plane against an ``educe`` for each of some of its rows."""
    start = time.perf_counter()
    audited = tl.audit(plane, liner, velocity_max=16.0)
    seconds = time.perf_counter() - start
    start = time.perf_counter()
    alone = [
        complex(found.liner_impedance[0])
        for found in (
            tl.educe(plane, liner, velocity_max=16.0, interval=None, **choices) for choices in ALONE
        )
    ]
    each = (time.perf_counter() - start) / len(ALONE)
    rows = [audited.base, *(row.impedance for row in audited.rows)]
    error = max(min(abs(value - row) for row in rows) for value in alone)
    count = len(audited.rows) + 1
    print(f"audit: {count - 1} variants in {seconds:.1f} s, {audited.readings} readings; one educe "
          f"{each:.2f} s, {count} of them {each * count:.1f} s and {2 * count} readings "
          f"({each * count / seconds:.1f} times); largest difference {error:.1e}")  # fmt: skip


def worth(velocity: torch.Tensor, rate: float, frequency: float, liner: tl.SDoFLiner) -> None:
    """Both, on (P, T) float32."""
    plane = tl.VelocityPlane(velocity, sampling_rate=rate, frequency=frequency)
    error_bars(plane, liner)
    audit_rows(plane, liner)
