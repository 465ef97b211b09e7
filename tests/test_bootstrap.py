"""Blocks of whole periods and the moving-block bootstrap of their means."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from torchliner.signals.blocks import plan_blocks
from torchliner.signals.bootstrap import (
    common_run_length,
    deviations,
    run_lengths,
    student_factor,
    tails,
    tile_draws,
)


@given(
    samples=st.integers(1, 5000), start=st.integers(0, 500), period=st.floats(1.0, 400.0),
    most=st.integers(1, 64),
)  # fmt: skip
def test_blocks_lie_in_the_record_and_hold_whole_periods(samples, start, period, most):
    """Borders rise, stay inside, and are whole periods apart to a sample."""
    start = min(start, samples)
    blocks = plan_blocks(samples, start, period, most)
    assert blocks.count <= most
    assert list(blocks.borders) == sorted(blocks.borders)
    assert blocks.borders[0] == start
    assert blocks.borders[-1] <= samples
    assert bool(((blocks.lengths - blocks.periods * period).abs()[:-1] <= 1).all())
    number = blocks.number(0, samples)
    counts = torch.bincount(number, minlength=blocks.count + 1)
    assert counts[: blocks.count].tolist() == blocks.lengths.tolist()


def test_replicates_deviate_from_their_own_mean():
    """The mean over all possible draws is known: for three runs of two blocks all are laid out."""
    weights = torch.tensor([0.05, 0.15, 0.3, 0.3, 0.15, 0.05], dtype=torch.float64)
    series = torch.randn(6, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    replicates = []
    for starts in itertools.product(range(5), repeat=3):
        source = [first + i for first in starts for i in range(2)]
        replicates.append((weights[:, None] * series[source]).sum(0))
    every = torch.stack(replicates)
    drawn = deviations(weights, 2, 20000, seed=3) @ series
    spread = every.std(0, correction=0)
    assert (drawn.mean(0) / spread).abs().max() < 4 / 20000**0.5
    assert drawn.std(0) == pytest.approx(spread, rel=0.02)
    exact = every - every.mean(0)
    assert drawn.abs().amax(0) == pytest.approx(exact.abs().amax(0), rel=1e-12)


def test_variance_is_that_of_the_lag_window():
    """Long series, equal weights: the bootstrap's variance is Bartlett's sum of covariances."""
    generator = torch.Generator().manual_seed(0)
    series = torch.randn(400, 1, dtype=torch.float64, generator=generator)
    series = series[1:] + 0.8 * series[:-1]
    count, length = len(series), 4
    weights = torch.full((count,), 1 / count, dtype=torch.float64)
    drawn = (deviations(weights, length, 20000, seed=0) @ series).var()
    away = (series - series.mean())[:, 0]
    lags = [float(away[lag:] @ away[: count - lag]) / count for lag in range(length)]
    wanted = (lags[0] + 2 * sum((1 - i / length) * lags[i] for i in range(1, length))) / count
    assert float(drawn) == pytest.approx(wanted, rel=0.04)


def test_runs_grow_with_the_integral_scale():
    """Andrews' length for a first-order process; white noise needs the shortest."""
    generator = torch.Generator().manual_seed(0)
    white = torch.randn(4000, 1, dtype=torch.float64, generator=generator)
    series = torch.zeros_like(white)
    for k in range(1, len(white)):
        series[k] = 0.6 * series[k - 1] + white[k]
    wanted = 1.1447 * (4 * 0.36 / 0.64**2 * 4000) ** (1 / 3)
    assert int(run_lengths(series)) == pytest.approx(wanted, abs=3)
    assert int(run_lengths(white)) <= 3
    assert run_lengths(torch.zeros(16, 2)).tolist() == [2, 2]
    assert common_run_length(white) <= 3
    assert common_run_length(series) == pytest.approx(wanted, abs=3)
    assert [common_run_length(series[5:6].expand(n, 5)) for n in (1, 2, 5, 12)] == [1, 2, 5, 12]


def test_student_factor_against_a_table():
    """t(9 degrees of freedom, 97.5 %) is 2.262, the normal quantile 1.960."""
    assert student_factor(10, 0.95) == pytest.approx(2.2622 / 1.95996, rel=1e-4)


def test_tails_are_numpys_quantiles():
    """Both ends, interpolated between draws, as numpy has them."""
    draws = torch.randn(7, 999, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    for level in (0.95, 0.9, 0.5):
        wanted = np.quantile(draws.numpy(), [(1 - level) / 2, (1 + level) / 2], axis=1)
        for mine, right in zip(tails(draws, level), wanted, strict=True):
            assert np.allclose(mine.numpy(), right, rtol=1e-13)


def test_tiles_of_independent_rows():
    """The mean of R independent rows varies R times less than one row; that of copies does not."""
    generator = torch.Generator().manual_seed(0)
    blocks, rows = 40, 12
    weights = torch.full((blocks,), 1 / blocks, dtype=torch.float64)
    series = torch.randn(blocks, rows, 1, dtype=torch.float64, generator=generator)
    series = series - series.mean(0)
    apart = tile_draws(series, weights, (1, 1), 1500, seed=0).std()
    assert float(apart) == pytest.approx(1 / (blocks * rows) ** 0.5, rel=0.08)
    copies = series[:, :1].expand(-1, rows, -1)
    together = tile_draws(copies, weights, (1, rows), 1500, seed=0).std()
    assert float(together) == pytest.approx(float(series[:, 0].std()) / blocks**0.5, rel=0.08)
