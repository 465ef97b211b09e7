"""Lines of laser Doppler stations: segments, averages (5.1) and (5.2), intervals, reference."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch

import torchliner as tl
from torchliner.conversions import admittance_from_reflection
from torchliner.eduction.choices import Choices
from torchliner.eduction.line_average import (
    monte_carlo,
    monte_carlo_deviation,
    segment_admittances,
    station_interval,
)

FREQUENCY, RATE, SEGMENT = 1500.0, 20e3, 0.04
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def noise(times: np.ndarray, generator: np.random.Generator, rms: float) -> np.ndarray:
    """Gaussian, smooth on the scale of 0.2 ms: a sum of 200 waves of 50 to 1200 Hz."""
    frequency = generator.uniform(50, 1200, 200)
    phase = generator.uniform(0, 2 * np.pi, 200)
    found = np.zeros_like(times)
    for f, p in zip(frequency, phase, strict=True):
        found += np.cos(2 * np.pi * f * times + p)
    return rms * found / 10


def station(seed=0, *, seconds=0.4, tone=1.0, phase=0.3, rms=1.0, rate=RATE, **about):
    generator = np.random.default_rng(seed)
    times = np.cumsum(generator.exponential(1 / rate, int(1.3 * rate * seconds) + 50))
    times = times[times < seconds]
    velocity = noise(times, generator, rms) + tone * np.cos(2 * np.pi * FREQUENCY * times + phase)
    about = {"x": 0.01 * seed, "y": 1e-3, "z": 0.0, "frequency": FREQUENCY,
             "title": f"s{seed}", "name": f"s{seed}"} | about  # fmt: skip
    return tl.BurstRecord(times, wall_normal=velocity, **about)


def educed(stations, liner, **choices):
    return tl.educe_bursts(stations, liner, **{"segment": SEGMENT, **choices})


@pytest.fixture(scope="module")
def onera():
    return tl.load_liner("onera")


@pytest.fixture(scope="module")
def line(onera):
    return educed([station(seed) for seed in range(3)], onera)


@pytest.mark.parametrize("method", ["linear", "hold", "band-limited"])
def test_frozen_velocity_returns_the_model(onera, method):
    """Constant bursts are a constant |v| on any grid, in every segment and average."""
    still = station(1)
    still = tl.BurstRecord(
        still.arrival_time, wall_normal=torch.full_like(still.arrival_time, -2.0), x=0.0, y=1e-3,
        z=0.0, frequency=FREQUENCY,
    )  # fmt: skip
    found = educed([still], onera, method=method, correction="none", flagged="use")
    wanted = complex(onera.impedance(FREQUENCY, 2.0))
    assert float((found.segment_impedance - wanted).abs().max()) < 1e-8
    assert abs(complex(found.average.impedance[0]) - wanted) < 1e-8
    assert float((found.interval.high - found.interval.low).abs().max()) < 1e-7


@pytest.mark.parametrize("phase", ["averaged", "self-consistent"])
def test_segments_are_as_if_educed_one_by_one(onera, phase):
    """Every segment of an evenly sampled record is what ``educe`` finds in that piece of it."""
    rate, hop = 30e3, 600
    times = np.arange(12_001) / rate + 2.0
    velocity = noise(times, np.random.default_rng(3), 1.5)
    velocity += 1.2 * np.cos(2 * np.pi * FREQUENCY * times)
    record = tl.BurstRecord(times, wall_normal=velocity, x=0.0, y=1e-3, z=0.0, frequency=FREQUENCY)
    found = educed([record], onera, grid_rate=rate, phase=phase, correction="none")
    assert found.segments.tolist() == [19]
    assert found.segment_start[0].tolist() == pytest.approx([2 + 0.02 * i for i in range(19)])
    for i in (0, 7, 18):
        piece = velocity[i * hop : i * hop + 2 * hop]
        plane = tl.VelocityPlane(piece[None], sampling_rate=rate, frequency=FREQUENCY)
        alone = tl.educe(plane, onera, phase=phase, interval=None)
        assert float((found.reflection[0, i] - alone.reflection[0]).abs()) < 1e-9


def test_a_station_depends_on_no_other(onera, line):
    """Alone, in another order, or beside a fast one: the same digits; the line runs along x."""
    fast = station(9, tone=8.0, x=0.5)
    other = educed([fast, *(station(seed) for seed in (2, 0, 1))], onera)
    assert other.names == ("s0", "s1", "s2", "s9")
    for i, name in enumerate(line.names):
        j = other.names.index(name)
        count = int(line.segments[i])
        assert torch.equal(line.reflection[i, :count], other.reflection[j, :count])
        assert torch.equal(line.interval.low[i], other.interval.low[j])


def test_averages_are_those_of_the_paper(line):
    """(5.1): mean of Z over segments. (5.2): mean over stations of the mean of 1/Z."""
    for n in range(line.stations):
        own = line.segment_impedance[n, : int(line.segments[n]), 0]
        assert complex(line.impedance[n, 0]) == pytest.approx(complex(own.mean()))
        assert complex(line.admittance[n, 0]) == pytest.approx(complex((1 / own).mean()))
        assert float(line.segment_spread[n, 0].real) == pytest.approx(float(own.real.std()))
    wanted = 1 / complex(line.admittance.mean())
    assert complex(line.average.impedance[0]) == pytest.approx(wanted)
    wide = line.impedance[:, 0]
    assert float(line.average.spatial_spread[0].imag) == pytest.approx(float(wide.imag.std()))


def test_monte_carlo_is_the_closed_form_and_its_spread_too(line):
    """Means within four standard errors of the draws; the spread within four per cent."""
    admittance, counts = segment_admittances(line), line.segments
    draws = 20_000
    drawn = monte_carlo(admittance, counts, draws, seed=1)[:, 0]
    wide = complex(monte_carlo_deviation(admittance, counts)[0])
    off = complex(drawn.mean()) - complex(line.admittance.mean())
    assert abs(off.real) < 4 * wide.real / math.sqrt(draws)
    assert abs(off.imag) < 4 * wide.imag / math.sqrt(draws)
    assert float(drawn.real.std()) == pytest.approx(wide.real, rel=0.04)
    assert float(drawn.imag.std()) == pytest.approx(wide.imag, rel=0.04)


def test_the_spread_of_the_draws_shrinks_with_stations_and_the_others_do_not():
    """4 times the stations halve it; spread over segments and along the line stay."""
    generator = torch.Generator().manual_seed(4)
    values = torch.randn(64, 20, 1, 2, generator=generator, dtype=torch.float64)
    admittance = torch.view_as_complex(values) * 0.1 + 0.5
    counts = torch.full((64,), 20)
    few, many = (complex(monte_carlo_deviation(admittance[:n], counts[:n])[0]) for n in (16, 64))
    assert many.real / few.real == pytest.approx(0.5, rel=0.08)
    assert monte_carlo(admittance, counts, 10, 0).shape == (10, 1)
    # Shorter stations are drawn from their own segments alone.
    padded = admittance.clone()
    padded[3, 5:] = torch.nan
    counts[3] = 5
    assert torch.isfinite(monte_carlo(padded, counts, 2000, 0).real).all()


def test_monte_carlo_in_parts_is_the_whole(monkeypatch, line):
    whole = monte_carlo(segment_admittances(line), line.segments, 500, 3)
    monkeypatch.setattr("torchliner.eduction.line_average.DRAWN", 30)
    assert torch.equal(whole, monte_carlo(segment_admittances(line), line.segments, 500, 3))


def segment_means(generator: np.random.Generator, segments: int) -> np.ndarray:
    """Complex means of white noise under Hann windows that overlap by half."""
    length = 64
    white = generator.standard_normal(((segments + 1) * length // 2, 2)) @ [1, 1j]
    window = np.hanning(length + 1)[:-1]
    return np.array([
        (window * white[i * length // 2 : i * length // 2 + length]).sum() / window.sum()
        for i in range(segments)
    ])  # fmt: skip


def test_intervals_cover_with_overlapping_segments():
    """19 segments, as of 10 s: 95 % hold R and X in 95 % of 600 trials, within three standard
    errors (2.7 %); scripts/coverage.py runs the whole chain 2000 times."""
    generator = np.random.default_rng(0)
    inside = np.zeros(2)
    chosen = Choices(draws=400)
    for _ in range(600):
        reflection = torch.from_numpy(0.3 + 0.1j + 0.02 * segment_means(generator, 19))[:, None]
        found = station_interval(reflection, chosen)
        true = (1 + (0.3 + 0.1j)) / (1 - (0.3 + 0.1j))
        low, high = complex(found.low[0]), complex(found.high[0])
        inside += low.real <= true.real <= high.real, low.imag <= true.imag <= high.imag
    assert np.all(np.abs(inside / 600 - 0.95) < 0.027)


def test_the_bias_of_short_segments_is_taken_off_the_bounds():
    """The mean of Z over noisy segments is off by Z'' var/2; the bounds sit about the true Z."""
    generator = np.random.default_rng(1)
    true = (1 + 0.5) / (1 - 0.5)
    off, middles = [], []
    for _ in range(300):
        noisy = 0.5 + 0.15 * generator.standard_normal(40)
        found = station_interval(torch.from_numpy(noisy.astype(complex))[:, None], Choices())
        off.append(complex(found.bias[0]).real)
        middles.append(0.5 * (complex(found.low[0]) + complex(found.high[0])).real)
    second_order = 0.5 * 4 / (1 - 0.5) ** 3 * 0.15**2
    assert np.mean(off) == pytest.approx(second_order, rel=0.5)  # and higher orders
    assert abs(np.mean(middles) - true) < 0.5 * np.mean(off)


def test_no_interval_from_three_segments(onera):
    found = educed([station(0, seconds=0.085)], onera)
    assert int(found.segments[0]) == 3
    assert found.interval is None
    assert found.average.interval is None
    assert any("no error bars: a station has 3 segments" in note for note in found.notes)


def test_the_interval_of_the_line_is_that_of_independent_stations(onera):
    """Alike stations: the standard error of the mean is a station's over the root of their number,
    within a third (each is itself estimated from 19 segments)."""
    found = educed([station(seed) for seed in range(16)], onera, draws=2000)
    single = found.interval.standard_error[:, 0].real.square().mean().sqrt()
    whole = float(found.average.interval.standard_error[0].real)
    assert whole == pytest.approx(float(single) / 4, rel=0.33)
    assert float(found.average.interval.runs[0]) > 5 * float(found.interval.runs[:, 0].mean())


def test_equal_records_are_drawn_apart(onera):
    """Two stations with the same bursts are two measurements: errors add as if independent."""
    record = station(0)
    again = dataclasses.replace(record, x=0.3, title="again")
    found = educed([record, again], onera, draws=4000)
    ratio = found.average.interval.standard_error[0].real
    ratio = float(ratio / found.interval.standard_error[0, 0].real)
    assert ratio == pytest.approx(2**-0.5, rel=0.12)  # Student's factor differs a little


def test_the_tone_is_put_back(onera):
    """At 10 kHz linear interpolation leaves 0.72 of 1500 Hz; the corrected amplitude is right."""
    record = station(2, rate=10e3, tone=2.0, rms=0.3, seconds=1.0)
    plain, mended = (
        educed([record], onera, correction=how, segment=0.1) for how in ("none", "tone")
    )
    assert float(plain.attenuation[0, 0].abs()) == pytest.approx(0.72, abs=0.02)
    assert float(plain.velocity_level[0, 0]) == pytest.approx(1.44, abs=0.06)
    assert float(mended.velocity_level[0, 0]) == pytest.approx(2.0, abs=0.03)
    assert not bool(plain.corrected[0, 0])
    assert bool(mended.corrected[0, 0])
    assert any("it is not corrected there" in note for note in plain.notes)
    assert any("the tone is corrected" in note for note in mended.notes)
    true = complex(*_true_impedance(onera, record, 2.0))
    errors = [abs(complex(each.impedance[0, 0]) - true) for each in (plain, mended)]
    assert errors[1] < 0.4 * errors[0]


def _true_impedance(liner, record, tone):
    times = np.arange(60_000) / 60e3
    generator = np.random.default_rng(2)
    generator.exponential(1.0, int(1.3 * 10e3) + 50)
    velocity = noise(times, generator, 0.3) + tone * np.cos(2 * np.pi * FREQUENCY * times + 0.3)
    plane = tl.VelocityPlane(velocity[None], sampling_rate=60e3, frequency=FREQUENCY)
    found = tl.educe(plane, liner, interval=None).impedance[0, 0]
    return float(found.real), float(found.imag)


def test_only_the_tone_is_corrected(onera):
    found = educed([station(0)], onera, frequency=[1000.0, FREQUENCY])
    assert found.corrected.tolist() == [[False, True]]
    assert found.reflection.shape[-1] == 2


def drifting(seed: int, seconds: float = 0.6):
    """A tone whose phase wanders, and the loudspeaker's signal that wanders with it."""
    generator = np.random.default_rng(seed)
    clock = np.arange(int(seconds * 40e3)) / 40e3
    wander = np.interp(clock, np.linspace(0, seconds, 13), generator.uniform(-9, 9, 13))
    times = np.cumsum(generator.exponential(1 / RATE, int(1.2 * RATE * seconds)))
    times = times[times < clock[-1] - 0.001]
    angle = 2 * np.pi * FREQUENCY * times + np.interp(times, clock, wander)
    velocity = noise(times, generator, 0.4) + 1.5 * np.cos(angle + 0.9)
    loud = 3.0 * np.cos(2 * np.pi * FREQUENCY * clock + wander)
    record = tl.BurstRecord(times, wall_normal=velocity, x=0.0, y=1e-3, z=0.0, frequency=FREQUENCY,
                            title="wanders")  # fmt: skip
    return record, tl.ReferenceChannel(loud, 40e3)


def test_a_reference_sees_a_tone_that_wanders(onera):
    """Coherence with a steady tone is lost, that with the loudspeaker is not; v comes out with its
    amplitude and its lead over the reference (pi on top: v into the liner is -v)."""
    record, channel = drifting(1)
    plain = educed([record], onera, correction="none", segment=0.05)
    referred = educed([record], onera, correction="none", reference=channel, segment=0.05)
    assert float(referred.coherence[0, 0]) > 0.8
    assert float(plain.velocity_level[0, 0]) < 0.7 * float(referred.velocity_level[0, 0])
    lead = complex(referred.velocity_amplitude[0, 0] * -1)
    assert np.angle(lead) == pytest.approx(0.9, abs=0.05)


def test_a_given_phase_comes_from_the_reference(onera):
    """x in phase with the loudspeaker: a wandering tone gives what a steady one gives with psi."""
    steady = station(0, rms=0.2, phase=0.9, seconds=0.6)
    clock = np.arange(26_000) / 40e3
    loud = tl.ReferenceChannel(np.cos(2 * np.pi * FREQUENCY * clock), 40e3)
    by_hand = educed([steady], onera, phase="given", reference_phase=0.4)
    referred = educed([steady], onera, phase="given", reference_phase=0.4, reference=loud)
    assert float((by_hand.reflection - referred.reflection).abs().max()) < 1e-3
    other = educed([steady], onera, phase="given", reference_phase=1.4)
    assert float((by_hand.impedance - other.impedance).abs().max()) > 0.05


def test_self_consistent_with_a_reference_takes_the_part_that_follows_it(onera):
    """For a steady tone the reference changes nothing but noise."""
    steady = station(0, rms=0.3, seconds=0.6)
    clock = np.arange(26_000) / 40e3
    loud = tl.ReferenceChannel(np.cos(2 * np.pi * FREQUENCY * clock + 1.7), 40e3)
    alone = educed([steady], onera, phase="self-consistent")
    referred = educed([steady], onera, phase="self-consistent", reference=[loud])
    assert float((alone.impedance - referred.impedance).abs().max()) < 0.01
    assert float(referred.phase_held.min()) == 1.0


def test_the_wall_filter_counts_silent_stations_as_wall(onera):
    """Admittance 0 in (5.2): one silent station of two doubles Z."""
    loud, silent = station(0, rms=0.2), station(1, tone=0.0, rms=0.2)
    alone = educed([loud], onera)
    both = educed([loud, silent], onera, wall_filter=0.5)
    assert both.wall.tolist() == [[False], [True]]
    wanted = 2 * complex(alone.average.impedance[0])
    assert complex(both.average.impedance[0]) == pytest.approx(wanted, rel=1e-12)
    assert any("1 of 2 stations have a squared coherence below 0.5" in n for n in both.notes)


def test_flagged_stations_are_never_used_in_silence(onera):
    """Excluded from the average by default, used or refused if asked."""
    good, bad = station(0), station(1)
    spoilt = bad.wall_normal.clone()
    spoilt[::3] = 0.0
    bad = tl.BurstRecord(
        bad.arrival_time, wall_normal=spoilt, x=0.01, y=1e-3, z=0.0, frequency=FREQUENCY,
        title="zeros", name="zeros.txt",
    )  # fmt: skip
    found = educed([good, bad], onera)
    assert found.used.tolist() == [True, False]
    assert found.average.stations == 1
    assert "33 % of wall_normal are exactly 0" in found.flags[1][0]
    assert any("1 of 2 stations are flagged and do not count in the averages: zeros" in note
               for note in found.notes)  # fmt: skip
    alone = educed([good], onera)
    assert torch.equal(found.average.impedance, alone.average.impedance)
    used = educed([good, bad], onera, flagged="use")
    assert used.average.stations == 2
    with pytest.raises(ValueError, match=r"zeros\.txt is flagged: 33 % .*flagged='exclude'"):
        educed([good, bad], onera, flagged="refuse")
    with pytest.raises(ValueError, match="no station counts: all are flagged"):
        educed([bad], onera)


def test_stations_of_unequal_length_share_a_line(onera):
    found = educed([station(0), station(1, seconds=0.2)], onera)
    assert found.segments.tolist() == [18, 8]
    assert torch.isnan(found.reflection[1, 8:].real).all()
    assert torch.isfinite(found.impedance.real).all()
    wanted = (1 / found.segment_impedance[1, :8, 0]).mean()
    assert complex(found.admittance[1, 0]) == pytest.approx(complex(wanted))


def test_moments_are_weighted_by_transit_time(onera):
    record = station(0)
    slow = 1 / (0.5 + record.wall_normal.abs())
    weighed = tl.BurstRecord(
        record.arrival_time, wall_normal=record.wall_normal, transit_time=slow, x=0.0, y=1e-3,
        z=0.0, frequency=FREQUENCY,
    )  # fmt: skip
    found = educed([weighed], onera)
    wanted = tl.burst_moments(tl.validate_bursts(weighed)).components["wall_normal"]
    assert float(found.mean_velocity[0]) == wanted.weighted_mean
    assert float(found.velocity_rms[0]) == wanted.weighted_rms


def test_overlap_and_window_are_free(onera):
    record = station(0)
    apart = educed([record], onera, overlap=0.0)
    close = educed([record], onera, overlap=0.75)
    assert (int(apart.segments[0]), int(close.segments[0])) == (9, 36)
    boxed = educed([record], onera, window="boxcar")
    assert float((boxed.impedance - apart.impedance).abs().max()) < 0.05
    starts = close.segment_start[0].diff()
    assert float((starts - 0.01).abs().max()) < 1e-4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"segment": 0.3}, r"s0: \d+ bursts over 0\.399.* s; two segments of 0\.3 s with an "
                           r"overlap of 0\.5 take 0\.45 s.*shorten the segment"),
        ({"overlap": 1.0}, "overlap is 1; it is a share of a segment"),
        ({"overlap": -0.1}, "overlap is -0.1"),
        ({"segment": 0.0}, r"segment \(s\) is 0; it must be finite and above 0"),
        ({"method": "cubic"}, "unknown method 'cubic'"),
        ({"correction": "tones"}, "unknown correction 'tones' .did you mean 'tone'"),
        ({"band_limit": 900.0}, "band_limit is for method 'band-limited', not 'linear'"),
        ({"monte_carlo": 1}, "monte_carlo is 1; it is 2 to"),
        ({"frequency": 11e3}, r"s0: .* arrivals a second .* fewer than two a period of 11000 Hz"),
        ({"incident": "noise:300:3000"}, "educed for tones; leave incident out"),
        ({"phase": "given"}, "phase='given' needs a reference channel, or reference_phase"),
        ({"phase": "averaged", "reference_phase": 1.0}, "reference_phase is only used with"),
        ({"phase": "given", "reference_phase": [1.0, 2.0]}, "holds 2 values for 1 stations"),
        ({"reference": [None, None]}, "2 reference channels for 1 stations"),
    ],
)  # fmt: skip
def test_faulty_choices_are_refused(onera, change, message):
    with pytest.raises((ValueError, TypeError), match=message):
        educed([station(0)], onera, **change)


def test_faulty_stations_are_refused(onera):
    good = station(0)
    keep = (good.arrival_time < 0.1) | (good.arrival_time > 0.2)
    torn = tl.BurstRecord(good.arrival_time[keep], wall_normal=good.wall_normal[keep], x=0.0,
                          y=0.0, z=0.0, frequency=FREQUENCY, name="torn.txt")  # fmt: skip
    with pytest.raises(ValueError, match=r"torn\.txt: no burst for 0\.1\d* s from .* longer than a "
                       r"segment of 0\.04 s.*cut the record"):  # fmt: skip
        educed([torn], onera, flagged="use")
    only_u = tl.BurstRecord(good.arrival_time, streamwise=good.wall_normal, name="u.txt")
    with pytest.raises(ValueError, match=r"u\.txt holds no wall-normal velocity"):
        educed([only_u], onera, frequency=FREQUENCY)
    silent = tl.BurstRecord(good.arrival_time, wall_normal=good.wall_normal, name="n.txt")
    with pytest.raises(ValueError, match=r"n\.txt states no frequency"):
        educed([silent], onera)
    with pytest.raises(ValueError, match="no station is given"):
        educed([], onera)
    with pytest.raises(TypeError, match="a station is int; make a BurstRecord"):
        educed([3], onera)
    with pytest.raises(TypeError, match="without impedance"):
        educed([good], "onera")
    with pytest.raises(ValueError, match=r"s1 has mach 0\.3, s0 None; the stations of a line"):
        educed([good, station(1, mach=0.3)], onera)
    sparse = station(3, rate=2500.0)
    with pytest.raises(ValueError, match=r"s3: .* fewer than two a period of 1500 Hz"):
        educed([sparse], onera, flagged="use")


def test_a_tone_that_is_lost_is_not_raised_from_noise(onera):
    """Below a factor of 0.3 nothing is corrected unless the user gives up the correction."""
    record = station(0, rate=3300.0, seconds=1.5)
    with pytest.raises(ValueError, match=r"linear reconstruction leaves 0\.\d+ of the tone; a "
                       r"correction would raise noise .*correction='none'"):  # fmt: skip
        educed([record], onera, flagged="use", segment=0.2)
    found = educed([record], onera, flagged="use", segment=0.2, correction="none")
    assert float(found.attenuation.abs().max()) < 0.4


def test_faulty_references_are_refused(onera):
    good = station(0)
    wave = np.cos(np.arange(4000) / 5)
    with pytest.raises(ValueError, match=r"reference runs from 0 to 0\.0999.* s, the velocity from "
                       r".* state start"):  # fmt: skip
        educed([good], onera, reference=tl.ReferenceChannel(wave, 40e3))
    with pytest.raises(ValueError, match="reference is constant, 2; it holds no tone"):
        tl.ReferenceChannel(np.full(10, 2.0), 40e3)
    wave[3] = np.nan
    with pytest.raises(ValueError, match="1 values are nan or inf, the first is sample 3"):
        tl.ReferenceChannel(wave, 40e3)
    with pytest.raises(ValueError, match=r"shape \(2, 5\); one channel"):
        tl.ReferenceChannel(np.random.default_rng(0).normal(size=(2, 5)), 40e3)
    with pytest.raises(ValueError, match=r"sampling_rate \(Hz\) is 0"):
        tl.ReferenceChannel(np.arange(5.0), 0.0)


def test_admittance_at_walls_is_zero_in_the_draws(line):
    wall = torch.tensor([[False], [True], [False]])
    found = segment_admittances(dataclasses.replace(line, wall=wall))
    assert bool((found[1] == 0).all())
    plain = admittance_from_reflection(line.reflection)
    assert torch.equal(torch.nan_to_num(found[0]), torch.nan_to_num(plain[0]))


def test_a_dead_channel_is_flagged(onera):
    record = station(1)
    dead = dataclasses.replace(record, wall_normal=torch.full_like(record.wall_normal, 2.0))
    found = educed([station(0), dead], onera)
    assert found.used.tolist() == [True, False]
    assert found.flags[1] == ("wall_normal is constant, 2 m/s: a dead channel",)


def test_a_tone_that_wanders_past_the_correction_says_so(onera):
    record = station(0)
    away = 1.0 * torch.cos(2 * torch.pi * (FREQUENCY + 3) * record.arrival_time)
    away -= torch.cos(2 * torch.pi * FREQUENCY * record.arrival_time + 0.3)
    found = educed([dataclasses.replace(record, wall_normal=record.wall_normal + away)], onera)
    assert any("the tone of 1500 Hz wanders: over the whole record 0." in note
               for note in found.station_notes[0])  # fmt: skip
    steady = educed([station(0)], onera)
    assert not any("wanders" in note for note in steady.station_notes[0])


def test_references_that_tell_no_phase_say_so(onera):
    """Noise, and another tone: v does not follow; too few samples a period are refused."""
    times = np.arange(26_000) / 40e3
    random = np.random.default_rng(0).standard_normal(len(times))
    for values in (random, np.cos(2 * np.pi * 700 * times)):
        channel = tl.ReferenceChannel(values, 40e3)
        found = educed([station(0)], onera, reference=channel, phase="given", reference_phase=0.0)
        assert any("it tells nothing of the phase of the sound" in note
                   for note in found.station_notes[0])  # fmt: skip
    coarse = tl.ReferenceChannel(np.cos(2 * np.pi * FREQUENCY * np.arange(3000) / 6e3), 6e3)
    with pytest.raises(ValueError, match="reference is sampled at 6000 Hz, less than 8 times"):
        educed([station(0)], onera, reference=coarse)
    with pytest.raises(TypeError, match="a reference is ndarray; make a ReferenceChannel"):
        educed([station(0)], onera, reference=np.zeros(5))


def test_more_that_is_refused(onera):
    with pytest.raises(ValueError, match="a frequency is asked for twice"):
        educed([station(0)], onera, frequency=[FREQUENCY, FREQUENCY])
    with pytest.raises(ValueError, match=r"s0: a grid of 1e\+308 Hz has .* \(limit 3e\+07\)"):
        educed([station(0)], onera, grid_rate=1e308)
    with pytest.raises(ValueError, match="s0 and s5 have the same position"):
        educed([station(0), station(5, x=0.0)], onera)
    about = {"mach": 0.3, "displacement_thickness": 1e-3}
    other = station(1, mach=0.3, displacement_thickness=1e-2)
    with pytest.raises(ValueError, match="s1 has another displacement thickness"):
        educed([station(0, **about), other], onera)


def test_tones_that_are_not_stated_are_corrected_one_at_a_time(onera):
    """Without a stated tone a correction at several frequencies would count neighbours twice."""
    record = station(0, frequency=None)
    assert educed([record], onera, frequency=FREQUENCY).corrected.tolist() == [[True]]
    several = educed([record], onera, frequency=[FREQUENCY - 1, FREQUENCY])
    assert several.corrected.tolist() == [[False, False]]


def test_one_station_has_no_spread_along_the_line(onera):
    assert torch.isnan(educed([station(0)], onera).average.spatial_spread.real).all()
