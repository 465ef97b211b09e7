"""Lines of laser Doppler stations: segments, the tone, averages, references, refusals, and the command."""

import dataclasses
import json
import math

import h5py
import numpy as np
import pytest
import torch
from test_burst_files import write_burst_csv

import torchliner as tl
from torchliner.bursts import line as bursts_module
from torchliner.bursts.averages import monte_carlo, station_intervals
from torchliner.bursts.station import segment_means as of_segments
from torchliner.cli.main import main
from torchliner.conversions import admittance_from_reflection
from torchliner.liners.model import LinerModel
from torchliner.velocity.choices import Choices

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")

FREQUENCY, RATE, SEGMENT = 1500.0, 20e3, 0.04


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
    usual = {"x": 0.01 * seed, "y": 1e-3, "z": 0.0, "frequency": FREQUENCY, "title": f"s{seed}", "name": f"s{seed}"}
    return tl.BurstRecord(times, wall_normal=velocity, **usual | about)


def educed(stations, liner, **choices):
    return tl.educe_bursts(stations, liner, **{"segment": SEGMENT, **choices})


@pytest.fixture(scope="module")
def line(onera):
    return educed([station(seed) for seed in range(3)], onera)


@pytest.mark.parametrize("method", ["linear", "hold", "band-limited"])
def test_frozen_velocity_returns_the_model(onera, method):
    still = dataclasses.replace(station(1), wall_normal=torch.full_like(station(1).arrival_time, -2.0))
    found = educed([still], onera, method=method, correction="none", flagged="use")
    wanted = complex(onera.impedance(FREQUENCY, 2.0))
    assert float((found.segment_impedance - wanted).abs().max()) < 1e-8
    assert abs(complex(found.average.impedance[0]) - wanted) < 1e-8
    assert float((found.interval.high - found.interval.low).abs().max()) < 1e-7


@pytest.mark.parametrize("phase", ["averaged", "self-consistent"])
def test_segments_are_as_if_educed_one_by_one(onera, phase):
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
    fast = station(9, tone=8.0, x=0.5)
    other = educed([fast, *(station(seed) for seed in (2, 0, 1))], onera)
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
    assert float(plain.velocity_amplitude[0, 0].abs()) == pytest.approx(1.44, abs=0.06)
    assert float(mended.velocity_amplitude[0, 0].abs()) == pytest.approx(2.0, abs=0.03)
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
        ({"segment": 0.3}, r"s0: \d+ bursts over 0\.399.* s.* hold 1 segments of 0\.3 s .*segment"),
        ({"overlap": 1.0}, "overlap is 1; it is a share of a segment"),
        ({"overlap": 0.9999}, r"s0: .* hold \d+ segments of 0\.04 s that overlap by 0\.9999; 2 to 5000"),
        ({"background": 1.0}, "background is only used with|background is 1.0; it is for planes"),
        ({"missing": "exclude"}, "missing is 'exclude'; it is for planes"),
        ({"method": "cubic"}, "unknown method 'cubic'"),
        ({"monte_carlo": 1}, "monte_carlo is 1; it is 2 to"),
        ({"frequency": 11e3}, r"s0: .* arrivals a second .* fewer than two a period of 11000 Hz"),
        ({"phase": "given"}, "phase is 'given'; stations share no clock"),
    ],
)
def test_faulty_choices_are_refused(onera, change, message):
    with pytest.raises((ValueError, TypeError), match=message):
        educed([station(0)], onera, **change)


def test_faulty_stations_are_refused(onera):
    good = station(0)
    keep = (good.arrival_time < 0.1) | (good.arrival_time > 0.2)
    given = good.arrival_time[keep], good.wall_normal[keep]
    torn = tl.BurstRecord(*given, x=0.0, y=0.0, z=0.0, frequency=FREQUENCY, name="torn.txt")
    only_u = tl.BurstRecord(good.arrival_time, streamwise=good.wall_normal, frequency=FREQUENCY, name="u.txt")
    silent = tl.BurstRecord(good.arrival_time, wall_normal=good.wall_normal, name="n.txt")
    rows = [
        ([torn], {"flagged": "use"}, r"torn\.txt: .* with a gap of 0\.1\d* s, hold .*cut the record"),
        ([only_u], {}, r"u\.txt holds no wall-normal velocity"),
        ([silent], {}, r"n\.txt states no frequency"),
        ([], {}, r"stations are \[\]; a file or folder"),
        ([good, station(1, mach=0.3)], {}, r"s1 has mach 0\.3, others None"),
        ([good, station(1, frequency=1400.0)], {"frequency": FREQUENCY}, r"s1 has tone \(Hz\) 1400"),
        ([station(3, rate=2500.0)], {"flagged": "use"}, r"s3: .* fewer than two a period of 1500 Hz"),
        ([good], {"grid_rate": 1e308}, r"s0: a grid of 1e\+308 Hz"),
    ]
    for stations, options, message in rows:
        with pytest.raises((ValueError, TypeError), match=message):
            educed(stations, onera, **options)


def test_a_tone_that_is_lost_is_not_raised_from_noise(onera):
    record = station(0, rate=3300.0, seconds=1.5)
    with pytest.raises(ValueError, match=r"linear reconstruction leaves 0\.\d+ of the tone.*correction='none'"):
        educed([record], onera, flagged="use", segment=0.2)
    found = educed([record], onera, flagged="use", segment=0.2, correction="none")
    assert float(found.attenuation.abs().max()) < 0.4


def test_monte_carlo_is_the_closed_form_and_its_spread_too(line):
    """Means within four standard errors of the draws; the spread within four per cent."""
    admittance, counts = admittance_from_reflection(line.reflection), line.segments
    draws = 20_000
    drawn = monte_carlo(admittance, counts, draws, seed=1)[:, 0]
    segments = [own[:count, 0].numpy() for own, count in zip(admittance, counts, strict=True)]
    off = complex(drawn.mean()) - complex(line.admittance.mean())
    for part in ("real", "imag"):
        spread = math.sqrt(sum(getattr(each, part).var() for each in segments)) / len(segments)  # of (5.2)
        assert abs(getattr(off, part)) < 4 * spread / math.sqrt(draws)
        assert float(getattr(drawn, part).std()) == pytest.approx(spread, rel=0.04)


def segment_means(generator: np.random.Generator, segments: int) -> np.ndarray:
    """Complex means of white noise under Hann windows that overlap by half."""
    length = 64
    white = generator.standard_normal(((segments + 1) * length // 2, 2)) @ [1, 1j]
    window = np.hanning(length + 1)[:-1]
    pieces = np.lib.stride_tricks.sliding_window_view(white, length)[:: length // 2]
    return pieces @ window / window.sum()


def test_intervals_cover_with_overlapping_segments():
    """19 segments, as of 10 s: 95 % hold R and X in 95 % of 600 trials, within three standard errors (2.7 %)."""
    generator = np.random.default_rng(0)
    trials = np.stack([segment_means(generator, 19) for _ in range(600)], axis=1)
    found = station_intervals(torch.from_numpy(0.3 + 0.1j + 0.02 * trials)[None], torch.tensor([19]), 0.95)
    true = (1 + (0.3 + 0.1j)) / (1 - (0.3 + 0.1j))
    low, high = found.low.numpy(), found.high.numpy()
    for part in (np.real, np.imag):
        inside = (part(low) <= part(true)) & (part(true) <= part(high))
        assert abs(inside.mean() - 0.95) < 0.027


def test_an_average_of_many_stations_scatters_less(onera):
    """Four stations that are one: a standard error of half its own, of as small a scatter."""
    one = educed([station(1, tone=3.0, rms=0.3)], onera)
    four = educed([station(1, tone=3.0, rms=0.3, x=0.01 * i, title=f"s{i}") for i in range(4)], onera)
    ratio = four.average.interval.standard_error / one.average.interval.standard_error.real
    assert float(ratio.real) == pytest.approx(0.5, rel=0.01)


class Flat(LinerModel):
    """The same at every frequency."""

    def impedance(self, frequency, speed=0.0):
        return 0.5 - 0.3j + torch.as_tensor(speed) + 0 * torch.as_tensor(frequency)


@pytest.mark.parametrize("window", ["hann", "whole-periods"])
def test_a_constant_reflection_has_nothing_at_twice_the_tone(window):
    """<R e^{-2jwt}> less what the mean leaves, over 2.4 periods of |v| = 2 m/s."""
    sign = torch.randn(3, 100, generator=torch.Generator().manual_seed(0), dtype=torch.float64).sign()
    plane = tl.VelocityPlane(2 * sign, sampling_rate=60e3, frequency=1430.0)
    choices = Choices(averaging="admittance", phase="self-consistent", allow_short=True)
    frequency = torch.tensor([1430.0], dtype=torch.float64)
    a, b, *_ = of_segments(plane, Flat(), frequency, choices, window)
    assert float(b.abs().max()) < 1e-9
    assert float((a - (2.5 - 0.3j - 1) / (2.5 - 0.3j + 1)).abs().max()) < 1e-9


def test_the_bias_of_short_segments_is_taken_off_the_bounds():
    """The mean of Z over noisy segments is off by Z'' var/2; the bounds sit about the true Z."""
    generator = np.random.default_rng(1)
    true = (1 + 0.5) / (1 - 0.5)
    noisy = 0.5 + 0.15 * generator.standard_normal((300, 40)).T
    found = station_intervals(torch.from_numpy(noisy.astype(complex))[None], torch.tensor([40]), 0.95)
    off, middle = float(found.bias.real.mean()), float(0.5 * (found.low + found.high).real.mean())
    assert off == pytest.approx(0.5 * 4 / (1 - 0.5) ** 3 * 0.15**2, rel=0.5)  # second order, and higher ones
    assert abs(middle - true) < 0.5 * off


def test_the_paper_is_one_call(onera):
    """Straight lines, Hann's segments that overlap by half, replayed sample by sample in a second engine; mean of Z
    over segments, mean of admittances over stations, and the draws about it."""
    records = [station(seed, seconds=0.3) for seed in range(3)]
    found = educed(records, onera, correction="none", window="hann", flagged="use", grid_rate=60e3)
    means, admittances = [], []
    for n, record in enumerate(records):
        times = record.arrival_time.numpy()
        grid = np.arange(times[0], times[-1], 1 / 60e3)
        velocity = np.interp(grid, times, record.wall_normal.numpy())
        pieces = [velocity[i : i + 2400] for i in range(0, len(velocity) - 2399, 1200)]
        plane = tl.VelocityPlane(np.stack(pieces), sampling_rate=60e3, frequency=FREQUENCY)
        replayed = tl.replay(plane, onera, FREQUENCY, window="hann", interval=None)
        own = replayed.probes["admittance"].reflection[:, 0]
        assert found.segments[n] == len(pieces)
        assert float((own - found.reflection[n, : len(pieces), 0]).abs().max()) < 5e-5  # kernels end
        z = (1 + found.reflection[n, : len(pieces), 0]) / (1 - found.reflection[n, : len(pieces), 0])
        assert float(found.segment_spread[n, 0].real) == pytest.approx(float(z.real.std()))
        means.append(complex(z.mean()))
        admittances.append(complex((1 / z).mean()))
    assert found.impedance[:, 0].tolist() == pytest.approx(means, rel=1e-12)
    average = found.average
    assert float(average.spatial_spread[0].imag) == pytest.approx(np.imag(means).std(ddof=1))
    assert complex(average.impedance[0]) == pytest.approx(1 / np.mean(admittances), rel=1e-12)
    off, spread = complex(average.monte_carlo[0] - average.impedance[0]), complex(average.monte_carlo_spread[0])
    assert abs(off.real) < 4 * spread.real / math.sqrt(5000)
    assert abs(off.imag) < 4 * spread.imag / math.sqrt(5000)


SHORT = ["--segment", "0.04", "--liner", "onera"]


def write_folder(place, stations):
    place.mkdir()
    for seed in range(stations):
        write_burst_csv(station(seed, seconds=0.2), place / f"p{seed}.csv")
    return place


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("bursts") / "line", 3)


@pytest.fixture(scope="module")
def known(folder):
    return tl.educe_bursts(folder, tl.load_liner("onera"), segment=0.04)


def run(*words):
    return main(["ldv", "educe", *[str(word) for word in words], *SHORT])


def test_one_command_from_files_to_numbers(folder, known, tmp_path, capsys):
    out = tmp_path / "line.h5"
    assert run(folder, "-o", out, "--figure", tmp_path / "line.png", "--json", "--quiet") == 0
    found = json.loads(capsys.readouterr().out)
    line = tl.read_line(out)
    assert torch.equal(line.impedance, known.impedance)
    row = found["rows"][0]
    assert row["impedance"]["resistance"] == float(known.average.impedance[0].real)
    assert row["spread"]["reactance"] == float(known.average.spatial_spread[0].imag)
    assert [row["station"] for row in found["stations"]] == ["s0", "s1", "s2"]
    assert found["stations"][2]["x"] == 0.02
    assert (tmp_path / "line.png").stat().st_size > 5000
    assert not (tmp_path / "line.h5.parts").exists()
    assert run(folder, "-o", tmp_path / "line.csv", "--quiet") == 0
    rows = (tmp_path / "line.csv").read_text().splitlines()
    assert len(rows) == 4
    assert "segment_spread_resistance" in rows[0]
    assert "resistance_low" in rows[0]


def counted(monkeypatch, fail_at=None):
    real, seen = bursts_module.educe_station, []

    def educe_station(record, *arguments):
        if len(seen) == fail_at:
            raise KeyboardInterrupt
        seen.append(record.title)
        return real(record, *arguments)

    monkeypatch.setattr(bursts_module, "educe_station", educe_station)
    return seen


def test_a_broken_run_goes_on_where_it_stopped(folder, known, tmp_path, monkeypatch, capsys):
    out = tmp_path / "line.h5"
    counted(monkeypatch, fail_at=2)
    assert run(folder, "-o", out, "--quiet") == 130
    assert "interrupted" in capsys.readouterr().err
    assert len(list((tmp_path / "line.h5.parts").glob("*.h5"))) == 2
    assert not out.exists()
    monkeypatch.undo()
    seen = counted(monkeypatch)
    assert run(folder, "-o", out) == 0
    assert "holds 2 finished stations" in capsys.readouterr().err
    assert seen == ["s2"]
    assert torch.equal(tl.read_line(out).reflection, known.reflection)
    assert not (tmp_path / "line.h5.parts").exists()


def test_parts_of_other_data_or_choices_are_not_taken_up(tmp_path, monkeypatch):
    folder = write_folder(tmp_path / "line", 1)
    parts, liner = tmp_path / "parts", tl.load_liner("onera")
    seen = counted(monkeypatch)

    def educe(source=folder, **choices):
        """Titles of the stations that were educed anew."""
        seen.clear()
        tl.educe_bursts(source, choices.pop("liner", liner), parts=parts, **{"segment": 0.04, **choices})
        return list(seen)

    assert [educe(), educe()] == [["s0"], []]
    for choices in (
        {"phase": "self-consistent"},
        {"segment": 0.05},
        {"liner": tl.load_liner("polito")},
        {"without": ["outliers"]},
    ):
        assert educe(**choices) == ["s0"], choices
    write_burst_csv(station(1, seconds=0.2), folder / "p1.csv")
    assert educe() == ["s1"]
    write_burst_csv(station(7, seconds=0.2, x=0.01), folder / "p1.csv")
    assert educe() == ["s7"]
    records = [station(seed, seconds=0.2) for seed in range(2)]
    assert educe(records) == ["s0", "s1"]
    assert educe(records) == []


def test_parts_that_are_damaged_or_none_are_made_anew(tmp_path, monkeypatch):
    folder, parts, liner = write_folder(tmp_path / "line", 2), tmp_path / "parts", tl.load_liner("onera")
    wanted = tl.educe_bursts(folder, liner, parts=parts, segment=0.04).reflection
    first, _ = sorted(parts.iterdir())
    whole, seen = first.read_bytes(), counted(monkeypatch)
    for count, damaged in enumerate((whole[:2000], whole), 1):
        first.write_bytes(damaged)
        if damaged is whole:
            with h5py.File(first, "r+") as file:
                del file["grid_rate"]
        assert torch.equal(tl.educe_bursts(folder, liner, parts=parts, segment=0.04).reflection, wanted)
        assert len(seen) == count
