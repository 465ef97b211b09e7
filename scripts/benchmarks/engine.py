"""A plane in memory to its map."""

import functools
import os
import platform
from typing import Any
from unittest import mock

import torch
from torch import Tensor

import torchliner as tl
from benchmarks.harness import best, row
from torchliner.engine import native
from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive
from torchliner.engine.nodes import choose_nodes
from torchliner.engine.sums import Held, Job, reduce
from torchliner.liners.model import reflection_of

RATE, TONE, SAMPLES, CELL = 200e3, 1400.0, 2280, 25
PROBES, ALL_PROBES = 1712, 27_400  # the paper's plane is 548 x 50
MANY = [400.0 + 90 * i for i in range(60)]  # Hz
LONG = 400_000  # samples of one probe
COMPARED = 64  # probes of the plain mean


def plane_of(velocity: Tensor) -> tl.VelocityPlane:
    """Of (n, P), in cells of 25 probes."""
    x = (torch.arange(velocity.shape[1]) + 0.5) * float(tl.load_liner("polito").cell_pitch or 1e-2) / CELL
    return tl.VelocityPlane(velocity.T, sampling_rate=RATE, frequency=TONE, x=x)


def noise(options: Any) -> Tensor:
    """m/s, (n, P), float32, on the device."""
    probes = ALL_PROBES if options.full else PROBES
    return 2 * torch.randn(SAMPLES, probes, generator=torch.Generator().manual_seed(0)).to(options.device)


def held(v: Tensor) -> Held:
    """A record (n, P) in memory."""
    return Held(lambda begin, end: v[begin:end], v.shape[0], v.shape[1], v.device)


def plain_means(v: Tensor, frequency: list[float]) -> Tensor:
    """Means of R(f, |v|) over the whole periods of a record, (n, P): complex128, (P, F)."""
    asked, end = torch.tensor(frequency, dtype=torch.float64), Blocks.of(len(v), RATE, TONE).borders[-1]
    liner = tl.load_liner("polito")
    return torch.stack([reflection_of(liner, asked[:, None], each[:end].double().abs()).mean(1) for each in v.T.cpu()])


def engine(options: Any) -> None:
    """The floor, the sums and ``educe``; the largest error in R is that against a plain mean in float64."""
    v = noise(options)
    device = torch.cuda.get_device_name() if options.device.type == "cuda" else platform.machine()
    print(f"{device}, {torch.get_num_threads()} threads, torch {torch.__version__}: {v.shape[1]} x {SAMPLES} samples")
    row("one sum over the plane, the floor", best(v.sum)[0], samples=v.numel())
    fast = {"compiled": "native"} if options.device.type == "cpu" else {"Triton": ""}
    if "compiled" in fast and not native.available():
        print(f"no compiled sums: {native.reason}")
        fast = {}
    for name, way in (fast | {"torch": "torch"}).items():
        with mock.patch.dict(os.environ, TORCHLINER_SUMS=way):
            of_one_way(v, name)


def of_one_way(v: Tensor, name: str) -> None:
    """Rows of the engine with compiled sums, or in torch alone."""
    liner, plane, part = tl.load_liner("polito"), plane_of(v), v[:, :COMPARED]
    long = v.T.flatten().repeat(1 + LONG // v.numel())[:LONG, None]
    one_probe = tl.VelocityPlane(long.T, sampling_rate=RATE, frequency=TONE)
    nodes = choose_nodes([liner], torch.tensor([TONE], dtype=torch.float64), 1e-6)
    for values, words in ((v, ""), (long, f", one probe of {LONG:.0e} samples")):
        job = Job(Drive(), nodes.sums)
        work = functools.partial(reduce, held(values), Blocks.of(len(values), RATE, TONE), [job])
        row(f"moments, {nodes.count} nodes{words}, {name}", best(work)[0], samples=values.numel())

    def educe(words: str, values: Tensor, of: tl.VelocityPlane, wanted: Tensor, compared: str, **choices: Any) -> None:
        seconds, found = best(functools.partial(tl.educe, of, liner, **choices))
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
