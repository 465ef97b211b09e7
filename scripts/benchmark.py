"""Time and error of reduction, eduction and whole files, on one synthetic plane.

    python scripts/benchmark.py [--full] [--device cuda] [--only engines,worth,...]

The quick plane has 1712 probes x 2280 samples (200 kHz, 11.4 ms, float32); --full takes the
paper's, 548 x 50 probes. Times are ns per velocity sample and in sums over the plane, the best of
three runs after one that is not counted; engines that need longer than --seconds get fewer probes.
Each row's error is the largest in R against a plain mean of R(f, |v|) in float64 (the reflected
signal: against a plain loop with the same kernels). Parts: engines, loops (the published recipe),
worth (error bars, audit, calibration), stations (laser Doppler), duct (linearised Euler equations,
microphones), files, memory, start.
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
from torchliner.engine import native
from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import as_measured
from torchliner.engine.nodes import choose_nodes, response
from torchliner.engine.replay import replay
from torchliner.engine.sums import Held, Job, ones, reduce
from torchliner.liners.model import LinerModel

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
    """Means of R(f, |v|) over samples 0 to ``end`` - 1, complex128, (P, F); ``speed`` (P, n)."""
    asked = torch.tensor(frequency, dtype=torch.float64)
    return torch.stack([response(liner, asked, each[:end].double().abs()).mean(1) for each in speed])


def engines(bench: Bench) -> None:
    """The floor, the sums, ``educe``, and the reflected signal."""
    print(f"{'':50s} {'ns/sample':>10s} {'of floor':>9s} {'error':>9s}  wanted")
    count = bench.velocity.numel()
    bench.row("one sum over the plane, the floor", bench.floor * count, count)
    ways = [("compiled", "native"), ("torch alone", "torch")]
    if bench.device.type == "cuda":
        copied = torch.empty_like(bench.velocity)
        seconds, _ = bench.best(lambda: copied.copy_(bench.velocity))
        bench.row(f"copy of the plane ({8e-9 * count / seconds:.0f} GB/s)", seconds, count)
        ways = [("Triton", ""), ("torch alone", "torch")]
    elif not native.available():
        print(f"no compiled sums: {native.reason}")
        ways = ways[1:]
    for name, way in ways:
        with mock.patch.dict(os.environ, TORCHLINER_SUMS=way):
            sums_row(bench, name)
            educe_rows(bench, name)
    reflected_rows(bench)


def held(v: Tensor) -> Held:
    """A record (n, P) in memory."""
    return Held(lambda begin, end: v[begin:end], v.shape[0], v.shape[1], v.device)


def sums_row(bench: Bench, name: str) -> None:
    """Moments alone, over 16 blocks."""
    nodes = choose_nodes([bench.liner], torch.tensor([FREQUENCY], dtype=torch.float64), 1e-6)
    job = Job(as_measured, ones(bench.device), nodes.sums)
    for velocity, words in ((bench.velocity, ""), (bench.long.T, f", one probe, {LONG:.0e} samples")):
        record = held(velocity)
        blocks = Blocks.of(len(velocity), RATE, FREQUENCY)
        seconds, _ = bench.best(functools.partial(reduce, record, blocks, [job]))
        bench.row(f"moments, {nodes.count} nodes, {blocks.count} blocks{words}, {name}", seconds, velocity.numel())


def educe_rows(bench: Bench, name: str) -> None:
    """Plane in memory to map: survey, cells, level check, averagings, error bars."""
    count, plane = bench.velocity.numel(), bench.plane
    end = Blocks.of(SAMPLES, RATE, FREQUENCY).borders[-1]
    part = bench.velocity[:, :COMPARED].T.cpu()

    def educe(averaging: str, interval: float | None, **choices: Any) -> Any:
        work = functools.partial(tl.educe, plane, bench.liner, averaging=averaging, interval=interval, **choices)
        return bench.best(work)

    exact = plain_means(bench.liner, part, [FREQUENCY], end)
    double = tl.educe(plane, bench.liner, dtype="float64", interval=None).probes["phase-locked"].reflection[:COMPARED]
    for averaging, words in (("admittance", "one reading"), ("phase-locked", "phase-locked")):
        for level, bars in ((None, "no error bars"), (0.95, "error bars")):
            seconds, found = educe(averaging, level)
            wanted = exact if averaging == "admittance" else double.cpu()
            error = float((found.probes[averaging].reflection[:COMPARED].cpu() - wanted).abs().max())
            each = bench.row(f"educe, {words}, {bars}, {name}", seconds, count, error)
    print(f"{'':6s}(a stream at {1e-3 * RATE:g} kHz: one machine keeps up with {1e9 / RATE / each:.0f} probes)")
    exact = plain_means(bench.liner, part, MANY, end)
    for level, bars in ((None, "no error bars"), (0.95, "error bars")):
        seconds, found = educe("phase-locked", level, frequency=MANY)
        error = float((found.probes["admittance"].reflection[:COMPARED].cpu() - exact).abs().max())
        bench.row(f"educe, 60 frequencies, {bars}, {name}", seconds, count, error)
    long = tl.VelocityPlane(bench.long, sampling_rate=RATE, frequency=FREQUENCY)
    seconds, found = bench.best(lambda: tl.educe(long, bench.liner, averaging="admittance"))
    exact = plain_means(bench.liner, long.velocity.cpu(), [FREQUENCY], Blocks.of(LONG, RATE, FREQUENCY).borders[-1])
    error = float((found.probes["admittance"].reflection.cpu() - exact).abs().max())
    bench.row(f"educe, one probe, {LONG:.0e} samples, {name}", seconds, LONG, error)


def reflected_rows(bench: Bench) -> None:
    """The whole reflected signal of a real tone on the default kernels, against a plain loop."""
    kernels = tl.build_kernels(bench.liner, RATE, velocity_max=16.0)
    tone = tl.Tones(FREQUENCY)
    wave = tone.sampled(SAMPLES, RATE)
    few = bench.velocity[:, :2].double().cpu()
    seconds, exact = bench.best(lambda: plain_replay(few, kernels, wave), 1)
    bench.row(f"plain loop, float64, {few.shape[1]} probes", seconds, few.numel(), 0.0)
    for dtype, probes in ((torch.float32, 64), (torch.float32, 512), (torch.float64, 64)):
        v = bench.velocity[:, :probes].to(dtype)
        record = held(v)

        def work(record: Held = record) -> Tensor:
            signal = replay(record, kernels, tone, as_measured, edge="silent")
            return torch.cat(list(signal.slabs([(0, SAMPLES)])))

        seconds, found = bench.best(work, 1)
        error = float((found[:, :2].cpu() - exact).abs().max())
        bench.row(f"replay, {str(dtype).removeprefix('torch.')}, {v.shape[1]} probes", seconds, v.numel(), error)


def plain_replay(v: Tensor, kernels: Any, wave: Tensor) -> Tensor:
    """Eq. (3.2) as a sum over emission times, (n, P)."""
    samples, length = len(v), kernels.taps.shape[1]
    index, shares = kernels.grid.locate(v.abs())
    found = torch.zeros(samples + length, v.shape[1], dtype=torch.float64)
    for k in range(samples):
        taps = sum(share[k, :, None] * kernels.taps[index[k] + i] for i, share in enumerate(shares))
        low = k + kernels.first
        inside = slice(max(0, -low), length)
        found[low + inside.start : low + length] += wave[k] * taps.T[inside]
    return found[:samples]


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
