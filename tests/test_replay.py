"""Laws of the reply to a tone: from moments of |v|, and by the sum over emissions term by term."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, turbulence
from hypothesis import given, settings
from hypothesis import strategies as st

import torchliner as tl
from torchliner.compiled.library import available
from torchliner.liners.model import as_liner
from torchliner.records.slabs import bounds_of
from torchliner.reduction.basis import (
    Chebyshev,
    Levels,
    choose_basis,
    interpolation_error,
    response_of,
)
from torchliner.reduction.line_means import LineReader, lines_needed, window_lines
from torchliner.reduction.plan import PassPlan
from torchliner.reduction.sources import Columns, HeldSpeed
from torchliner.reduction.speed_sums import SpeedSums
from torchliner.replay.direct import direct_sums, replay_direct
from torchliner.replay.edges import Record
from torchliner.replay.emissions import ComplexTones
from torchliner.replay.incident import LineSums, Means
from torchliner.replay.kernels import build_kernels
from torchliner.replay.levels import VelocityGrid, interpolate
from torchliner.replay.sinks import ToneSink
from torchliner.replay.unfold import replay_unfold
from torchliner.signals.blocks import plan_blocks
from torchliner.signals.tones import WindowSums
from torchliner.signals.windows import make_window

FREQUENCIES = torch.tensor([FREQUENCY, 2100.0], dtype=torch.float64)
GRID = VelocityGrid(16.0)
# The same levels and cubics between them, for kernels and for moments.
UNIFORM = VelocityGrid(16.0, 161, "uniform", "cubic")
SHARED = Levels((0.0, 16.0), 160)
OFF_AT_THE_ENDS = 5e-11  # s^3: 4e-5 at 11 ms, 4e-10 at 0.5 s
SMOOTH = Chebyshev(96, 1.5)  # R of the presets to 1e-9


def make_record(samples: int, window: str, edge: str, start: int = 0) -> Record:
    return Record(samples, start, make_window(window, samples - start), edge, RATE)


def moments_of(velocity, basis, lines, *, start=0, rate=RATE, rows=256):
    """Plan and moments of (P, n), read by slabs of so many samples."""
    samples = velocity.shape[1]
    blocks = plan_blocks(samples, start, rate / FREQUENCY)
    plan = PassPlan(samples, rate, start, samples, blocks, tuple(lines))
    sums = SpeedSums(plan, basis, len(velocity), velocity.dtype, velocity.device, True)
    for begin, end in bounds_of(samples, rows):
        sums.add(begin, Columns(velocity[:, begin:end].T.contiguous()))
    return plan, sums.result()


def read_lines(
    response, velocity, window="boxcar", basis=SMOOTH, frequency=FREQUENCIES, *, start=0,
    rate=RATE, backward=True, rows=256,
) -> LineSums:  # fmt: skip
    """Lines from the moments of |v|."""
    lines = window_lines(make_window(window, velocity.shape[1] - start), start, rate)
    turns = 2 * frequency[:, None][:, : int(backward)]
    needed = lines_needed(lines, turns)
    plan, group = moments_of(velocity, basis, needed, start=start, rate=rate, rows=rows)
    reader = LineReader(plan, basis, lines, frequency, response, turns)
    return LineSums.with_turns(reader.forward(group), reader.turned(group))


def plain_lines(response, velocity, window, frequency=FREQUENCIES, *, start=0, rate=RATE):
    """docs/method.md as it stands: R(f - q fs/N, |v_k|) of each emission, weighed, and added up."""
    speed = velocity[:, start:].double().abs()
    samples = speed.shape[1]
    steps, found = torch.arange(samples, dtype=torch.float64), []
    for f in frequency.tolist():
        total = torch.zeros(speed.shape, dtype=torch.complex128)
        for q, coefficient in make_window(window, samples).lines:
            near = torch.tensor([f - q * rate / samples], dtype=torch.float64)
            reflection = response(near, speed.flatten()).reshape(speed.shape)
            total += coefficient * torch.exp(2j * torch.pi * q * steps / samples) * reflection
        back = torch.exp(-4j * torch.pi * f / rate * (steps + start))
        found.append((total.sum(1), (total * back).sum(1)))
    forward, backward = zip(*found, strict=True)
    return LineSums(torch.stack(forward, 1), torch.stack(backward, 1))


def apart(one: LineSums, other: LineSums, window: str, samples: int) -> float:
    """Largest |dR| of either reply."""
    scale = make_window(window, samples).weights.sum()
    pairs = [(one.forward, other.forward)]
    if one.backward is not None:
        pairs.append((one.backward, other.backward))
    return max(float((mine - theirs).abs().max() / scale) for mine, theirs in pairs)


@pytest.mark.parametrize(("dtype", "limit"), [(torch.float64, 2e-9), (torch.float32, 1e-6)])
@pytest.mark.parametrize("window", ["boxcar", "hann", "blackman"])
@pytest.mark.parametrize(("probes", "start", "backward"), [(4, 0, True), (70, 41, True),
                                                           (4, 41, False)])  # fmt: skip
def test_moments_give_the_mean_of_the_model(liner, dtype, limit, window, probes, start, backward):
    """Every window and phase, few columns and many, with what a pre-roll leaves out."""
    velocity = turbulence((probes, 811), seed=probes).to(dtype)
    response = response_of(liner)
    wanted = plain_lines(response, velocity, window, start=start)
    found = read_lines(response, velocity, window, start=start, backward=backward)
    assert (found.backward is not None) == backward
    assert apart(found, wanted, window, 811 - start) < limit


@settings(max_examples=25)
@given(
    samples=st.integers(20, 700),
    rate=st.floats(9e3, 2e5),
    frequency=st.lists(st.floats(600, 4000), min_size=1, max_size=3, unique=True),
    share=st.floats(0, 0.4),
    window=st.sampled_from(["boxcar", "hann", "blackman"]),
    rms=st.floats(0.01, 20),
)
def test_any_record_gives_the_mean_of_the_model(
    samples, rate, frequency, share, window, rms
):  # fmt: skip
    """Any length, rate, pre-roll and frequency, at the accuracy that the basis states."""
    liner, start = tl.load_liner("onera"), int(share * samples)
    # Below 0 Hz there is no response; the reader says so.
    asked = torch.tensor(sorted(frequency), dtype=torch.float64)
    if float(asked.min()) - 2.01 * rate / (samples - start) <= 0:
        asked = asked + 2.01 * rate / (samples - start)
    response = response_of(liner)
    velocity = turbulence((2, samples), seed=samples, rms=rms)
    options = {"start": start, "rate": rate, "frequency": asked}
    wanted = plain_lines(response, velocity, window, **options)
    lines = make_window(window, samples - start).lines
    shift = rate / (samples - start) * torch.tensor([float(q) for q, _ in lines])
    read = (asked[:, None] - shift).flatten()
    basis = choose_basis([liner], read, 1e-8)
    found = read_lines(response, velocity, window, basis, **options)
    stated, _ = interpolation_error(basis, response, read, float(velocity.abs().max()))
    # 1.1: the largest error may stand between the speeds compared.
    weight = sum(abs(c) for _, c in lines) / abs(dict(lines)[0])
    assert apart(found, wanted, window, samples - start) < 1.1 * weight * stated + 1e-12


@pytest.mark.parametrize("window", ["boxcar", "hann"])
def test_tables_with_kinks_keep_them(onera, window):
    """Linear between the table's speeds: levels between kinks, at which R turns."""
    frequency, speed = np.linspace(800, 3000, 40), np.linspace(0, 20, 15)
    values = onera.impedance(frequency[:, None], speed).numpy()
    table = tl.TabulatedLiner(frequency, values, speed)
    basis = choose_basis([table], FREQUENCIES, 1e-9)
    assert isinstance(basis, Levels)
    velocity = turbulence((3, 600), seed=8)
    response = response_of(table)
    found = read_lines(response, velocity, window, basis)
    wanted = plain_lines(response, velocity, window)
    stated, _ = interpolation_error(basis, response, FREQUENCIES, 20.0)
    assert apart(found, wanted, window, 600) < stated < 2e-6
    astride = Levels(tuple(20 * (i / 15) ** 2 for i in range(16)), basis.parts)
    assert apart(read_lines(response, velocity, window, astride), wanted, window, 600) > stated


def test_a_liner_of_ones_own_is_read_like_a_preset(liner):
    class Plain:
        def impedance(self, frequency, speed):
            return liner.impedance(frequency, speed)

    velocity = turbulence((3, 300), seed=8)
    found = read_lines(response_of(as_liner(Plain())), velocity)
    assert torch.equal(found.forward, read_lines(response_of(liner), velocity).forward)


# Beside the engines that form the reflected signal


@pytest.fixture(scope="module")
def kernels(liner):
    return build_kernels(liner, UNIFORM, RATE)


def of_kernels(kernels):
    return lambda frequency, _: kernels.response(frequency).T


def unfolded(velocity, kernels, record, frequency=FREQUENCIES) -> LineSums:
    sink = ToneSink(frequency, record, len(velocity), velocity.device)
    tones = ComplexTones(frequency, record.sampling_rate)
    replay_unfold(HeldSpeed(velocity.abs()), kernels, tones, record, [sink])
    return sink.sums(True)


@pytest.mark.parametrize("engine", ["direct", "unfold"])
@pytest.mark.parametrize("window", ["boxcar", "hann", "blackman"])
def test_a_periodic_record_has_no_ends(liner, kernels, engine, window):
    """Wrapped, whole periods: the reflected signal's line is the moments', with the kernels' own
    response; with the model's it is as far off as the kernels are from the model."""
    velocity = turbulence((4, 600), seed=600)
    record = make_record(600, window, "wrap")
    if engine == "direct":
        wanted = direct_sums(velocity.abs(), kernels, FREQUENCIES, record)
    else:
        wanted = unfolded(velocity, kernels, record)
    found = read_lines(of_kernels(kernels), velocity, window, SHARED)
    assert apart(found, wanted, window, 600) < 1e-9
    model = read_lines(response_of(liner), velocity, window, SHARED)
    assert 1e-9 < apart(model, wanted, window, 600) < 1.05 * kernels.error


def off_at_the_ends(kernels, seconds: float, probes: int) -> float:
    """Mean |dR| of a finite record of whole periods under Hann: on reception and on emission."""
    samples = round(round(seconds * FREQUENCY) * RATE / FREQUENCY)
    velocity = turbulence((probes, samples), seed=3)
    velocity = velocity.clamp(-15.9, 15.9)
    record = make_record(samples, "hann", "finite")
    wanted = unfolded(velocity, kernels, record, FREQUENCIES[:1]).forward
    found = read_lines(
        of_kernels(kernels), velocity, "hann", SHARED, FREQUENCIES[:1], backward=False
    ).forward  # fmt: skip
    return float((found - wanted).abs().mean() / record.window.weights.sum())


def test_engines_meet_as_the_record_grows(kernels):
    """What the two ends of a record hold is all that tells them apart: it falls as its length
    cubed under Hann, whose weight at a distance t from an end is (pi t/T)^2."""
    for length in (11e-3, 22e-3, 45e-3, 90e-3):
        found = off_at_the_ends(kernels, length, 40)
        assert found == pytest.approx(OFF_AT_THE_ENDS / length**3, rel=0.3)


def test_the_default_meets_the_engines_as_the_record_grows(liner):
    """Weight 1 on emission times against a boxcar on the reflected signal, through the public door:
    they differ by what the ends hold, a share 1/T of the record."""
    options = {"order": "probes first", "interval": None, "dtype": "float64"}
    apart = []
    for periods in (20, 80, 320):
        plane = plane_of(turbulence((24, 30 * periods)))
        default = tl.educe(plane, liner, **options).reflection
        replayed = tl.educe(plane, liner, engine="unfold", window="boxcar", **options).reflection
        apart.append(float((default - replayed).abs().square().mean().sqrt()))
    assert apart[0] / apart[1] == pytest.approx(4, rel=0.35)
    assert apart[1] / apart[2] == pytest.approx(4, rel=0.35)
    assert apart[2] < 5e-4


@pytest.mark.slow
def test_engines_meet_in_half_a_second(kernels):
    found = off_at_the_ends(kernels, 0.5, 6)
    assert found == pytest.approx(OFF_AT_THE_ENDS / 0.5**3, rel=0.3)


@pytest.mark.parametrize("edge", ["finite", "wrap"])
@pytest.mark.parametrize("samples", [480, 491])
def test_frozen_velocity_returns_the_response(kernels, edge, samples):
    """With |v| constant the replay is linear: a is the kernel's R, b is 0."""
    samples = 480 if edge == "wrap" else samples
    record = make_record(samples, "hann", edge)
    speed = torch.full((2, samples), 2.0, dtype=torch.float64)
    window = WindowSums.of(record.window.weights, 0, FREQUENCIES, RATE)
    means = Means.of(direct_sums(speed, kernels, FREQUENCIES, record), window)
    wanted = interpolate(kernels.response(FREQUENCIES), *UNIFORM.locate(speed[:, 0]))
    assert float((means.a - wanted).abs().max()) < 1e-12
    assert float(means.b.abs().max()) < 1e-12


@pytest.mark.parametrize("samples", [480, 491])
@pytest.mark.parametrize("window", ["boxcar", "hann"])
def test_frozen_velocity_returns_the_model(liner, window, samples):
    """From moments too, and at any phase of a wave whose periods are no whole ones."""
    speed = torch.full((2, samples), 2.0, dtype=torch.float64)
    response = response_of(liner)
    weights = WindowSums.of(make_window(window, samples).weights, 0, FREQUENCIES, RATE)
    sums = read_lines(response, speed, window)
    wanted = response(FREQUENCIES, speed[0, :1]).T
    assert float((sums.forward / weights.zero - wanted).abs().max()) < 2e-9
    if window == "boxcar":  # Hann reads R beside f
        means = Means.of_emissions(sums, weights)
        assert float((means.a - wanted).abs().max()) < 2e-9
        assert float(means.b.abs().max()) < 2e-9


@pytest.mark.parametrize("psi", [0.3, 1.7])
def test_frozen_velocity_knows_no_phase(liner, psi):
    """Though no whole number of samples is a period, so that the weights reach from -f to f."""
    velocity = torch.full((2, 500), 2.0, dtype=torch.float64)
    plane = tl.VelocityPlane(velocity, sampling_rate=41234.5, frequency=FREQUENCY)
    found = tl.educe(plane, liner, phase="given", reference_phase=psi, interval=None)
    wanted = tl.reflection_from_impedance(liner.impedance(FREQUENCY, 2.0))
    assert float((found.reflection - wanted).abs().max()) < 2e-9


@pytest.mark.slow
@pytest.mark.parametrize(("samples", "low", "high"), [(480, 1e-4, 4e-4), (42000, 1e-11, 1.5e-8)])
def test_start_up_error_of_the_literal_sum(kernels, samples, low, high):
    """'silent' begins with no wave: 2.8e-4 for 16 periods, 1.5e-8 for 1 s at most, with Hann."""
    speed = torch.full((1, samples), 0.3, dtype=torch.float64)
    wanted = interpolate(kernels.response(FREQUENCIES), *UNIFORM.locate(speed[:, 0]))
    errors = {}
    for edge in ("silent", "finite"):
        record = make_record(samples, "hann", edge)
        window = WindowSums.of(record.window.weights, 0, FREQUENCIES, RATE)
        means = Means.of(unfolded(speed, kernels, record), window)
        errors[edge] = float((means.a - wanted).abs()[:, 0].max())
    assert low < errors["silent"] < high
    assert errors["finite"] < 1e-11


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


@pytest.mark.parametrize("samples", [1, 2, 30])
def test_smallest_sizes(kernels, liner, samples):
    """One sample, one probe: still the law of frozen velocity."""
    record = make_record(samples, "boxcar", "finite")
    speed = torch.full((1, samples), 1.0, dtype=torch.float64)
    sums = direct_sums(speed, kernels, FREQUENCIES, record)
    wanted = interpolate(kernels.response(FREQUENCIES), *UNIFORM.locate(speed[:, 0]))
    assert float((sums.forward / samples - wanted).abs().max()) < 1e-12
    response = response_of(liner)
    found = read_lines(response, speed).forward / samples
    assert float((found - response(FREQUENCIES, speed[0, :1]).T).abs().max()) < 2e-9


# What does not matter


def test_direct_never_sees_a_neighbour(kernels):
    speed, record = turbulence((7, 333), seed=3).abs(), make_record(333, "hann", "finite")
    together = direct_sums(speed, kernels, FREQUENCIES, record).forward[4]
    alone = direct_sums(speed[4:5], kernels, FREQUENCIES, record).forward[0]
    assert float((together - alone).abs().max() / alone.abs().max()) < 1e-13


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("basis", [Chebyshev(24, 0.9375), SHARED], ids=["smooth", "levels"])
@pytest.mark.parametrize("probes", [3, 100])
def test_slabs_and_threads_change_no_bit(dtype, basis, probes, set_threads):
    """Sums of a piece are multiples of one quantum, and pieces end where the record says."""
    velocity = turbulence((probes, 1100), seed=4).to(dtype).clamp(-15.9, 15.9)
    lines = (38.0, 2800.0)
    found = []
    for rows, threads in ((1100, 1), (256, 2), (512, 1)):
        set_threads(threads)
        found.append(moments_of(velocity, basis, lines, rows=rows)[1].totals)
    for other in found[1:]:
        # torch's own products may add in another order where rows lie elsewhere in memory.
        exact = available() or isinstance(basis, Levels)
        limit = 0 if exact else 1100 * (2e-7 if dtype == torch.float32 else 1e-12)
        assert float((other - found[0]).abs().max()) <= limit


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_order_of_probes_changes_no_bit(dtype):
    """By the compiled sums; torch's own may round a column by its place."""
    velocity = turbulence((100, 600), seed=5).to(dtype)
    order = torch.randperm(100, generator=torch.Generator().manual_seed(1))
    basis, lines = Chebyshev(24, 0.9375), (38.0, 2800.0)
    together = moments_of(velocity, basis, lines)[1].totals[..., order]
    shuffled = moments_of(velocity[order], basis, lines)[1].totals
    if available():
        assert torch.equal(shuffled, together)
    assert float((shuffled - together).abs().max()) < 2e-7 * 600


def test_a_mean_over_the_unit_disc_stays_in_it(liner):
    """Passivity, whatever the velocity."""
    speed = turbulence((50, 300), seed=6, rms=8.0)
    assert float((read_lines(response_of(liner), speed).forward / 300).abs().max()) <= 1


def test_what_was_not_summed_is_asked_for(liner):
    """Moments without 2f rows know no phase; a window below 0 Hz has no response."""
    velocity, response = turbulence((2, 300)), response_of(liner)
    plan, _ = moments_of(velocity, SMOOTH, ())
    with pytest.raises(ValueError, match="no sums of waves of 2800 Hz, which the phase rule"):
        LineReader(plan, SMOOTH, [(0.0, 1.0)], FREQUENCIES, response, 2 * FREQUENCIES[:, None])
    with pytest.raises(ValueError, match=r"reach down to .* Hz around 100 Hz"):
        read_lines(response, velocity, "hann", frequency=torch.tensor([100.0]).double())
