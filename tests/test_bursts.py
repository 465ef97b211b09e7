"""Bursts: moments, validation, flags, and how random samples come onto a grid."""

import csv
import json
import math

import numpy as np
import pytest
import torch
from conftest import SHARED
from scipy.signal import lombscargle

import torchliner as tl
from torchliner.bursts.arrivals import corrected_coherent_part, onto_grid, tone_attenuation
from torchliner.bursts.stations import BACKWARDS, OUTLIER, REPEATED, Station, burst_moments, validate_bursts
from torchliner.cli.main import main
from torchliner.io.burst_sources import read_bursts
from torchliner.names import GRID_METHODS

REAL = SHARED / "data" / "lda_bursts"
LAYOUT = "row, arrival_time [ms], transit_time [us], streamwise [m/s], wall_normal [m/s]"
real_data = pytest.mark.skipif(not REAL.exists(), reason="the real bursts are not here")


def poisson_times(count: int, rate: float = 1000.0, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).exponential(1 / rate, count).cumsum()


def gaussian_record(count: int = 2000, seed: int = 1, **about) -> tl.BurstRecord:
    rng = np.random.default_rng(seed)
    about.setdefault("wall_normal", rng.normal(0.1, 0.5, count))
    about.setdefault("transit_time", rng.uniform(1e-5, 5e-5, count))
    return tl.BurstRecord(poisson_times(count), **about)


def test_transit_times_undo_the_velocity_bias():
    """Particles come in proportion to u and stay for d/u: weighted, the flow's own moments."""
    rng = np.random.default_rng(2)
    flow = rng.gamma(9.0, 1.0 / 3, 400_000)  # u > 0, mean 3, variance 1
    seen = flow[rng.random(flow.size) < flow / flow.max()]  # arrival in proportion to u
    record = tl.BurstRecord(poisson_times(seen.size), streamwise=seen, transit_time=1e-4 / seen)
    found = burst_moments(record).components["streamwise"]
    # Arithmetic: <u^2>/<u> = mean + variance/mean.
    assert found.mean == pytest.approx(3 + 1 / 3, abs=0.015)
    assert found.weighted_mean == pytest.approx(3.0, abs=0.015)
    assert found.weighted_rms == pytest.approx(1.0, abs=0.01)


def test_a_poisson_process_is_as_irregular_as_it_can_be():
    seen = burst_moments(gaussian_record(40_000, wall_normal=np.zeros(40_000)))
    assert seen.irregularity == pytest.approx(1, abs=0.02)
    assert seen.rate == pytest.approx(1000, rel=0.02)


def test_times_that_repeat_or_step_back_are_dropped_and_counted():
    """Of equal times the first stays; after a step back all until the old time is passed."""
    time = np.array([0.0, 1.0, 1.0, 3.0, 2.0, 2.5, 4.0])
    record = tl.BurstRecord(time, np.arange(7.0))
    kept = validate_bursts(record, ["outliers"])
    assert kept.dropped == {BACKWARDS: 2, REPEATED: 1}
    assert kept.arrival_time.tolist() == [0, 1, 3, 4]
    assert kept.wall_normal.tolist() == [0, 1, 3, 6]
    assert kept.received == 7
    assert validate_bursts(record, ["times"]).bursts == 7


def test_outliers_of_either_component_are_dropped():
    record = gaussian_record(3000)
    v = record.wall_normal.clone()
    v[[5, 70]] = torch.tensor([30.0, -8.0]).double()
    u = torch.full_like(v, 10.0) + v / 3
    u[9] = -50.0
    dirty = tl.BurstRecord(record.arrival_time, v, u, record.transit_time)
    kept = validate_bursts(dirty)
    assert kept.dropped == {OUTLIER: 3}
    assert float(kept.wall_normal.abs().max()) < 4
    assert validate_bursts(dirty, ["outliers"]).bursts == 3000


def test_each_fault_is_flagged():
    rng = np.random.default_rng(5)
    v, time = rng.normal(0, 1, 2000), poisson_times(2000)
    zeros = np.where(rng.random(2000) < 0.4, 0.0, v)
    for record, words in (
        (gaussian_record(wall_normal=zeros), "40 % of wall_normal are exactly 0"),
        (gaussian_record(wall_normal=np.round(v)), "rounding alone is 8 %"),
        (gaussian_record(frequency=1000.0), "0.99 bursts a period of 1000 Hz"),
        (tl.BurstRecord(time + 0.1 * (np.arange(2000) >= 1000), v), "a gap of 10"),
        (tl.BurstRecord(time, v, dropped={"before": 500}), "20 % of the bursts dropped"),
    ):
        assert words in str(Station.of(record).flags)


@real_data
@pytest.mark.parametrize("folder", ["FX01G00", "FX03G00"])
def test_stations_near_the_wall_are_flagged(folder):
    """Up to 95 % of v is exactly 0 at the two stations nearest to the wall."""
    records = read_bursts(REAL / folder, columns=LAYOUT)
    assert [record.bursts for record in records] == [2000] * 15
    stations = [*map(Station.of, records)]
    assert [bool(station.flags) for station in stations] == [True] * 2 + [False] * 13
    assert all("exactly 0" in station.flags[0] for station in stations[:2])
    for station in stations[2:]:
        assert 0.85 < station.moments.irregularity < 1.1
        # Fast particles are seen more often: the arithmetic mean of u is never the lower one.
        assert station.moments.components["streamwise"].velocity_bias > -0.001


def test_the_command_tells_good_from_flagged(tmp_path, capsys):
    folder = tmp_path / "line"
    folder.mkdir()
    for i in range(3):
        gaussian_record(seed=i, x=0.01 * (2 - i), y=1e-3, z=0.0).write(folder / f"s{i}.h5")
    table = tmp_path / "t.csv"
    assert main(["ldv", "info", str(folder), "-o", str(table)]) == 0
    capsys.readouterr()
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [(row["station"], float(row["x"])) for row in rows] == [("s2", 0.0), ("s1", 0.01), ("s0", 0.02)]
    zeros = np.where(np.arange(2000) % 3 == 0, 0.0, 1.0 + np.sin(np.arange(2000)))
    gaussian_record(wall_normal=zeros, x=0.5, y=1e-3, z=0.0).write(folder / "s9.h5")
    assert main(["ldv", "info", str(folder), "--json"]) == 1
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [len(row["flags"]) for row in rows] == [0, 0, 0, 1]
    assert rows[3]["v mean (m/s)"] > 0


FREQUENCY, RATE = 1500.0, 15e3
quiet = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def poisson(rate: float, seconds: float, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    steps = torch.empty(int(1.2 * rate * seconds) + 20, dtype=torch.float64)
    times = steps.exponential_(rate, generator=generator).cumsum(0)
    return times[times < seconds]


def poisson_attenuation(rate, method="linear"):
    """Mean factor on the tone of Poisson arrivals, x = omega/rate; derived in scripts/ldv_interpolation.py."""
    x = 2 * math.pi * FREQUENCY / rate
    return math.log1p(x**2) / x**2 if method == "linear" else 1 / (1 + 1j * x)


def normal(count: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(10_000 + seed)  # not that of the arrivals
    return torch.randn(count, generator=generator, dtype=torch.float64)


def tone(times: torch.Tensor, amplitude: complex, frequency: float = FREQUENCY) -> torch.Tensor:
    """A e^{j omega t} + A* e^{-j omega t}."""
    turns = 2 * math.pi * frequency * times
    return 2 * (amplitude.real * turns.cos() - amplitude.imag * turns.sin())


def test_band_limited_fit_keeps_what_lies_in_its_band():
    """A tone at a quarter of the band: to the penalty's 5e-4 if uniform, ten times better than lines if random."""
    errors = {}
    uniform = torch.arange(3000, dtype=torch.float64) / RATE
    for kind, times in (("uniform", uniform), ("random", poisson(RATE, 0.2))):
        for method in GRID_METHODS:
            found = onto_grid(times, tone(times, 0.5, RATE / 16), 40e3, method)
            miss = found.values - tone(found.times, 0.5, RATE / 16)
            errors[kind, method] = float(miss[200:-200].square().mean().sqrt())
    assert errors["uniform", "band-limited"] < 5e-4
    assert errors["random", "band-limited"] < 0.1 * errors["random", "linear"]
    assert errors["random", "linear"] < errors["random", "hold"]


@pytest.mark.parametrize("method", ["linear", "band-limited"])
def test_straight_lines_are_kept(method):
    times = poisson(RATE, 0.05)
    found = onto_grid(times, 3.0 - 40.0 * times, 31e3, method)
    assert float((found.values - 3.0 + 40.0 * found.times).abs().max()) < 1e-10


def test_linear_is_numpys():
    times = poisson(RATE, 0.05)
    found = onto_grid(times, normal(len(times)), 31e3)
    wanted = np.interp(found.times.numpy(), times.numpy(), normal(len(times)).numpy())
    assert found.values.numpy() == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("method", ["linear", "hold"])
@pytest.mark.parametrize("rate", [6e3, 15e3, 40e3])
@quiet
def test_actual_arrivals_average_to_the_closed_form(method, rate):
    factors = []
    for seed in range(80):
        times = poisson(rate, 0.05, seed)
        found = tone_attenuation(onto_grid(times, times, 60e3, method), FREQUENCY, "boxcar")
        factors.append(complex(found.factor[0]))
    closed = complex(poisson_attenuation(rate, method))
    for drawn, wanted in ((np.real(factors), closed.real), (np.imag(factors), closed.imag)):
        error = drawn.std(ddof=1) / math.sqrt(len(drawn))
        assert abs(drawn.mean() - wanted) < 4 * error + 1e-9
        assert error < 0.01


@pytest.mark.parametrize("method", GRID_METHODS)
@pytest.mark.parametrize("window", ["hann", "boxcar"])
@quiet
def test_factor_and_image_say_what_becomes_of_any_tone(method, window):
    """A tone of any phase and a mean, over 75.4 periods: A comes back to rounding."""
    times = poisson(RATE, 75.4 / FREQUENCY)
    amplitude = 0.8 - 0.3j
    found = onto_grid(times, 2.5 + tone(times, amplitude), 47e3, method)
    factors = tone_attenuation(found, FREQUENCY, window=window)
    phase = np.exp(2j * np.pi * FREQUENCY * found.start)
    line = factors.line(found)
    assert complex(factors.true_amplitude(line)[0]) == pytest.approx(amplitude * phase, abs=1e-12)
    again = factors.line(corrected_coherent_part(found, factors))
    assert complex(again[0]) == pytest.approx(amplitude * phase, abs=1e-12)
    limit = 0.1 if method != GRID_METHODS[2] else 1e-3
    assert abs(complex(line[0]) - amplitude * phase) > limit


@quiet
def test_corrected_line_is_lomb_and_scargles():
    """Without noise both are A; lombscargle sees the arrivals alone, and no grid."""
    times = poisson(RATE, 0.1)
    signal = tone(times, 0.7 - 0.2j) + 1.0
    found = onto_grid(times, signal, 30e3)
    factors = tone_attenuation(found, FREQUENCY)
    back = factors.true_amplitude(factors.line(found))
    seen = lombscargle(
        times.numpy(), signal.numpy(), [2 * np.pi * FREQUENCY], floating_mean=True, normalize="amplitude"
    )
    assert abs(complex(back[0])) == pytest.approx(abs(complex(seen)) / 2, rel=1e-9)


TIMES = torch.arange(100, dtype=torch.float64) / 10e3
ZEROS = torch.zeros(100)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: onto_grid([0.0, 2.0, 1.0], [1.0, 1.0, 1.0]), "1 times do not increase, first after 2 s"),
        (lambda: onto_grid([0.0], [1.0]), "two finite samples at least"),
        (lambda: onto_grid(TIMES, ZEROS, 0.0), "rate of the grid .* is 0"),
        (lambda: onto_grid(TIMES, ZEROS, 50.0), r"has 1\.\d+ points"),
        (lambda: onto_grid(TIMES, ZEROS + math.nan), "two finite samples"),
        (lambda: onto_grid(TIMES, ZEROS[1:]), r"\(100,\), values \(99,\)"),
        (lambda: onto_grid(TIMES, ZEROS, method="lineal"), "did you mean 'linear'"),
        (lambda: onto_grid(TIMES, ZEROS, method="band-limited", band=-1.0), "band .* is -1"),
        (lambda: tone_attenuation(onto_grid(TIMES, ZEROS), 5001.0), "fewer than two a period of 5001 Hz"),
        (lambda: tone_attenuation(onto_grid(TIMES, ZEROS, 30e3, "band-limited"), 3000.0), "band of the fit, 2500"),
        (lambda: tone_attenuation(onto_grid(TIMES, ZEROS, 2e3), 1500.0), "at or above Nyquist, 1000 Hz"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(ValueError, match=message):
        call()
