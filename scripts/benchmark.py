"""Time and error of reduction, eduction and whole files, on one synthetic plane.

    python scripts/benchmark.py [--full] [--device cuda] [--only engines,worth,...]

The quick plane has 1712 probes x 2280 samples (200 kHz, 11.4 ms, float32); --full takes the
paper's, 548 x 50 probes. Times are ns per velocity sample and in sums over the plane, the best of
three runs after one that is not counted; engines that need longer than --seconds get fewer probes.
Each row's error is the largest in R against a plain mean of R(f, |v|) in float64 (engines that form
the reflected signal: against ``direct`` with the same kernels). Parts: engines, loops (the
published recipe), worth (error bars, audit, calibration), stations (laser Doppler), duct
(linearised Euler equations, microphones), files, memory, start.
"""

from __future__ import annotations

import argparse
import functools
import os
import platform
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import torch
from torch import Tensor

import torchliner as tl
from torchliner.compiled import library
from torchliner.liners.model import LinerModel
from torchliner.liners.response import reflection_of
from torchliner.names import ORDERS
from torchliner.records.slabs import SLAB_ROWS, bounds_of
from torchliner.reduction.basis import choose_basis
from torchliner.reduction.plan import PassPlan
from torchliner.reduction.sources import Columns, HeldSpeed
from torchliner.reduction.speed_sums import SpeedSums
from torchliner.replay.direct import replay_direct
from torchliner.replay.edges import Record
from torchliner.replay.emissions import Sent
from torchliner.replay.kernels import build_kernels
from torchliner.replay.levels import VelocityGrid
from torchliner.replay.sinks import CrossSpectra
from torchliner.replay.unfold import replay_unfold
from torchliner.signals.blocks import plan_blocks
from torchliner.signals.windows import make_window
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.prepare import prepare

RATE, FREQUENCY, SAMPLES = 200e3, 1400.0, 2280
MANY = [400.0 + 90 * i for i in range(60)]  # Hz
LONG = 400_000  # samples of one probe
COMPARED = 64  # probes of the plain mean
PARTS = ("engines", "loops", "worth", "stations", "duct", "files", "memory", "start")


class Bench:
    """The plane, the floor and how rows are printed."""

    def __init__(self, probes: int, seconds: float, device: str, cpu: bool) -> None:
        self.clock = time.process_time if cpu else time.perf_counter
        generator = torch.Generator().manual_seed(0)
        velocity = 2 * torch.randn(SAMPLES, probes, generator=generator)
        self.velocity = velocity.clamp(-15.9, 15.9).to(device)
        self.plane = self.plane_of(self.velocity)
        self.seconds, self.device = seconds, torch.device(device)
        self.liner = tl.load_liner("polito")
        self.floor = self.best(self.velocity.sum)[0] / self.velocity.numel()

    def plane_of(self, velocity: Tensor) -> tl.VelocityPlane:
        """Of (n, P), in cells of 25 probes."""
        x = (torch.arange(velocity.shape[1]) + 0.5) * self.pitch / 25
        return tl.VelocityPlane(velocity.T, sampling_rate=RATE, frequency=FREQUENCY, x=x)

    @functools.cached_property
    def long(self) -> Tensor:
        """One probe, (1, n)."""
        return self.velocity.flatten().repeat(1 + LONG // self.velocity.numel())[:LONG][None]

    @property
    def pitch(self) -> float:
        """Of the liner's cells, m."""
        return tl.load_liner("polito").cell_pitch or 1e-2

    def best(self, work: Callable[[], Any], repeats: int = 3) -> tuple[float, Any]:
        """Seconds of the fastest of some runs, after one that is not counted."""
        result, fastest = None, float("inf")
        for number in range(repeats + 1):
            start = self.clock()
            result = work()
            if self.device.type == "cuda":
                torch.cuda.synchronize()
            spent = self.clock() - start
            fastest = min(fastest, spent) if number else fastest
            if spent > self.seconds:
                return min(fastest, spent), result
        return fastest, result

    def row(self, name: str, seconds: float, samples: int, error: float | None = None, wanted: str = "") -> float:
        """Printed; ns per sample."""
        each = seconds / samples
        shown = "" if error is None else f"{error:.1e}"
        print(f"{name:50s} {1e9 * each:10.2f} {each / self.floor:9.1f} {shown:>9s}  {wanted}",
              flush=True)  # fmt: skip
        return 1e9 * each

    def fitting(self, seconds_per_probe: float) -> int:
        """As many probes as the time allows."""
        return max(1, min(self.velocity.shape[1], int(self.seconds / seconds_per_probe)))


def plain_means(liner: LinerModel, speed: Tensor, frequency: list[float], end: int) -> Tensor:
    """Means of R(f, |v|) over samples 0 to ``end`` - 1, complex128; ``speed`` (P, n)."""
    known = [
        reflection_of(liner, torch.tensor(f, dtype=torch.float64), speed[:, :end].double()).mean(1) for f in frequency
    ]
    return torch.stack(known, 1)


def engines(bench: Bench) -> None:
    """The floor, the sums, ``educe``, and the engines that form the reflected signal."""
    print(f"{'':50s} {'ns/sample':>10s} {'of floor':>9s} {'error':>9s}  wanted")
    count = bench.velocity.numel()
    bench.row("one sum over the plane, the floor", bench.floor * count, count)
    if bench.device.type == "cuda":
        copied = torch.empty_like(bench.velocity)
        seconds, _ = bench.best(lambda: copied.copy_(bench.velocity))
        bench.row(f"copy of the plane ({8e-9 * count / seconds:.0f} GB/s)", seconds, count)
    else:
        print("on a GPU: not measured (--device cuda)")
    compiled = bench.device.type == "cpu" and library.available()
    ways = [("compiled", "native")] * compiled + [("torch alone", "torch")]
    for name, way in ways:
        with mock.patch.dict(os.environ, TORCHLINER_SUMS=way):
            sums_row(bench, name)
            educe_rows(bench, name, 10 if way == "native" else 50)
    reflected_rows(bench)


def sums_row(bench: Bench, name: str) -> None:
    """Moments alone, of the record and 16 blocks."""
    asked = torch.tensor([FREQUENCY], dtype=torch.float64)
    basis = choose_basis([bench.liner], asked, 1e-6)
    blocks = plan_blocks(SAMPLES, 0, RATE / FREQUENCY)
    plan = PassPlan(SAMPLES, RATE, 0, SAMPLES, blocks)

    def work() -> SpeedSums:
        width = bench.velocity.shape[1]
        sums = SpeedSums(plan, basis, width, torch.float32, bench.device, True)
        for begin, end in bounds_of(SAMPLES, SLAB_ROWS):
            sums.add(begin, Columns(bench.velocity[begin:end]))
        return sums

    count = bench.velocity.numel()
    seconds, _ = bench.best(work)
    each = seconds / count
    bench.row(f"moments, {basis.count} orders, {blocks.count} blocks, {name}", seconds, count)
    long = bench.long.T
    blocks = plan_blocks(LONG, 0, RATE / FREQUENCY)
    plan = PassPlan(LONG, RATE, 0, LONG, blocks)

    def work_long() -> None:
        sums = SpeedSums(plan, basis, 1, torch.float32, bench.device, True)
        for begin, end in bounds_of(LONG, 256 * SLAB_ROWS):
            sums.add(begin, Columns(long[begin:end]))

    seconds, _ = bench.best(work_long)
    bench.row(f"moments, one probe, {LONG:.0e} samples, {name}", seconds, LONG, None,
              f"{seconds / LONG / each:.1f} x plane, <= 3")  # fmt: skip


def educe_rows(bench: Bench, name: str, wanted: int) -> None:
    """Plane in memory to map: survey, cells, closure, orders, error bars."""
    count, plane = bench.velocity.numel(), bench.plane
    whole = plan_blocks(SAMPLES, 0, RATE / FREQUENCY, most=1).borders[-1]
    part = bench.velocity[:, :COMPARED].T.cpu().abs()

    def educe(order: str = ORDERS[0], interval: float | None = 0.95, **choices: Any) -> Any:
        return bench.best(lambda: tl.educe(plane, bench.liner, order=order, interval=interval, **choices))

    bare, found = educe(interval=None)
    exact = plain_means(bench.liner, part, [FREQUENCY], whole)
    error = float((found.reflection[:COMPARED].cpu() - exact).abs().max())
    bench.row(f"educe, one reading, no error bars, {name}", bare, count, error)
    one, _ = educe()
    plain = bench.row(f"educe, one reading, error bars, {name}", one, count, error,
                      f"<= {wanted} x floor")  # fmt: skip
    print(f"{'':6s}(a stream at {1e-3 * RATE:g} kHz: one machine keeps up with "
          f"{1e9 / RATE / plain:.0f} probes)")  # fmt: skip
    seconds, found = educe(ORDERS[2], None)
    error = float((found.reflection_coherent_first[:COMPARED].cpu() - coherent(bench)).abs().max())
    bench.row(f"educe, the one rule, no error bars, {name}", seconds, count, error)
    seconds, _ = educe(ORDERS[2])
    bench.row(f"educe, the one rule, error bars, {name}", seconds, count, error)
    exact = plain_means(bench.liner, part, MANY, whole)
    for bars, level, alone in (("no error bars", None, bare), ("error bars", 0.95, one)):
        many, found = educe(interval=level, frequency=MANY)
        error = float((found.reflection[:COMPARED].cpu() - exact).abs().max())
        bench.row(f"educe, 60 frequencies, {bars}, {name}", many, count, error,
                  f"{many / alone:.2f} x one, <= 1.2")  # fmt: skip
    long = tl.VelocityPlane(bench.long, sampling_rate=RATE, frequency=FREQUENCY)
    seconds, found = bench.best(lambda: tl.educe(long, bench.liner, order=ORDERS[0]))
    end = plan_blocks(LONG, 0, RATE / FREQUENCY, most=1).borders[-1]
    exact = plain_means(bench.liner, long.velocity.cpu().abs(), [FREQUENCY], end)
    error = float((found.reflection.cpu() - exact).abs().max())
    bench.row(f"educe, one probe, {LONG:.0e} samples, {name}", seconds, LONG, error,
              f"{1e9 * seconds / LONG / plain:.1f} x plane, <= 3")  # fmt: skip


@functools.cache
def coherent(bench: Bench) -> Tensor:
    """Plain means of the |v*| of ``coherent first`` in float64, of the probes compared."""
    chosen = Choices(dtype="float64", interval=None)
    (ready,) = prepare([bench.plane], bench.liner, None, chosen)
    slabs = ready.driving.slabs(bounds_of(SAMPLES, SLAB_ROWS), [2])
    speed = torch.cat([group.speed[:, :COMPARED].cpu() for (group,) in slabs])
    return plain_means(bench.liner, speed.T, [FREQUENCY], ready.record.end)


def reflected_rows(bench: Bench) -> None:
    """``unfold`` by method, and ``direct``: one real tone on the default kernels, literal edges."""
    kernels = build_kernels(bench.liner, VelocityGrid(16.0), RATE)
    record = Record(SAMPLES, 0, make_window("hann", SAMPLES), "silent", RATE)
    steps = torch.arange(SAMPLES, dtype=torch.float64)
    emission = Sent(torch.cos(2 * torch.pi * FREQUENCY / RATE * steps), False)
    at = torch.tensor([FREQUENCY], dtype=torch.float64)

    def sink_of(probes: int) -> CrossSpectra:
        weights = record.window.weights
        return CrossSpectra(emission.signal, weights, [0], at, RATE, probes, bench.device)

    def reflection(velocity: Tensor, method: str) -> Tensor:
        sink = sink_of(velocity.shape[1])
        replay_unfold(HeldSpeed(velocity.T), kernels, emission, record, [sink], method=method)
        return sink.reflection()

    few = bench.velocity[:, :8].double().abs().T
    seconds, signal = bench.best(lambda: replay_direct(few, kernels, emission, record), 1)
    bench.row(f"direct, float64, {len(few)} probes", seconds, few.numel(), 0.0)
    sink = sink_of(len(few))
    sink.add(signal, slice(0, len(few)), 0)
    exact = sink.reflection()
    for name, method, dtype, probes in (
        ("unfold, gathered kernels", "gather", torch.float32, 64),
        ("unfold, low rank, batched matmul", "matmul", torch.float32, 256),
        ("unfold, low rank, FFT", "fft", torch.float32, bench.velocity.shape[1]),
        ("unfold, FFT, float64", "fft", torch.float64, 256),
    ):
        part = bench.velocity[:, :probes].to(dtype)
        seconds, found = bench.best(functools.partial(reflection, part, method), 1)
        error = float((found[: len(few)] - exact).abs().max())
        bench.row(f"{name}, {part.shape[1]} probes", seconds, part.numel(), error)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true", help="27 400 probes; a file of 16 GB")
    parser.add_argument("--seconds", type=float, default=20.0, help="limit for slow rows")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--cpu", action="store_true",
                        help="CPU time, not wall time: for a shared machine")  # fmt: skip
    parser.add_argument("--only", default=",".join(PARTS), help="parts, by comma")
    parser.add_argument("--folder", type=Path, help="for large files; default a temporary one")
    options = parser.parse_args()
    parts = options.only.split(",")
    if set(parts) - set(PARTS):
        parser.error(f"--only takes {', '.join(PARTS)}")
    warnings.simplefilter("ignore", tl.DataWarning)
    import benchmark_duct
    import benchmark_files
    import benchmark_ldv
    import benchmark_recipes
    import benchmark_worth

    if {"engines", "loops", "worth"} & set(parts):
        bench = Bench(27400 if options.full else 1712, options.seconds, options.device,
                      options.cpu)  # fmt: skip
        name = torch.cuda.get_device_name() if bench.device.type == "cuda" else platform.machine()
        print(f"{name}, {torch.get_num_threads()} threads, torch {torch.__version__}; "
              f"{bench.velocity.shape[1]} probes x {SAMPLES} samples, float32, liner polito, "
              f"{FREQUENCY:g} Hz")  # fmt: skip
        for part, of_plane in (("engines", engines), ("loops", benchmark_recipes.loops)):
            if part in parts:
                of_plane(bench)
        if "worth" in parts:
            benchmark_worth.worth(bench.plane, bench.liner, bench.clock)
        coherent.cache_clear()
        del bench
    sizes = [0.25, 1.0, 4.0, 16.0] if options.full else [0.25, 1.0, 4.0]
    others: dict[str, Callable[[], Any]] = {
        "stations": benchmark_ldv.stations,
        "duct": lambda: benchmark_duct.main([]),
        "files": lambda: benchmark_files.cold_read(options.folder),
        "memory": lambda: benchmark_files.peak_memory(options.folder, sizes),
        "start": benchmark_files.start_up,
    }
    for part, work in others.items():
        if part in parts:
            work()


if __name__ == "__main__":
    main()
