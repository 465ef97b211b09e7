"""Time and error of the engines on one synthetic plane.

    python scripts/benchmark.py [--probes 1712] [--samples 2280] [--full]

--full is the paper's plane: 548 x 50 probes x 2280 samples, 200 kHz, float32. Times are ns per
velocity sample, the best of three; errors are the largest in R against float64 `direct` on the
same kernels (or, for wrapped records, against the formula in float64).
"""

from __future__ import annotations

import argparse
import functools
import platform
import time
import warnings
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import DataWarning
from torchliner.eduction.velocity import educe
from torchliner.liners.catalogue import load_liner
from torchliner.records import VelocityPlane
from torchliner.replay import spectral
from torchliner.replay.edges import Record
from torchliner.replay.spectral import response_of, spectral_sums
from torchliner.signals.windows import make_window

RATE, FREQUENCY = 200e3, 1400.0


class Held:
    """A slab source over a tensor in memory, time first."""

    def __init__(self, speed: Tensor) -> None:
        self.speed, (self.samples, self.probes) = speed, speed.shape
        self.dtype, self.device = speed.dtype, speed.device

    def read(self, begin: int, end: int) -> Tensor:
        return self.speed[begin:end]


def best_time(work: Callable[[], Any], repeats: int = 3) -> tuple[float, Any]:
    """Seconds of the fastest of some runs, after one that is not counted."""
    result, fastest = None, float("inf")
    if repeats > 1:
        work()
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()
        fastest = min(fastest, time.perf_counter() - start)
    return fastest, result


def line(name: str, seconds: float, samples: int, floor: float, error: float | None) -> None:
    each = 1e9 * seconds / samples
    shown = "" if error is None else f"{error:9.1e}"
    print(f"{name:44s} {each:11.2f} {each / floor:9.1f} {shown:>10s}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--probes", type=int, default=1712, help="a sixteenth of the paper's plane")
    parser.add_argument("--samples", type=int, default=2280)
    parser.add_argument("--full", action="store_true", help="the paper's 27 400 probes")
    options = parser.parse_args()
    warnings.simplefilter("ignore", DataWarning)
    probes, samples = 27400 if options.full else options.probes, options.samples
    generator = torch.Generator().manual_seed(0)
    velocity = 2 * torch.randn(samples, probes, generator=generator)
    liner, count = load_liner("polito"), samples * probes
    machine = f"{platform.machine()}, {torch.get_num_threads()} threads, torch {torch.__version__}"
    print(f"{machine}; {probes} probes x {samples} samples, float32, liner polito, 1400 Hz")
    print(f"{'':44s} {'ns/sample':>11s} {'of floor':>9s} {'error in R':>10s}")
    seconds, _ = best_time(velocity.sum)
    floor = 1e9 * seconds / count
    line("plane.sum(), the floor", seconds, count, floor, None)

    speed = velocity.abs()
    frequency = torch.tensor([FREQUENCY], dtype=torch.float64)
    for window in ("boxcar", "hann"):
        record = Record(samples, 0, make_window(window, samples), "wrap", RATE)
        response = response_of(liner, record.line_frequencies(FREQUENCY)[0], None, None)
        run = functools.partial(
            spectral_sums, responses=[response], frequency=frequency, record=record,
            tables=[None], grid=None, backward=False,
        )  # fmt: skip
        exact = run(Held(speed[:, :64].to(torch.float64))).forward
        total = record.window.weights.sum()
        for compiled in (False, True):
            seconds, sums = best_time(functools.partial(run, Held(speed), compiled=compiled))
            error = float(((sums.forward[:64] - exact) / total).abs().max())
            kind = "compiled" if compiled else "eager"
            line(f"spectral, wrap, {window}, {kind}", seconds, count, floor, error)

    plane = VelocityPlane(velocity.T, sampling_rate=RATE, frequency=FREQUENCY)
    seconds, found = best_time(lambda: educe(plane, liner), 1)
    part = VelocityPlane(velocity[:, :4].T, sampling_rate=RATE, frequency=FREQUENCY)
    top = float(found.choices["velocity_max"])
    direct_seconds, wanted = best_time(
        lambda: educe(part, liner, engine="direct", velocity_max=top), 1
    )
    error = float((found.reflection[:4] - wanted.reflection).abs().max())
    line("educe, default (finite, hann, survey, cells)", seconds, count, floor, error)
    line("educe, engine direct, 4 probes", direct_seconds, 4 * samples, floor, 0.0)
    print(f"slabs of {spectral.SLAB_ROWS} rows, blocks of {spectral.BLOCK_ELEMENTS} elements")


if __name__ == "__main__":
    main()
