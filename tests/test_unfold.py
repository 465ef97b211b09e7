"""The engine that forms the whole reflected signal."""

from __future__ import annotations

import functools

import pytest
import torch
from conftest import RATE, turbulence
from test_replay import FREQUENCIES, GRID, make_record

from torchliner.names import EDGE_RULES
from torchliner.records.slabs import bounds_of
from torchliner.reduction.sources import Columns, HeldSpeed
from torchliner.replay.convolve import CONVOLUTIONS
from torchliner.replay.direct import direct_sums, replay_direct
from torchliner.replay.emissions import ComplexTones, Sent
from torchliner.replay.factors import factor_taps
from torchliner.replay.kernels import build_kernels
from torchliner.replay.levels import VelocityGrid
from torchliner.replay.sinks import CrossSpectra, ToneSink, WholeSignal
from torchliner.replay.unfold import replay_unfold
from torchliner.replay.waves import BandNoise

METHODS = tuple(CONVOLUTIONS)
ERROR = {torch.float64: 1e-10, torch.float32: 2e-5}  # issue: against direct on the same kernels


@pytest.fixture(scope="module")
def kernels(liner):
    """Few levels: the rank of the factors, and with it the work, is at most their number."""
    return build_kernels(liner, VelocityGrid(16.0, 24), RATE)


def unfolded(speed, kernels, emission, record, **options):
    """The whole reflected signal, (P, n)."""
    source = options.pop("source", HeldSpeed(speed))
    whole = torch.full((record.samples, sum(source.widths)), torch.nan, dtype=speed.dtype)

    def store(part, columns, begin):
        assert bool(torch.isnan(whole[begin : begin + len(part), columns]).all())
        whole[begin : begin + len(part), columns] = part

    replay_unfold(source, kernels, emission, record, [WholeSignal(store)], **options)
    return whole.T


@pytest.fixture(scope="module")
def direct(kernels):
    """Speed, |v| of 3 probes that float32 holds exactly; record, emission and direct's signal."""

    @functools.cache
    def signal(samples, edge, repeats):
        speed = turbulence((3, samples), seed=samples).abs().float()
        record = make_record(samples, "hann", edge)
        emission = Sent(BandNoise(300, 3500).sampled(samples, RATE), repeats)
        return speed, record, emission, replay_direct(speed, kernels, emission, record)[0]

    return signal


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("edge", EDGE_RULES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("samples", [300, 1300])
def test_reflected_signal_is_that_of_direct(kernels, direct, method, edge, dtype, samples):
    """Every sample of y, for records shorter and longer than the kernel and in many blocks."""
    for repeats, blocks in ((True, (None, 517)), (False, (100,))):
        speed, record, emission, wanted = direct(samples, edge, repeats)
        for block in blocks:
            found = unfolded(speed.to(dtype), kernels, emission, record, method=method, block=block)
            assert float((found - wanted).abs().max()) < ERROR[dtype]
            assert found.dtype == dtype


@pytest.mark.parametrize(("edge", "start"), [("wrap", 0), *((e, s) for e in ("silent", "finite") for s in (0, 41))])
def test_lines_of_tones_are_those_of_direct(kernels, edge, start):
    """Forward and backward lines of every method, with a pre-roll."""
    speed = turbulence((4, 600), seed=2).abs()
    record = make_record(600, "hann", edge, start)
    wanted = direct_sums(speed, kernels, FREQUENCIES, record)
    tones, scale = ComplexTones(FREQUENCIES, RATE), record.window.weights.sum()
    for method in METHODS:
        sink = ToneSink(FREQUENCIES, record, 4, speed.device)
        replay_unfold(HeldSpeed(speed), kernels, tones, record, [sink], method=method)
        found = sink.sums(True)
        assert float((found.forward - wanted.forward).abs().max() / scale) < 1e-10, method
        assert float((found.backward - wanted.backward).abs().max() / scale) < 1e-10, method


class Grouped(HeldSpeed):
    """The same columns in three groups and slabs of 70 samples."""

    def __init__(self, speed):
        super().__init__(speed)
        self.widths = (2, 1, speed.shape[0] - 3)

    def bounds(self):
        return bounds_of(self.samples, 70)

    def slabs(self, bounds):
        for (slab,) in super().slabs(bounds):
            yield [Columns(part) for part in slab.velocity.split(self.widths, dim=1)]


@pytest.mark.parametrize("edge", EDGE_RULES)
def test_groups_passes_and_slabs_do_not_matter(kernels, edge):
    """Small memory means more passes over the data, and the same signal."""
    speed = turbulence((11, 1500), seed=4).abs()
    record = make_record(1500, "hann", edge)
    emission = Sent(BandNoise(300, 3500).sampled(1500, RATE), True)
    wanted = unfolded(speed, kernels, emission, record)
    slabs = []

    class Counting(Grouped):
        def slabs(self, bounds):
            slabs.append(len(bounds))
            return super().slabs(bounds)

    found = unfolded(speed, kernels, emission, record, source=Counting(speed), memory=90_000)
    assert len(slabs) >= 3
    assert float((found - wanted).abs().max()) < 1e-13
    alone = unfolded(speed[7:8], kernels, emission, record)
    assert float((alone[0] - wanted[7]).abs().max()) < 1e-13


def test_memory_below_one_probe_is_refused(kernels):
    """The message says what one probe takes."""
    speed = turbulence((2, 300)).abs()
    emission = Sent(BandNoise(300, 3500).sampled(300, RATE), True)
    record = make_record(300, "hann", "wrap")
    with pytest.raises(ValueError, match=r"below the 0\.0.* MB that one probe takes.*raise memory"):
        unfolded(speed, kernels, emission, record, memory=1000)


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize("edge", EDGE_RULES)
def test_smallest_records(kernels, samples, edge):
    """One sample of one probe."""
    speed = torch.full((1, samples), 1.5, dtype=torch.float64)
    record = make_record(samples, "boxcar", edge)
    emission = ComplexTones(FREQUENCIES, RATE)
    wanted = direct_sums(speed, kernels, FREQUENCIES, record)
    sink = ToneSink(FREQUENCIES, record, 1, speed.device)
    replay_unfold(HeldSpeed(speed), kernels, emission, record, [sink])
    assert float((sink.sums(True).forward - wanted.forward).abs().max()) < 1e-10


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_rank_holds_its_tolerance_and_is_the_smallest(liner, tolerance):
    """At every frequency and level; one factor fewer would not do."""
    kernels = build_kernels(liner, GRID, RATE)
    factors = factor_taps(kernels, tolerance)

    def error(rank):
        change = factors.across[:, :rank] @ factors.along[:rank] - kernels.taps
        return float(torch.fft.rfft(change, n=1 << 13).abs().max())

    assert error(factors.rank) <= tolerance * 1.03 < error(factors.rank - 1)
    assert factors.error == pytest.approx(error(factors.rank), rel=0.03)
    assert factors.rank < kernels.grid.levels / 2


def test_factors_of_one_kernel():
    """A liner that ignores |v| has one shape in time."""

    class Linear:
        def impedance(self, frequency, speed):
            return 1.5 + 0.3j + 0 * (frequency + speed)

    kernels = build_kernels(Linear(), VelocityGrid(4.0), RATE)
    assert factor_taps(kernels, 1e-9).rank == 1


def test_cross_spectra_of_a_frozen_liner(kernels):
    """|v| constant, one period of noise, wrapped: the kernel's response at every line."""
    n = 840
    speed = torch.full((2, n), 2.0, dtype=torch.float64)
    record = make_record(n, "boxcar", "wrap")
    signal = BandNoise(300, 3500).sampled(n, RATE)
    frequency = torch.arange(6, 71, dtype=torch.float64) * RATE / n
    sink = CrossSpectra(signal, record.window.weights, [0], frequency, RATE, 2, speed.device)
    replay_unfold(HeldSpeed(speed), kernels, Sent(signal, True), record, [sink])
    index, weights = kernels.grid.locate(speed[:, 0])
    response = kernels.response(frequency)
    wanted = sum(weight[:, None] * response[index + i] for i, weight in enumerate(weights))
    assert float((sink.reflection() - wanted).abs().max()) < 1e-10


def test_cross_spectra_against_scipy(kernels):
    """Welch's H1 of the stored signal: scipy's csd over welch, at its own lines."""
    from scipy import signal as scipy_signal

    n, length = 4200, 840
    speed = turbulence((2, n), seed=9).abs()
    record = make_record(n, "hann", "silent")
    sent = BandNoise(300, 3500, seed=1).sampled(n, RATE)
    emission = Sent(sent, False)
    reflected = unfolded(speed, kernels, emission, record).numpy()
    options = {"fs": RATE, "nperseg": length, "noverlap": length // 2, "detrend": False}
    lines, cross = scipy_signal.csd(sent.numpy(), reflected, **options)
    _, power = scipy_signal.welch(sent.numpy(), **options)
    frequency = torch.from_numpy(lines[10:60])
    starts = list(range(0, n - length + 1, length // 2))
    window = make_record(length, "hann", "silent").window.weights
    sink = CrossSpectra(sent, window, starts, frequency, RATE, 2, speed.device)
    replay_unfold(HeldSpeed(speed), kernels, emission, record, [sink], block=517)
    wanted = torch.from_numpy((cross / power)[:, 10:60])
    assert float((sink.reflection() - wanted).abs().max()) < 1e-9
    assert not sink.open


@pytest.mark.parametrize("kind", ["two-sided", "causal"])
@pytest.mark.parametrize("levels", [("sqrt", "cubic"), ("uniform", "linear"), ("sqrt", "linear")])
def test_every_kernel_and_level_rule(liner, kind, levels):
    """The paper's own table (causal, uniform levels, linear) and ours: ``direct``'s signal."""
    grid = VelocityGrid(16.0, 48, *levels)
    kernels = build_kernels(liner, grid, RATE, kind=kind)
    speed = turbulence((2, 400), seed=5).abs()
    record = make_record(400, "hann", "finite")
    emission = Sent(BandNoise(300, 3500).sampled(400, RATE), True)
    wanted = replay_direct(speed, kernels, emission, record)[0]
    for method in METHODS:
        found = unfolded(speed, kernels, emission, record, method=method)
        assert float((found - wanted).abs().max()) < 1e-10, method
    assert kernels.gain > 0.9
    assert (kernels.error < 1e-6) == (kind == "two-sided")
