"""Laws of the two engines."""

from __future__ import annotations

import itertools

import pytest
import torch
from conftest import FREQUENCY, RATE, turbulence

import torchliner as tl
from torchliner.liners.model import as_liner
from torchliner.records.slabs import bounds_of
from torchliner.replay.direct import direct_sums, replay_direct
from torchliner.replay.edges import Record
from torchliner.replay.emissions import ComplexTones
from torchliner.replay.incident import Means
from torchliner.replay.kernels import build_kernels
from torchliner.replay.levels import VelocityGrid, interpolate
from torchliner.replay.lines import plan_lines
from torchliner.reduction.sources import HeldSpeed
from torchliner.replay.spectral import spectral_sums
from torchliner.signals.tones import WindowSums
from torchliner.signals.windows import make_window

FREQUENCIES = torch.tensor([FREQUENCY, 2100.0], dtype=torch.float64)
GRID = VelocityGrid(16.0)


def make_record(samples: int, window: str, edge: str, start: int = 0) -> Record:
    return Record(samples, start, make_window(window, samples - start), edge, RATE)


def run_spectral(liner, speed, record, kernels, of_kernel, **sizes):
    frequency = FREQUENCIES.tolist()
    lines = plan_lines(liner, frequency, record, GRID, kernels, of_kernel=of_kernel)
    return spectral_sums(HeldSpeed(speed), lines, GRID, **sizes)


@pytest.fixture(scope="module")
def kernels(liner):
    return build_kernels(liner, GRID, RATE)


@pytest.mark.parametrize(
    ("edge", "samples", "starts"),
    [("wrap", 300, [0]), ("wrap", 600, [0])]
    + [(edge, samples, [0, 41]) for edge in ("silent", "finite") for samples in (300, 811)],
)
def test_engines_agree_on_turbulence(liner, kernels, monkeypatch, edge, samples, starts):
    """Given the kernels' response, ``spectral`` is ``direct`` to 1e-12: any edge and window."""
    speed = turbulence((4, samples), seed=samples).abs()
    tones = ComplexTones(FREQUENCIES, RATE)
    replayed = replay_direct(speed, kernels, tones, make_record(samples, "hann", edge))
    monkeypatch.setattr("torchliner.replay.direct.replay_direct", lambda *_: replayed)
    for window, start in itertools.product(("hann", "boxcar", "blackman", "kaiser,8"), starts):
        record = make_record(samples, window, edge, start)
        wanted = direct_sums(speed, kernels, FREQUENCIES, record)  # windows what is replayed
        found = run_spectral(liner, speed, record, kernels, True)
        scale = record.window.weights.sum()
        assert float((found.forward - wanted.forward).abs().max() / scale) < 1e-12, window
        assert float((found.backward - wanted.backward).abs().max() / scale) < 1e-12, window


@pytest.mark.parametrize("engine", ["direct", "spectral"])
@pytest.mark.parametrize("edge", ["finite", "wrap"])
@pytest.mark.parametrize("samples", [480, 491])
def test_frozen_velocity_returns_the_response(liner, kernels, engine, edge, samples):
    """With |v| constant the replay is linear: a is the kernel's (model's) R, b is 0."""
    if edge == "wrap":
        samples = 480
    record = make_record(samples, "hann", edge)
    speed = torch.full((2, samples), 2.0, dtype=torch.float64)
    window = WindowSums.of(record.window.weights, 0, FREQUENCIES, RATE)
    if engine == "direct":
        means = Means.of(direct_sums(speed, kernels, FREQUENCIES, record), window)
        wanted = interpolate(kernels.response(FREQUENCIES), *GRID.locate(speed[:, 0]))
    else:
        sums = run_spectral(liner, speed, record, kernels, False)
        means = Means.of(sums, window)
        wanted = tl.reflection_from_impedance(liner.impedance(FREQUENCIES, 2.0))
        assert float((sums.forward / window.zero - wanted).abs().max()) < 1e-12
    # The model's own lines and the kernel's ends differ by the kernel's error, 2e-7; of it only
    # the window's leakage from -f reaches a stated phase, and none if the periods are whole.
    limit = 1e-9 if engine == "spectral" and samples == 491 else 1e-12
    assert float((means.a - wanted).abs().max()) < limit
    assert float(means.b.abs().max()) < limit


@pytest.mark.slow
@pytest.mark.parametrize(("samples", "low", "high"), [(480, 1e-4, 4e-4), (42000, 1e-11, 1.5e-8)])
def test_start_up_error_of_the_literal_sum(liner, kernels, samples, low, high):
    """'silent' begins with no wave: 2.8e-4 for 16 periods, 1.5e-8 for 1 s at most, with Hann."""
    speed = torch.full((1, samples), 0.3, dtype=torch.float64)
    wanted = interpolate(kernels.response(FREQUENCIES), *GRID.locate(speed[:, 0]))
    errors = {}
    for edge in ("silent", "finite"):
        record = make_record(samples, "hann", edge)
        window = WindowSums.of(record.window.weights, 0, FREQUENCIES, RATE)
        means = Means.of(run_spectral(liner, speed, record, kernels, True), window)
        errors[edge] = float((means.a - wanted).abs()[:, 0].max())
    assert low < errors["silent"] < high
    assert errors["finite"] < 1e-12


def test_the_kernel_belongs_to_the_emission(liner):
    """A unit pulse before a velocity step rings on with the kernel it was emitted through."""
    kernels = build_kernels(liner, GRID, RATE)
    n, step = 900, 450
    speed = torch.full((1, n), 0.5, dtype=torch.float64)
    speed[:, step:] = 8.0
    record = make_record(n, "boxcar", "silent")
    low = torch.full_like(speed, 0.5)
    replayed = replay_direct(speed, kernels, ComplexTones(FREQUENCIES[:1], RATE), record)[0, 0]
    steady = replay_direct(low, kernels, ComplexTones(FREQUENCIES[:1], RATE), record)[0, 0]
    # The difference is what the samples from the step on emit through the other kernel, no more.
    tone = torch.exp(2j * torch.pi * FREQUENCY / RATE * torch.arange(n, dtype=torch.float64))
    slow = interpolate(kernels.taps, *GRID.locate(speed[0, :1]))[0]
    fast = interpolate(kernels.taps, *GRID.locate(speed[0, -1:]))[0]
    wanted = torch.zeros(n, dtype=torch.complex128)
    for k in range(step, n):
        first = k + kernels.first
        taps = (fast - slow)[: n - first]
        wanted[first : first + len(taps)] += tone[k] * taps
    assert float((replayed - steady - wanted).abs().max()) < 1e-12
    # Nothing before the step minus the anticausal taps has changed: reception-time kernels would.
    assert float((replayed - steady)[: step + kernels.first].abs().max()) == 0
    assert float((replayed - steady)[step + 5 :].abs().max()) > 0.1


def test_probe_alone_equals_probe_in_a_plane(liner, kernels):
    """A probe's sum never meets its neighbours'."""
    speed = turbulence((7, 333), seed=3).abs()
    record = make_record(333, "hann", "finite")
    for run in (
        lambda v: direct_sums(v, kernels, FREQUENCIES, record).forward,
        lambda v: run_spectral(liner, v, record, kernels, False).forward,
    ):
        together, alone = run(speed), run(speed[4:5])
        assert float((together[4] - alone[0]).abs().max() / alone.abs().max()) < 1e-13


@pytest.mark.parametrize("sizes", [(1, 1), (7, 50), (120, 1 << 20)])
def test_slab_and_block_sizes_do_not_matter(liner, kernels, sizes):
    """Partial sums add up."""
    speed = turbulence((3, 120), seed=4).abs()
    record = make_record(120, "hann", "finite")
    wanted = run_spectral(liner, speed, record, kernels, False)
    rows, elements = sizes
    found = run_spectral(liner, speed, record, kernels, False,
                         bounds=bounds_of(120, rows), elements=elements)  # fmt: skip
    assert float((found.forward - wanted.forward).abs().max() / wanted.forward.abs().max()) < 1e-13
    assert float((found.backward - wanted.backward).abs().max()) < 1e-11


def test_thread_count_does_not_matter(liner, kernels):
    """One thread or two: the same to rounding."""
    speed = turbulence((300, 400), seed=5).abs()
    record = make_record(400, "hann", "finite")
    before = torch.get_num_threads()
    try:
        found = []
        for threads in (1, 2):
            torch.set_num_threads(threads)
            found.append(run_spectral(liner, speed, record, kernels, False).forward)
    finally:
        torch.set_num_threads(before)
    assert float((found[0] - found[1]).abs().max() / found[0].abs().max()) < 1e-13


def test_averaged_rectangular_wrap_is_passive(liner):
    """A mean of points of the unit disc stays in it, whatever the velocity."""
    speed = turbulence((50, 300), seed=6, rms=8.0).abs()
    record = make_record(300, "boxcar", "wrap")
    sums = run_spectral(liner, speed.clamp(max=15.9), record, None, False)
    assert float((sums.forward / 300).abs().max()) <= 1
    # and it is that mean
    mean = tl.reflection_from_impedance(liner.impedance(FREQUENCY, speed.clamp(max=15.9))).mean(1)
    assert float((sums.forward[:, 0] / 300 - mean).abs().max()) < 1e-13


@pytest.mark.parametrize("samples", [1, 2, 30])
def test_smallest_sizes(liner, kernels, samples):
    """One sample, one probe: still the law of frozen velocity for ``direct``."""
    record = make_record(samples, "boxcar", "finite")
    speed = torch.full((1, samples), 1.0, dtype=torch.float64)
    sums = direct_sums(speed, kernels, FREQUENCIES, record)
    wanted = interpolate(kernels.response(FREQUENCIES), *GRID.locate(speed[:, 0]))
    assert float((sums.forward / samples - wanted).abs().max()) < 1e-12


def test_single_precision_is_close(liner, kernels):
    """float32 data: R within 1e-6 of float64."""
    speed = turbulence((20, 600), seed=7).abs()
    record = make_record(600, "hann", "finite")
    wanted = run_spectral(liner, speed, record, kernels, False).forward
    found = run_spectral(liner, speed.to(torch.float32), record, kernels, False).forward
    assert float((found - wanted).abs().max() / record.window.weights.sum()) < 1e-6


def test_table_response_is_close_to_the_formula(liner, kernels):
    """A liner without speed_law goes through the levels: 1e-6."""

    class Plain:
        def impedance(self, frequency, speed):
            return liner.impedance(frequency, speed)

    speed = turbulence((3, 300), seed=8).abs()
    record = make_record(300, "hann", "wrap")
    formula = run_spectral(liner, speed, record, None, False).forward
    table = run_spectral(as_liner(Plain()), speed, record, None, False).forward
    difference = float((formula - table).abs().max() / record.window.weights.sum())
    assert 0 < difference < 2e-6
