"""Lines of laser Doppler stations: segments, the tone, warnings and refusals."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

import torchliner as tl

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
    about = {
        "x": 0.01 * seed,
        "y": 1e-3,
        "z": 0.0,
        "frequency": FREQUENCY,
        "title": f"s{seed}",
        "name": f"s{seed}",
    } | about
    return tl.BurstRecord(times, wall_normal=velocity, **about)


def educed(stations, liner, **choices):
    return tl.educe_bursts(stations, liner, **{"segment": SEGMENT, **choices})


@pytest.fixture(scope="module")
def line(onera):
    return educed([station(seed) for seed in range(3)], onera)


@pytest.mark.parametrize("method", ["linear", "hold", "band-limited"])
def test_frozen_velocity_returns_the_model(onera, method):
    """Constant bursts are a constant |v| on any grid, in every segment and average."""
    still = dataclasses.replace(station(1), wall_normal=torch.full_like(station(1).arrival_time, -2.0))
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
        assert float((found.reflection[0, i] - alone.probes["admittance"].reflection[0]).abs()) < 1e-9


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


def test_the_tone_is_put_back(onera):
    """At 10 kHz linear interpolation leaves 0.72 of 1500 Hz; the corrected amplitude is right."""
    record = station(2, rate=10e3, tone=2.0, rms=0.3, seconds=1.0)
    plain, mended = (educed([record], onera, correction=how, segment=0.1) for how in ("none", "tone"))
    assert float(plain.attenuation[0, 0].abs()) == pytest.approx(0.72, abs=0.02)
    assert float(plain.velocity_level[0, 0]) == pytest.approx(1.44, abs=0.06)
    assert float(mended.velocity_level[0, 0]) == pytest.approx(2.0, abs=0.03)
    assert not bool(plain.corrected[0, 0])
    assert bool(mended.corrected[0, 0])
    generator = np.random.default_rng(2)  # of the station's own noise
    generator.exponential(1.0, int(1.3 * 10e3) + 50)
    times = np.arange(60_000) / 60e3
    velocity = noise(times, generator, 0.3) + 2.0 * np.cos(2 * np.pi * FREQUENCY * times + 0.3)
    plane = tl.VelocityPlane(velocity[None], sampling_rate=60e3, frequency=FREQUENCY)
    true = complex(tl.educe(plane, onera, interval=None).impedance[0, 0])
    errors = [abs(complex(each.impedance[0, 0]) - true) for each in (plain, mended)]
    assert errors[1] < 0.4 * errors[0]


def test_the_tone_is_corrected_whatever_is_asked_for(onera):
    """It drives |v| at every frequency: 1000 Hz is the same with and without 1500 Hz beside it."""
    record = station(0, rate=12e3, tone=3.0, rms=0.3)
    alone = educed([record], onera, frequency=1000.0)
    both = educed([record], onera, frequency=[FREQUENCY, 1000.0])
    assert float((alone.reflection[..., 0] - both.reflection[..., 1]).abs().max()) < 1e-12
    assert alone.corrected.tolist() == [[False]]
    as_is = educed([record], onera, frequency=1000.0, correction="none")
    assert float((as_is.impedance - alone.impedance).abs()) > 0.05
    sparse = station(3, rate=2500.0, seconds=1.0)
    low = {"frequency": 500.0, "flagged": "use", "segment": 0.2}
    with pytest.raises(ValueError, match=r"s3: .* period of 1500 Hz, .* .correction='none' leaves a stated tone"):
        educed([sparse], onera, **low)
    assert not bool(educed([sparse], onera, correction="none", **low).corrected)


def test_flagged_stations_are_never_used_in_silence(onera):
    """Excluded from the average by default, used or refused if asked."""
    good, bad = station(0), station(1)
    spoilt = bad.wall_normal.clone()
    spoilt[::3] = 0.0
    bad = dataclasses.replace(bad, wall_normal=spoilt)
    found = educed([good, bad], onera)
    assert found.used.tolist() == [True, False]
    assert found.average.stations == 1
    assert "33 % of wall_normal are exactly 0" in found.flags[1][0]
    alone = educed([good], onera)
    assert torch.equal(found.average.impedance, alone.average.impedance)
    used = educed([good, bad], onera, flagged="use")
    assert used.average.stations == 2
    with pytest.raises(ValueError, match="no station counts: all are flagged"):
        educed([bad], onera)


def test_stations_of_unequal_length_share_a_line(onera):
    found = educed([station(0), station(1, seconds=0.2)], onera)
    assert found.segments.tolist() == [18, 8]
    assert torch.isnan(found.reflection[1, 8:].real).all()
    assert torch.isfinite(found.impedance.real).all()
    wanted = (1 / found.segment_impedance[1, :8, 0]).mean()
    assert complex(found.admittance[1, 0]) == pytest.approx(complex(wanted))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"segment": 0.3}, r"s0: \d+ bursts over 0\.399.* s hold 1 segments of 0\.3 s .*segment"),
        ({"overlap": 1.0}, "overlap is 1; it is a share of a segment"),
        ({"overlap": 0.9999}, r"s0: .* hold \d+ segments of 0\.04 s that overlap by 0\.9999; 2 to 5000"),
        ({"phase": "given", "reference_phase": float("nan")}, "reference_phase holds values that are not finite"),
        ({"background": 1.0}, "background is 1.0; it is for planes"),
        ({"missing": "exclude"}, "missing is 'exclude'; it is for planes"),
        ({"method": "cubic"}, "unknown method 'cubic'"),
        ({"correction": "tones"}, "unknown correction 'tones' .did you mean 'tone'"),
        ({"band_limit": 900.0}, "band_limit is for method 'band-limited', not 'linear'"),
        ({"monte_carlo": 1}, "monte_carlo is 1; it is 2 to"),
        ({"frequency": 11e3}, r"s0: .* arrivals a second .* fewer than two a period of 11000 Hz"),
        ({"phase": "given"}, "phase='given' needs a reference channel, or reference_phase"),
        ({"phase": "averaged", "reference_phase": 1.0}, "reference_phase is only used with"),
        ({"phase": "given", "reference_phase": [1.0, 2.0]}, "2 reference phases for 1 stations"),
        ({"reference": [None, None]}, "2 reference channels for 1 stations"),
    ],
)
def test_faulty_choices_are_refused(onera, change, message):
    with pytest.raises((ValueError, TypeError), match=message):
        educed([station(0)], onera, **change)


def test_faulty_stations_are_refused(onera):
    good, about = station(0), {"mach": 0.3, "displacement_thickness": 1e-3}
    keep = (good.arrival_time < 0.1) | (good.arrival_time > 0.2)
    given = good.arrival_time[keep], good.wall_normal[keep]
    torn = tl.BurstRecord(*given, x=0.0, y=0.0, z=0.0, frequency=FREQUENCY, name="torn.txt")
    only_u = tl.BurstRecord(good.arrival_time, streamwise=good.wall_normal, frequency=FREQUENCY, name="u.txt")
    silent = tl.BurstRecord(good.arrival_time, wall_normal=good.wall_normal, name="n.txt")
    thick = station(1, mach=0.3, displacement_thickness=1e-2)
    rows = [
        ([torn], {"flagged": "use"}, r"torn\.txt: no burst for 0\.1\d* s from .* 0\.04 s.*cut the record"),
        ([only_u], {}, r"u\.txt holds no wall-normal velocity"),
        ([silent], {}, r"n\.txt states no frequency"),
        ([], {}, "no station is given"),
        ([3], {}, "a station is int"),
        ([good, station(1, mach=0.3)], {}, r"s1 has mach 0\.3, s0 None"),
        ([station(0, **about), thick], {}, "s1 has displacement thickness"),
        (
            [good, dataclasses.replace(station(1), frequency=1400.0)],
            {"frequency": FREQUENCY},
            r"s1 has tone \(Hz\) 1400",
        ),
        ([good, station(5, x=0.0)], {}, "s0 and s5 have the same position"),
        ([station(3, rate=2500.0)], {"flagged": "use"}, r"s3: .* fewer than two a period of 1500 Hz"),
        ([good], {"grid_rate": 1e308}, r"s0: a grid of 1e\+308 Hz"),
    ]
    for stations, options, message in rows:
        with pytest.raises((ValueError, TypeError), match=message):
            educed(stations, onera, **options)


def test_a_tone_that_is_lost_is_not_raised_from_noise(onera):
    """Below a factor of 0.3 nothing is corrected unless the user gives up the correction."""
    record = station(0, rate=3300.0, seconds=1.5)
    with pytest.raises(
        ValueError,
        match=r"linear reconstruction leaves 0\.\d+ of the tone, and a "
        r"correction would raise noise .*correction='none'",
    ):
        educed([record], onera, flagged="use", segment=0.2)
    found = educed([record], onera, flagged="use", segment=0.2, correction="none")
    assert float(found.attenuation.abs().max()) < 0.4
