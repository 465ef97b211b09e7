"""Kernels, levels of |v|, and the whole reflected signal against the literal sum (3.2)."""

import dataclasses
import math
from itertools import pairwise

import pytest
import scipy.signal
import torch
from conftest import RATE, turbulence
from hypothesis import given
from hypothesis import strategies as st
from one_device import OneDevice

import torchliner as tl
from torchliner.engine import replay as engine
from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive
from torchliner.engine.kernels import VelocityGrid, build_kernels, interpolate
from torchliner.engine.replay import Replay, cross_spectra
from torchliner.engine.sums import Held, Job, linear, reduce
from torchliner.liners.model import reflection_of
from torchliner.records.incident import BandNoise, ComplexTones, Recorded, Sweep, Tones

GRIDS = {"ours": ("sqrt", "cubic"), "paper": ("uniform", "linear")}
SHORT = {"before": 5e-4, "after": 1.5e-3, "levels": 12, "regularisation": 1e-2}  # 21 taps before zero, 63 after
F64 = torch.float64


def table(liner, kind="two-sided", grid="ours", **changed):
    spacing, interpolation = GRIDS[grid]
    return build_kernels(
        liner, RATE, velocity_max=16.0, kind=kind, spacing=spacing, interpolation=interpolation, **{**SHORT, **changed}
    )


@pytest.fixture(scope="module")
def kernels(liner):
    return table(liner)


def held(v):
    return Held(lambda begin, end: v[begin:end], *v.shape, v.device)


def whole(v, kernels, incident, **options):
    (y,) = Replay(held(v), kernels, incident, Drive(), **options).slabs([(0, len(v))])
    return y


def transfer(signal, incident, frequency, rate=RATE, **cut):
    """H1, (N, F)."""
    cross, power = cross_spectra(signal, incident, frequency, rate, **cut)
    return cross.sum(0) / power.sum(0)


def velocity(samples, columns, seed=0):
    return turbulence((columns, samples), seed=seed).T.clamp(-15.9, 15.9).contiguous()


def literal_kernel(kernels, speed):
    """h(m; |v|) of one |v|: Lagrange's formula over the nearest levels."""
    grid = kernels.grid
    place = speed / grid.maximum
    place = (math.sqrt(place) if grid.spacing == "sqrt" else place) * (grid.levels - 1)
    count = 4 if grid.interpolation == "cubic" else 2
    first = min(max(math.floor(place) - count // 2 + 1, 0), grid.levels - count)
    nodes = range(first, first + count)
    found = torch.zeros(kernels.taps.shape[1], dtype=F64)
    for i in nodes:
        found += kernels.taps[i] * math.prod((place - j) / (i - j) for j in nodes if j != i)
    return found.tolist()


def literal_sum(v, kernels, sent, periodic):
    """y(t) = sum over k of x(k) h(t - k; |v(k)|), term by term."""
    n, count = v.shape
    y = torch.zeros(n, count, dtype=F64)
    for column in range(count):
        own = [literal_kernel(kernels, abs(float(v[k, column]))) for k in range(n)]
        for t in range(n):
            for lag in range(kernels.taps.shape[1]):
                k = t - lag - kernels.first
                if periodic or 0 <= k < n:
                    y[t, column] += float(sent[k % n]) * own[k % n][lag]
    return y


SENT = {
    "tones": Tones([700.0, 1400.0], [1.0, 0.5], [0.3, -2.0]),
    "sweep": Sweep(500, 3000, "logarithmic"),
    "noise": BandNoise(500, 3000, 3),
    "recorded": Recorded(torch.linspace(-1, 1, 120, dtype=F64).sin().flip(0), RATE),
}


@pytest.mark.parametrize("kind", ["two-sided", "causal"])
@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("edge", ["silent", "periodic"])
def test_the_literal_sum(liner, kind, grid, edge):
    v, kernels = velocity(120, 2), table(liner, kind, grid)
    for name, incident in SENT.items():
        wanted = literal_sum(v, kernels, incident.sampled(120, RATE), edge == "periodic")
        assert float((whole(v, kernels, incident, edge=edge) - wanted).abs().max()) < 1e-12, name
        single = whole(v.float(), kernels, incident, edge=edge)
        assert single.dtype == torch.float32
        assert float((single - wanted).abs().max()) < 2e-5, name
    for samples in (1, 2, 30):  # shorter than the kernel: a periodic record repeats many times within it
        wanted = literal_sum(v[:samples], kernels, torch.ones(samples), edge == "periodic")
        found = whole(v[:samples], kernels, Recorded(torch.ones(samples, dtype=F64), RATE), edge=edge)
        assert float((found - wanted).abs().max()) < 1e-12


@pytest.mark.parametrize("edge", ["silent", "periodic"])
def test_bits_depend_neither_on_neighbours_nor_on_cuts(kernels, edge, monkeypatch):
    v, noise = velocity(700, 6), BandNoise(500, 3000)
    wanted = whole(v, kernels, noise, edge=edge)
    monkeypatch.setattr(engine, "ON_CPU", 2 * 64 * 149)
    assert torch.equal(whole(v, kernels, noise, edge=edge), wanted)
    alone = [whole(v[:, i : i + 1].contiguous(), kernels, noise, edge=edge) for i in range(6)]
    assert float((torch.cat(alone, 1) - wanted).abs().max()) < 1e-14
    signal = Replay(held(v), kernels, noise, Drive(), edge=edge)
    cuts = [0, 1, 64, 65, 300, 301, 650, 690, 700]
    assert torch.equal(torch.cat(list(signal.slabs(list(pairwise(cuts))))), wanted)
    for (begin, end), part in zip(gaps := [(5, 9), (200, 333), (699, 700)], signal.slabs(gaps), strict=True):
        assert torch.equal(part, wanted[begin:end])
    blocks, job = Blocks((0, 130, 400, 700), RATE, 3), [Job(Drive(), linear)]
    (total,) = reduce(signal, blocks, job)
    split = [reduce(signal, blocks, job, only)[0] for only in ([0], [1, 2])]
    assert torch.equal(torch.cat(split), total)
    monkeypatch.setattr(engine, "BATCH", 50)
    assert float((whole(v, kernels, noise, edge=edge) - wanted).abs().max()) < 1e-13


LINES = torch.tensor([500.0, 800.0, 1400.0, 3000.0], dtype=F64)  # whole periods in 840 samples, 20 ms


def test_the_mean_over_phases_and_passivity(liner):
    """R of a complex tone is the mean of H(f, |v|) over the record, exactly, so |R| <= gain."""
    kernels = build_kernels(liner, RATE, velocity_max=16.0)
    v, tones = velocity(840, 5), ComplexTones(LINES)
    signal = Replay(held(v), kernels, tones, Drive(), edge="periodic")
    found = transfer(signal, tones, LINES, window="boxcar")
    wanted = interpolate(kernels.response(LINES), *kernels.grid.locate(v.abs())).mean(0)
    assert float((found - wanted).abs().max()) < 1e-12
    assert float(found.abs().max()) <= kernels.gain


def test_segments_are_welchs(kernels):
    """scipy's csd over welch of the signal itself; the spectra of each segment add up to R."""
    v, noise, n = velocity(2000, 2), BandNoise(300, 3500, 1), 420
    y, x = whole(v, kernels, noise), noise.sampled(2000, RATE)
    options = {"fs": RATE, "nperseg": n, "noverlap": n // 2, "detrend": False}
    lines, cross = scipy.signal.csd(x.numpy(), y.T.numpy(), **options)
    power = scipy.signal.welch(x.numpy(), **options)[1]
    wanted, f = torch.from_numpy(cross / power)[:, 5:30], torch.from_numpy(lines[5:30])
    signal = Replay(held(v), kernels, noise, Drive())
    cross, power = cross_spectra(signal, noise, f, RATE, segment=n, window="hann")
    assert (cross.shape, power.shape) == ((8, 2, 25), (8, 1, 25))
    found = cross.sum(0) / power.sum(0)
    assert float((found - wanted).abs().max()) < 1e-11
    assert float((transfer(held(y), noise, f, segment=n, window="hann") - found).abs().max()) < 1e-13


def test_beyond_the_levels_only_that_column_is_nan(kernels):
    v = velocity(400, 3)
    v[200, 1], v[:, 2] = 16.1, 16.0
    y = whole(v, kernels, BandNoise(500, 3000))
    assert bool(y[:, [0, 2]].isfinite().all())
    assert bool(y[:, 1].isnan().any())


def test_gradients_pass_through_velocity_and_taps(kernels):
    """Backward and forward; at rest, where sqrt|v| has no derivative, the gradient is finite."""
    v, noise = velocity(12, 1), BandNoise(4000, 9000)

    def of(v, taps):
        signal = Replay(held(v), dataclasses.replace(kernels, taps=taps), noise, Drive())
        return torch.cat(list(signal.slabs([(0, 9), (9, 12)])))

    inputs = (v.requires_grad_(), kernels.taps[:, 19:23].clone().requires_grad_())
    assert torch.autograd.gradcheck(of, inputs, check_forward_ad=True)
    rest = torch.zeros(12, 1, dtype=F64, requires_grad=True)
    whole(rest, kernels, noise).square().sum().backward()
    assert bool(rest.grad.isfinite().all())


@pytest.mark.parametrize("edge", ["silent", "periodic"])
def test_all_work_stays_on_the_device_of_the_data(kernels, edge):
    v = torch.empty(300, 7, device="meta")
    with OneDevice():
        signal = Replay(held(v), kernels, BandNoise(500, 3000), Drive(), edge=edge)
        (y,) = signal.slabs([(10, 250)])
        found = transfer(signal, BandNoise(500, 3000), LINES[1:2] * 1.05, segment=100)
    assert (y.device.type, y.dtype, y.shape) == ("meta", torch.float32, (240, 7))
    assert (found.device.type, found.shape) == ("meta", (7, 1))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda k: build_kernels(None, RATE, velocity_max=9.0, band=(3500.0, 300.0)), "3500 Hz to 300 Hz.*upwards"),
        (lambda k: build_kernels(None, 500.0, velocity_max=9.0), "300 Hz.*500 Hz"),
        (lambda k: whole(velocity(100, 1), k, BandNoise(500, 600)), "500-600 Hz.*420 Hz.*widen"),
        (lambda k: whole(velocity(100, 1), k, SENT["recorded"]), "120 samples.*100.*pad"),
        (
            lambda k: transfer(held(velocity(420, 1)), BandNoise(500, 900), LINES[-1:]),
            "noise 500-900.*3000 Hz.*60 dB",
        ),
        (
            lambda k: transfer(held(velocity(420, 1)), Tones(500.0), LINES[:1], segment=421),
            "421 samples.*even.*420",
        ),
    ],
)
def test_what_is_wrong_is_named(kernels, call, words):
    with pytest.raises(ValueError, match=words):
        call(kernels)


@pytest.mark.parametrize("name", ["onera", "polito_as_printed"])
@pytest.mark.parametrize("rate", [15e3, 50e3, 200e3])
def test_two_sided_kernels_are_the_model_in_the_band(name, rate):
    """Error at most 4e-7 for every |v| up to 20 m/s, gain at most 1.25, and the stated error is the true one."""
    kernels = build_kernels(tl.load_liner(name), rate, velocity_max=20.0, levels=40)
    assert max(kernels.error / 4e-7, kernels.gain / 1.25) <= 1
    check = torch.linspace(300, 3500, 311, dtype=F64)
    away = kernels.response(check) - reflection_of(tl.load_liner(name), check, kernels.grid.speeds[:, None])
    assert float(away.abs().max()) <= kernels.error * 1.05


@pytest.mark.parametrize(
    ("top", "levels", "spacing", "kind", "limit"),
    [
        (1.0, 200, "uniform", "linear", 6e-5),
        (20.0, 200, "uniform", "linear", 2.2e-2),
        (20.0, 200, "sqrt", "cubic", 6e-6),
        (5.0, 200, "sqrt", "cubic", 1e-6),
    ],
)
def test_interpolation_error(top, levels, spacing, kind, limit):
    """Cubics in the root of |v| beat the paper's levels by three orders."""
    grid, speeds = VelocityGrid(top, levels, spacing, kind), torch.linspace(0, top, 20001, dtype=F64)
    f, worst = torch.tensor([300.0, 1400.0, 3500.0], dtype=F64), 0.0
    for name in ("onera", "polito_as_printed"):
        liner = tl.load_liner(name)
        found = interpolate(reflection_of(liner, f, grid.speeds[:, None]), *grid.locate(speeds))
        worst = max(worst, float((found - reflection_of(liner, f, speeds[:, None])).abs().max()))
    assert limit / 20 < worst <= limit


@given(
    top=st.floats(1e-3, 100),
    levels=st.integers(4, 50),
    share=st.floats(0, 1),
    spacing=st.sampled_from(["sqrt", "uniform"]),
    kind=st.sampled_from(["linear", "cubic"]),
)
def test_interpolation_is_exact_on_its_polynomials(top, levels, share, spacing, kind):
    grid, speed = VelocityGrid(top, levels, spacing, kind), torch.tensor([share * top], dtype=F64)
    root = 0.5 if spacing == "sqrt" else 1.0
    for power in (0, 1, 3) if kind == "cubic" else (0, 1):
        wanted = (speed / top) ** (root * power)
        found = interpolate((grid.speeds[:, None] / top) ** (root * power), *grid.locate(speed))
        assert float((found - wanted).abs()) < 1e-9
