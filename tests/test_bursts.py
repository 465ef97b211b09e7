"""Records of bursts: moments, validation, flags, and what the command says of them."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
import torch
from conftest import SHARED

import torchliner as tl
from torchliner.bursts.stations import (
    BACKWARDS,
    OUTLIER,
    REPEATED,
    BurstFilters,
    Station,
    burst_moments,
    validate_bursts,
)
from torchliner.cli.main import main
from torchliner.io.burst_sources import read_bursts

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
    kept = validate_bursts(record, BurstFilters(outliers=None))
    assert kept.dropped == {BACKWARDS: 2, REPEATED: 1}
    assert kept.arrival_time.tolist() == [0, 1, 3, 4]
    assert kept.wall_normal.tolist() == [0, 1, 3, 6]
    assert kept.received == 7
    assert validate_bursts(record, BurstFilters(times=False)).bursts == 7


def test_times_that_run_backwards_are_refused():
    record = tl.BurstRecord(np.arange(10.0)[::-1], np.ones(10), name="back.txt")
    with pytest.raises(ValueError, match=r"back.txt: time runs backwards at 9 of 10 bursts"):
        validate_bursts(record)
    with pytest.raises(ValueError, match="repeated time at 9 of 10 bursts"):
        validate_bursts(tl.BurstRecord(np.zeros(10), np.ones(10)))


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
    assert validate_bursts(dirty, BurstFilters(outliers=None)).bursts == 3000


def flags_of(record: tl.BurstRecord) -> tuple[str, ...]:
    return Station.of(record).flags


def test_each_fault_is_flagged():
    rng = np.random.default_rng(5)
    v = rng.normal(0, 1, 2000)
    zeros = np.where(rng.random(2000) < 0.4, 0.0, v)
    assert "40 % of wall_normal are exactly 0" in flags_of(gaussian_record(wall_normal=zeros))[0]
    coarse = np.round(v)
    assert any("rounding alone is 8 %" in f for f in flags_of(gaussian_record(wall_normal=coarse)))
    assert "0.99 bursts a period of 1000 Hz" in str(flags_of(gaussian_record(frequency=1000.0)))
    time = poisson_times(2000)
    time[1000:] += 0.1
    gap = tl.BurstRecord(time, v)
    assert any("a gap of 10" in f for f in flags_of(gap))
    many = tl.BurstRecord(poisson_times(2000), v, dropped={"before": 500})
    assert "20 % of the bursts dropped" in flags_of(many)[0]


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
