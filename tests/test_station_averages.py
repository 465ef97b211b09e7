"""Averages (5.1) and (5.2) of laser Doppler stations, their widths and intervals."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from test_stations import FREQUENCY, educed, station

import torchliner as tl
from torchliner.bursts.averages import (
    monte_carlo,
    segment_admittances,
    station_intervals,
)

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
REPLAYED = 5e-5  # in R: the kernels of the replay end


@pytest.fixture(scope="module")
def line(onera):
    return educed([station(seed) for seed in range(3)], onera)


def test_monte_carlo_is_the_closed_form_and_its_spread_too(line):
    """Means within four standard errors of the draws; the spread within four per cent."""
    admittance, counts = segment_admittances(line), line.segments
    draws = 20_000
    drawn = monte_carlo(admittance, counts, draws, seed=1)[:, 0]
    wide = deviation_of_draws(admittance, counts)
    off = complex(drawn.mean()) - complex(line.admittance.mean())
    assert abs(off.real) < 4 * wide.real / math.sqrt(draws)
    assert abs(off.imag) < 4 * wide.imag / math.sqrt(draws)
    assert float(drawn.real.std()) == pytest.approx(wide.real, rel=0.04)
    assert float(drawn.imag.std()) == pytest.approx(wide.imag, rel=0.04)


def deviation_of_draws(admittance: torch.Tensor, counts: torch.Tensor) -> complex:
    """sqrt(sum of the stations' variances)/N of (5.2), real and imaginary, for one frequency."""
    parts = []
    for part in (np.real, np.imag):
        values = [part(own[:count, 0].numpy()) for own, count in zip(admittance, counts, strict=True)]
        parts.append(math.sqrt(sum(each.var() for each in values)) / len(values))
    return complex(*parts)


def segment_means(generator: np.random.Generator, segments: int) -> np.ndarray:
    """Complex means of white noise under Hann windows that overlap by half."""
    length = 64
    white = generator.standard_normal(((segments + 1) * length // 2, 2)) @ [1, 1j]
    window = np.hanning(length + 1)[:-1]
    return np.array(
        [(window * white[i * length // 2 : i * length // 2 + length]).sum() / window.sum() for i in range(segments)]
    )


def test_intervals_cover_with_overlapping_segments():
    """19 segments, as of 10 s: 95 % hold R and X in 95 % of 600 trials, within three standard
    errors (2.7 %); scripts/coverage.py stations runs the whole chain 2000 times."""
    generator = np.random.default_rng(0)
    trials = np.stack([segment_means(generator, 19) for _ in range(600)], axis=1)
    found = station_intervals(torch.from_numpy(0.3 + 0.1j + 0.02 * trials)[None], torch.tensor([19]), 0.95)
    true = (1 + (0.3 + 0.1j)) / (1 - (0.3 + 0.1j))
    low, high = found.low.numpy(), found.high.numpy()
    for part in (np.real, np.imag):
        inside = (part(low) <= part(true)) & (part(true) <= part(high))
        assert abs(inside.mean() - 0.95) < 0.027


def test_the_bias_of_short_segments_is_taken_off_the_bounds():
    """The mean of Z over noisy segments is off by Z'' var/2; the bounds sit about the true Z."""
    generator = np.random.default_rng(1)
    true = (1 + 0.5) / (1 - 0.5)
    noisy = 0.5 + 0.15 * generator.standard_normal((300, 40)).T
    found = station_intervals(torch.from_numpy(noisy.astype(complex))[None], torch.tensor([40]), 0.95)
    off = float(found.bias.real.mean())
    middle = float(0.5 * (found.low + found.high).real.mean())
    second_order = 0.5 * 4 / (1 - 0.5) ** 3 * 0.15**2
    assert off == pytest.approx(second_order, rel=0.5)  # and higher orders
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
        assert float((own - found.reflection[n, : len(pieces), 0]).abs().max()) < REPLAYED
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
