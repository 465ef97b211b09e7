"""Time and error of the engines, and of whole files, on one synthetic plane.

    python scripts/benchmark.py [--full] [--device cuda] [--only engines,worth,...]

The quick plane has 1712 probes x 2280 samples (200 kHz, 11.4 ms, float32); --full takes the
paper's, 548 x 50 probes. Times are ns per velocity sample, the best of three runs after one that is
not counted; engines that need longer than --seconds get fewer probes. Each row's error is the
largest in R against float64 `direct` (for wrapped records: the formula in float64) on the same
kernels. Rows marked * are compiled, without the compiler's own time, which the line below them
states. Parts: engines, slopes, worth (error bars, audit), stations (laser Doppler),
duct (linearised Euler equations, microphones), files, memory, start.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import importlib.util
import platform
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torchliner.replay.lines import plan_lines
from torchliner.replay.spectral import spectral_sums

import torchliner as tl
from torchliner.reduction.sources import HeldSpeed
from torchliner.replay.direct import replay_direct
from torchliner.replay.edges import Record
from torchliner.replay.emissions import Sent
from torchliner.replay.kernels import build_kernels
from torchliner.replay.levels import VelocityGrid
from torchliner.replay.sinks import CrossSpectra
from torchliner.replay.unfold import replay_unfold
from torchliner.signals.windows import make_window
from torchliner.tdibc.educe import educe

RATE, FREQUENCY, SAMPLES = 200e3, 1400.0, 2280
PARTS = ("engines", "slopes", "worth", "stations", "duct", "files", "memory", "start")


class Bench:
    """The plane, the floor and how rows are printed."""

    def __init__(self, probes: int, seconds: float, device: str) -> None:
        generator = torch.Generator().manual_seed(0)
        velocity = 2 * torch.randn(SAMPLES, probes, generator=generator)
        self.velocity = velocity.clamp(-15.9, 15.9).to(device)
        self.seconds, self.device = seconds, torch.device(device)
        self.liner = tl.load_liner("polito")
        self.grid = VelocityGrid(16.0)
        self.kernels = build_kernels(self.liner, self.grid, RATE)
        self.floor = self.best(self.velocity.sum)[0] / self.velocity.numel()

    def best(self, work: Callable[[], Any], repeats: int = 3) -> tuple[float, Any]:
        """Seconds of the fastest of some runs, after one that is not counted."""
        result, fastest = None, float("inf")
        for number in range(repeats + 1):
            start = time.perf_counter()
            result = work()
            if self.device.type == "cuda":
                torch.cuda.synchronize()
            spent = time.perf_counter() - start
            fastest = min(fastest, spent) if number else fastest
            if spent > self.seconds:
                return min(fastest, spent), result
        return fastest, result

    def row(self, name: str, seconds: float, samples: int, error: float | None) -> None:
        each = seconds / samples
        shown = "" if error is None else f"{error:.1e}"
        print(f"{name:52s} {1e9 * each:11.2f} {each / self.floor:10.1f} {shown:>10s}", flush=True)

    def fitting(self, seconds_per_probe: float) -> int:
        """As many probes as the time allows."""
        return max(1, min(self.velocity.shape[1], int(self.seconds / seconds_per_probe)))


def engines(bench: Bench) -> None:
    """Rows (a) to (g)."""
    print(f"{'':52s} {'ns/sample':>11s} {'of floor':>10s} {'error in R':>10s}")
    count = bench.velocity.numel()
    bench.row("(g) plane.sum(), the floor", bench.floor * count, count, None)
    if bench.device.type == "cuda":
        copied = torch.empty_like(bench.velocity)
        seconds, _ = bench.best(lambda: copied.copy_(bench.velocity))
        rate = 2 * 4e-9 * count / seconds
        bench.row(f"    copy of the plane ({rate:.0f} GB/s)", seconds, count, None)
    spectral_rows(bench)
    unfold_rows(bench)
    loops(bench)
    plane = tl.VelocityPlane(bench.velocity.T, sampling_rate=RATE, frequency=FREQUENCY)
    short = functools.partial(educe, liner=bench.liner, interval=None)
    seconds, found = bench.best(lambda: short(plane, order="probes first"))
    part = tl.VelocityPlane(
        bench.velocity[:, :3].T.double(), sampling_rate=RATE, frequency=FREQUENCY
    )
    top = float(found.choices["velocity_max"])
    wanted = educe(part, bench.liner, engine="direct", velocity_max=top)
    error = float((found.reflection[:3] - wanted.reflection).abs().max())
    bench.row("educe, probes and velocity first, eager", seconds, count, error)
    seconds, _ = bench.best(lambda: short(plane))
    single = dataclasses.replace(part, velocity=part.velocity.float())
    found = short(single, velocity_max=top).reflection_coherent_first
    wanted = short(part, velocity_max=top, engine="direct").reflection_coherent_first
    error = float((found - wanted).abs().max())
    bench.row("educe, coherent first too, eager", seconds, count, error)


def spectral_rows(bench: Bench) -> None:
    """(e) formula and (f) table, over one wrapped record; and with the ends of a finite one."""
    count = bench.velocity.numel()
    for name, window, edge, of_kernel in (
        ("(e) spectral, formula, rectangular", "boxcar", "wrap", False),
        ("(e) spectral, formula, Hann", "hann", "wrap", False),
        ("(f) spectral, table", "hann", "wrap", True),
        ("    spectral, formula and ends, Hann", "hann", "finite", False),
    ):
        record = Record(SAMPLES, 0, make_window(window, SAMPLES), edge, RATE)
        lines = plan_lines(
            bench.liner, [FREQUENCY], record, bench.grid, bench.kernels,
            of_kernel=of_kernel, backward=False,
        )  # fmt: skip
        run = functools.partial(spectral_sums, lines=lines, grid=bench.grid)
        exact = run(HeldSpeed(bench.velocity[:, :64].T.double())).forward
        for compiled in ("never", "always"):
            start = time.perf_counter()
            run(HeldSpeed(bench.velocity.T), compile_loops=compiled)
            first = time.perf_counter() - start
            again = functools.partial(run, HeldSpeed(bench.velocity.T), compile_loops=compiled)
            seconds, sums = bench.best(again)
            error = (sums.forward[:64] - exact).abs().max() / record.window.weights.sum()
            star = " *" if compiled == "always" else ", eager"
            bench.row(name + star, seconds, count, float(error))
            if compiled == "always":
                print(f"{'':6s}(compiling it: {first - seconds:.1f} s)")


def unfold_rows(bench: Bench) -> None:
    """(d) by method, and (c): one real tone on the default kernels, literal edges."""
    record = Record(SAMPLES, 0, make_window("hann", SAMPLES), "silent", RATE)
    steps = torch.arange(SAMPLES, dtype=torch.float64)
    emission = Sent(torch.cos(2 * torch.pi * FREQUENCY / RATE * steps), False)
    at = torch.tensor([FREQUENCY], dtype=torch.float64)
    weights = record.window.weights

    def reflection(velocity: Tensor, method: str) -> Tensor:
        source = HeldSpeed(velocity.T)
        sink = CrossSpectra(
            emission.signal, weights, [0], at, RATE, sum(source.widths), source.device
        )
        replay_unfold(source, bench.kernels, emission, record, [sink], method=method)
        return sink.reflection()

    few = bench.velocity[:, :2].double().abs().T
    start = time.perf_counter()
    signal = replay_direct(few, bench.kernels, emission, record)
    seconds = time.perf_counter() - start
    probes = min(bench.fitting(seconds / 2 / 20), 128)  # direct batches its probes
    many = bench.velocity[:, :probes].double().abs().T
    start = time.perf_counter()
    replay_direct(many, bench.kernels, emission, record)
    seconds = time.perf_counter() - start
    bench.row(f"(c) direct, float64, {probes} probes", seconds, many.numel(), 0.0)
    sink = CrossSpectra(emission.signal, weights, [0], at, RATE, 2, bench.device)
    sink.add(signal, slice(0, 2), 0)
    exact = sink.reflection()
    for name, method, dtype, probes in (
        ("(d) unfold, gathered kernels, batched matmul", "gather", torch.float32, 64),
        ("(d) unfold, low rank, batched matmul", "matmul", torch.float32, 256),
        ("(d) unfold, low rank, FFT", "fft", torch.float32, bench.velocity.shape[1]),
        ("(d) unfold, FFT, float64, rank for 3e-11", "fft", torch.float64, 256),
    ):
        part = bench.velocity[:, :probes].to(dtype)
        seconds, found = bench.best(functools.partial(reflection, part, method))
        error = float((found[:2] - exact).abs().max())
        bench.row(f"{name}, {part.shape[1]} probes", seconds, part.numel(), error)


def loops(bench: Bench) -> None:
    """(a) and (b): the published recipe on its own kernels (causal, uniform levels, linear)."""
    from benchmark_recipes import numba_recipe, numpy_recipe

    grid = VelocityGrid(16.0, spacing="uniform", interpolation="linear")
    kernels = build_kernels(bench.liner, grid, RATE, kind="causal")
    steps = torch.arange(SAMPLES, dtype=torch.float64)
    wave = torch.cos(2 * torch.pi * FREQUENCY / RATE * steps)
    record = Record(SAMPLES, 0, make_window("hann", SAMPLES), "silent", RATE)
    turning = torch.exp(-2j * torch.pi * FREQUENCY / RATE * steps)
    analysis = record.window.weights * turning
    sent = complex((analysis * wave).sum())
    speed = bench.velocity.cpu().double().abs().T.contiguous()
    exact = (
        replay_direct(speed[:2], kernels, Sent(wave, False), record)[0].to(torch.complex128)
        @ analysis
    )

    def run(recipe: Any, probes: int, taps: Tensor) -> tuple[float, float]:
        arguments = speed[:probes].numpy(), taps.numpy(), 16.0, wave.numpy(), analysis.numpy()
        start = time.perf_counter()
        lines = recipe(*arguments)
        seconds = time.perf_counter() - start
        found = torch.from_numpy(lines[:2])
        return seconds, float((found - exact[: len(found)]).abs().max() / abs(sent))

    probes = bench.fitting(run(numpy_recipe, 1, kernels.taps)[0])
    seconds, error = run(numpy_recipe, probes, kernels.taps)
    bench.row(f"(a) NumPy loop, float64, {probes} probes", seconds, probes * SAMPLES, error)
    if importlib.util.find_spec("numba") is None:
        print("(b) not measured: numba is missing (pip install -e .[benchmark])")
        return
    for name, fast, taps in (
        ("(b) numba, the same, float64", False, kernels.taps),
        ("(b) numba, fastmath, float32", True, kernels.taps.float()),
    ):
        recipe = numba_recipe(fast=fast)
        run(recipe, 2, taps)
        probes = bench.fitting(run(recipe, 64, taps)[0] / 64)
        seconds, error = run(recipe, probes, taps)
        bench.row(f"{name}, {probes} probes", seconds, probes * SAMPLES, error)


def slopes(bench: Bench) -> None:
    """Cost against the number of frequencies and the length of the record."""
    width = min(bench.velocity.shape[1], 1712)
    print("ns per sample against the number of frequencies, and of the record's length:")
    for window in ("boxcar", "hann"):
        record = Record(SAMPLES, 0, make_window(window, SAMPLES), "wrap", RATE)
        shown = []
        for count in (1, 2, 4, 8, 16, 60):
            wanted = [300 + 90.0 * i for i in range(count)]
            lines = plan_lines(bench.liner, wanted, record, bench.grid, backward=False)
            held = HeldSpeed(bench.velocity[:, :width].T)
            run = functools.partial(spectral_sums, held, lines, bench.grid, compile_loops="never")
            shown.append(f"{count}: {1e9 * bench.best(run)[0] / held.speed.numel():.1f}")
        print(f"  spectral, eager, {window}, frequencies  " + "  ".join(shown), flush=True)
    for engine in ("spectral", "unfold"):
        shown = []
        for times in (1, 2, 4, 8):
            velocity = bench.velocity[:, : width // 4].repeat(times, 1)
            plane = tl.VelocityPlane(velocity.T, sampling_rate=RATE, frequency=FREQUENCY)
            seconds, _ = bench.best(functools.partial(educe, plane, bench.liner, engine=engine), 2)
            shown.append(f"{times * SAMPLES}: {1e9 * seconds / velocity.numel():.0f}")
        print(f"  educe, {engine}, samples  " + "  ".join(shown), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--full", action="store_true", help="the paper's 27 400 probes")
    parser.add_argument("--seconds", type=float, default=20.0, help="limit for slow rows")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--only", default=",".join(PARTS), help="parts, by comma")
    parser.add_argument("--folder", type=Path, default=Path("."), help="for large files")
    parser.add_argument("--gigabytes", default="1", help="plane sizes of the part memory: 1,4,16")
    options = parser.parse_args()
    parts = options.only.split(",")
    if set(parts) - set(PARTS):
        parser.error(f"--only takes {', '.join(PARTS)}")
    warnings.simplefilter("ignore", tl.DataWarning)
    if {"engines", "slopes", "worth"} & set(parts):
        bench = Bench(27400 if options.full else 1712, options.seconds, options.device)
        name = torch.cuda.get_device_name() if bench.device.type == "cuda" else platform.machine()
        print(f"{name}, {torch.get_num_threads()} threads, torch {torch.__version__}; "
              f"{bench.velocity.shape[1]} probes x {SAMPLES} samples, float32, liner polito, "
              f"{FREQUENCY:g} Hz")  # fmt: skip
        if "engines" in parts:
            engines(bench)
        if "slopes" in parts:
            slopes(bench)
        if "worth" in parts:
            import benchmark_worth

            benchmark_worth.worth(bench.velocity.T, RATE, FREQUENCY, bench.liner)
        del bench
    if "stations" in parts:
        import benchmark_ldv

        benchmark_ldv.stations()
    if "duct" in parts:
        import benchmark_duct

        benchmark_duct.main([])
    import benchmark_files

    if "files" in parts:
        benchmark_files.cold_read(options.folder)
    if "memory" in parts:
        benchmark_files.peak_memory(
            options.folder, [float(g) for g in options.gigabytes.split(",")]
        )
    if "start" in parts:
        benchmark_files.start_up()


if __name__ == "__main__":
    main()
