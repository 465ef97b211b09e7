"""A plane in memory to its map, the reflected signal, the published loop, and a plane that streams by."""

from __future__ import annotations

import functools
import importlib.util
import os
import platform
from collections.abc import Callable, Iterator
from typing import Any
from unittest import mock

import torch
from torch import Tensor

import torchliner as tl
from benchmarks.harness import Bench, row
from torchliner.engine import native
from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive
from torchliner.engine.nodes import choose_nodes, response
from torchliner.engine.replay import Replay
from torchliner.engine.sums import Held, Job, reduce

RATE, TONE, SAMPLES, CELL = 200e3, 1400.0, 2280, 25
PROBES, ALL_PROBES = 1712, 27_400  # the paper's plane is 548 x 50
MANY = [400.0 + 90 * i for i in range(60)]  # Hz
LONG = 400_000  # samples of one probe
COMPARED = 64  # probes of the plain mean
TOP = 16.0  # m/s, of kernels


def plane_of(velocity: Tensor) -> tl.VelocityPlane:
    """Of (n, P), in cells of 25 probes."""
    x = (torch.arange(velocity.shape[1]) + 0.5) * float(tl.load_liner("polito").cell_pitch or 1e-2) / CELL
    return tl.VelocityPlane(velocity.T, sampling_rate=RATE, frequency=TONE, x=x)


def noise(bench: Bench) -> Tensor:
    """m/s, (n, P), float32, on the device."""
    probes = ALL_PROBES if bench.full else PROBES
    v = 2 * torch.randn(SAMPLES, probes, generator=torch.Generator().manual_seed(0))
    return v.clamp(-0.99 * TOP, 0.99 * TOP).to(bench.device)


def held(v: Tensor) -> Held:
    """A record (n, P) in memory."""
    return Held(lambda begin, end: v[begin:end], v.shape[0], v.shape[1], v.device)


def plain_means(v: Tensor, frequency: list[float]) -> Tensor:
    """Means of R(f, |v|) over the whole periods of a record, (n, P): complex128, (P, F)."""
    asked, end = torch.tensor(frequency, dtype=torch.float64), Blocks.of(len(v), RATE, TONE).borders[-1]
    liner = tl.load_liner("polito")
    return torch.stack([response(liner, asked, each[:end].double().abs()).mean(1) for each in v.T.cpu()])


def engine(bench: Bench) -> None:
    """The floor, the sums and ``educe``; the largest error in R is that against a plain mean in float64."""
    v = noise(bench)
    device = torch.cuda.get_device_name() if bench.device.type == "cuda" else platform.machine()
    print(f"{device}, {torch.get_num_threads()} threads, torch {torch.__version__}: {v.shape[1]} x {SAMPLES} samples")
    row("one sum over the plane, the floor", bench.best(v.sum)[0], samples=v.numel())
    ways = {"compiled": "native", "torch": "torch"} if bench.device.type == "cpu" else {"Triton": "", "torch": "torch"}
    if bench.device.type == "cpu" and not native.available():
        print(f"no compiled sums: {native.reason}")
        del ways["compiled"]
    for name, way in ways.items():
        with mock.patch.dict(os.environ, TORCHLINER_SUMS=way):
            of_one_way(bench, v, name)


def of_one_way(bench: Bench, v: Tensor, name: str) -> None:
    """Rows of the engine with compiled sums, or in torch alone."""
    liner, plane, part = tl.load_liner("polito"), plane_of(v), v[:, :COMPARED]
    long = v.T.flatten().repeat(1 + LONG // v.numel())[:LONG, None]
    one_probe = tl.VelocityPlane(long.T, sampling_rate=RATE, frequency=TONE)
    nodes = choose_nodes([liner], torch.tensor([TONE], dtype=torch.float64), 1e-6)
    for values, words in ((v, ""), (long, f", one probe of {LONG:.0e} samples")):
        job = Job(Drive(), nodes.sums)
        work = functools.partial(reduce, held(values), Blocks.of(len(values), RATE, TONE), [job])
        row(f"moments, {nodes.count} nodes{words}, {name}", bench.best(work)[0], samples=values.numel())

    def educe(words: str, values: Tensor, of: tl.VelocityPlane, wanted: Tensor, compared: str, **choices: Any) -> None:
        seconds, found = bench.best(functools.partial(tl.educe, of, liner, **choices))
        error = float((found.probes[compared].reflection[:COMPARED].cpu() - wanted).abs().max())
        row(f"educe, {words}, {name}", seconds, error=error, samples=values.numel())

    exact = plain_means(part, [TONE])
    double = tl.educe(plane, liner, dtype="float64", interval=None).probes["phase-locked"].reflection[:COMPARED].cpu()
    for bars, level in (("no error bars", None), ("error bars", 0.95)):
        educe(f"one reading, {bars}", v, plane, exact, "admittance", averaging="admittance", interval=level)
        educe(f"the default, {bars}", v, plane, double, "phase-locked", interval=level)
        many = plain_means(part, MANY)
        educe(f"60 frequencies, {bars}", v, plane, many, "admittance", frequency=MANY, interval=level)
    educe("one probe", long, one_probe, plain_means(long, [TONE]), "admittance", averaging="admittance")


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


def signals(bench: Bench) -> None:
    """The whole reflected signal of a tone, against a plain loop with the same kernels and the recipe in numba."""
    v, tone = noise(bench), tl.Tones(TONE)
    kernels = tl.build_kernels(tl.load_liner("polito"), RATE, velocity_max=TOP)
    wave = tone.sampled(SAMPLES, RATE)
    few = v[:, :2].double().cpu()
    seconds, exact = bench.best(lambda: plain_replay(few, kernels, wave), 1)
    row("plain loop in torch, float64, 2 probes", seconds, samples=few.numel())
    for dtype, probes in ((torch.float32, 64), (torch.float32, 512), (torch.float64, 64)):
        some = v[:, :probes].to(dtype)

        def work(some: Tensor = some) -> Tensor:
            signal = Replay(held(some), kernels, tone, Drive(), edge="silent")
            return torch.cat(list(signal.slabs([(0, SAMPLES)])))

        seconds, found = bench.best(work, 1)
        error = float((found[:, :2].cpu() - exact).abs().max())
        row(f"replay, {str(dtype).removeprefix('torch.')}, {probes} probes", seconds, error=error, samples=some.numel())
    if importlib.util.find_spec("numba") is None:
        print("the published loop is not measured: numba is missing (pip install -e .[benchmark])")
        return
    causal: dict[str, Any] = {"kind": "causal", "spacing": "uniform", "interpolation": "linear"}
    taps = tl.build_kernels(tl.load_liner("polito"), RATE, velocity_max=TOP, **causal).taps.numpy()
    speed, recipe = v[:, :64].cpu().double().abs().T.contiguous().numpy(), published_loop()
    seconds, _ = bench.best(lambda: recipe(speed, taps, TOP, wave.numpy()), 1)
    row("the published loop in numba, all cores, 64 probes", seconds, samples=speed.size)


def published_loop() -> Callable[..., Any]:
    """Eq. (3.2) as others would write it: |v| (P, n), taps (V, K) on uniform levels, linear interpolation."""
    import numba
    import numpy as np

    @numba.njit(parallel=True)  # type: ignore[untyped-decorator]
    def loop(speed: Any, taps: Any, top: float, wave: Any) -> Any:
        (probes, samples), (levels, length) = speed.shape, taps.shape
        found = np.zeros((probes, samples + length))
        for p in numba.prange(probes):
            for k in range(samples):
                place = speed[p, k] / top * (levels - 1)
                i = min(int(place), levels - 2)
                for m in range(length):
                    kernel = (1 - (place - i)) * taps[i, m] + (place - i) * taps[i + 1, m]
                    found[p, k + m] += wave[k] * kernel
        return found

    return loop


def pieces(v: Tensor) -> Iterator[Tensor]:
    """Four periods at a time, (P, t), for ever."""
    length = round(4 * RATE / TONE)
    while True:
        yield v[:length].T


def stream(bench: Bench) -> None:
    """Pieces of four periods as they come: how many probes one machine keeps up with, and how soon a map is there."""
    v, liner = noise(bench).cpu(), tl.load_liner("onera")
    length, source = round(4 * RATE / TONE), pieces(v)
    for bars, level in (("error bars", 0.95), ("no error bars", None)):
        first = tl.VelocityPlane(next(source), sampling_rate=RATE, frequency=TONE, x=plane_of(v).x, name="stream")
        growing = tl.GrowingMoments(first, liner, interval=level)
        seconds, _ = bench.best(lambda growing=growing: growing.update(next(source)))  # type: ignore[misc]
        map_seconds, _ = bench.best(lambda growing=growing, level=level: growing.educe(liner, interval=level))  # type: ignore[misc]
        keeps_up = f"keeps up with {v.shape[1] * length / RATE / seconds:.0f} probes at 200 kHz"
        row(f"stream, a piece of {length} samples", seconds, keeps_up, samples=v.shape[1] * length)
        row(f"stream, its map, {bars}", map_seconds)
