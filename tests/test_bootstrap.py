"""Blocks of whole periods, the moving-block bootstrap of their means, intervals of Z from them."""

from __future__ import annotations

import itertools
import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from torchliner.conversions import (
    admittance_from_reflection,
    impedance_from_reflection,
)
from torchliner.signals.blocks import plan_blocks
from torchliner.signals.bootstrap import (
    beyond_runs,
    neighbour_correlation,
    replicate_covariance,
    run_lengths,
    runs_laid,
    student_quantile,
)
from torchliner.signals.resampling import (
    FROM_ADMITTANCE,
    FROM_REFLECTION,
    ITSELF,
    Resampling,
    impedance_interval,
)


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    """Complex, of variance 1 in each part, float64."""
    generator = torch.Generator().manual_seed(seed)
    return torch.complex(*torch.randn(2, *shape, dtype=torch.float64, generator=generator))


def equal(count: int) -> torch.Tensor:
    return torch.full((count,), 1 / count, dtype=torch.float64)


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
    if blocks.count:
        ones = torch.ones(samples, dtype=torch.float64)
        assert blocks.sums(ones).tolist() == blocks.lengths.tolist()


def test_covariance_is_that_of_every_replicate():
    """Two runs of three blocks and a short one: all that can be drawn are laid out."""
    weights = torch.tensor([0.04, 0.1, 0.16, 0.2, 0.2, 0.16, 0.1, 0.04], dtype=torch.float64)
    series = noise(8, 4)
    replicates = []
    for starts in itertools.product(range(6), repeat=3):
        source = [first + i for first in starts for i in range(3)][:8]
        replicates.append((weights[:, None] * series[source]).sum(0))
    away = torch.stack(replicates) - torch.stack(replicates).mean(0)
    covariance = replicate_covariance(weights, 3).to(series)
    power = (series.conj() * (covariance @ series)).sum(0)
    square = (series * (covariance @ series)).sum(0)
    torch.testing.assert_close(power.real, away.abs().square().mean(0), rtol=1e-12, atol=0)
    torch.testing.assert_close(square, away.square().mean(0), rtol=1e-11, atol=1e-15)


@pytest.mark.parametrize("count", [1, 2, 7, 32])
def test_covariance_is_that_of_runs_laid_out(count):
    """For any length of a run; and any weights."""
    for length in range(1, count + 1):
        weights = noise(count, seed=length).real
        laid = runs_laid(weights, length)
        expected = laid.mean(1)
        wanted = torch.einsum("jis,jit->st", laid, laid) / laid.shape[1] - expected.T @ expected
        torch.testing.assert_close(replicate_covariance(weights, length), wanted, rtol=0, atol=1e-14 * count)


def test_covariance_of_as_many_segments_as_ten_minutes_hold():
    """Laid out, its runs would take 6 GB; a constant series scatters by nothing."""
    found = replicate_covariance(equal(1200), 2)
    assert float((found @ torch.ones(1200, dtype=torch.float64)).abs().max()) < 1e-15
    white = float(found.diagonal().sum() * 1200)
    assert white == pytest.approx(1.0, abs=0.01)


def test_many_draws_tend_to_the_covariance():
    """Their variance comes as near as one over the root of their number."""
    series, weights, length, draws = noise(16, 3), torch.rand(16, dtype=torch.float64), 3, 40000
    generator = torch.Generator().manual_seed(5)
    first = torch.randint(0, 16 - length + 1, (draws, 6), generator=generator)
    source = (first[..., None] + torch.arange(length)).flatten(1)[:, :16]
    drawn = torch.einsum("s,dsn->dn", weights.to(series), series[source]).var(0)
    covariance = replicate_covariance(weights, length).to(series)
    wanted = (series.conj() * (covariance @ series)).sum(0).real
    assert ((drawn.real / wanted - 1).abs() < 4 / draws**0.5).all()


def test_variance_is_that_of_the_lag_window():
    """Long series, equal weights: the bootstrap's variance is Bartlett's sum of covariances."""
    series = noise(400, 1).real
    series = series[1:] + 0.8 * series[:-1]
    count, length = len(series), 4
    found = (series.T @ replicate_covariance(equal(count), length) @ series).item()
    away = (series - series.mean())[:, 0]
    lags = [float(away[lag:] @ away[: count - lag]) / count for lag in range(length)]
    wanted = (lags[0] + 2 * sum((1 - i / length) * lags[i] for i in range(1, length))) / count
    assert found == pytest.approx(wanted, rel=0.02)


def test_runs_grow_with_the_integral_scale():
    """Andrews' length for a first-order process; white noise needs the shortest."""
    white = noise(4000, 1).real
    series = torch.zeros_like(white)
    for k in range(1, len(white)):
        series[k] = 0.6 * series[k - 1] + white[k]
    wanted = 1.1447 * (4 * 0.36 / 0.64**2 * 4000) ** (1 / 3)
    columns = torch.cat([series, white, torch.zeros_like(white)], 1)
    rho = neighbour_correlation(columns.to(torch.complex128))
    assert float(rho[0]) == pytest.approx(0.6, abs=0.04)
    assert int(run_lengths(rho, 4000)[0]) == pytest.approx(wanted, abs=3)
    assert int(run_lengths(rho, 4000)[1]) <= 3
    assert run_lengths(rho, 4000)[2] == 2
    assert run_lengths(torch.tensor([0.9]), 16).tolist() == [4]


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.9])
def test_what_runs_cut_off(rho):
    """Sum of the correlations of a first-order process over Bartlett's sum of them."""
    whole = 1 + 2 * sum(rho**k for k in range(1, 500))
    seen = 1 + 2 * sum((1 - k / 5) * rho**k for k in range(1, 5))
    found = beyond_runs(torch.tensor(rho, dtype=torch.float64), torch.tensor(5))
    assert float(found) == pytest.approx(whole / seen, rel=1e-12)


def test_students_quantile_against_a_table():
    """t(9 degrees of freedom, 97.5 %) is 2.262, t(1) 12.706; fewer than one cannot be."""
    found = student_quantile(torch.tensor([10.0, 2.0, 1.0], dtype=torch.float64), 0.95)
    assert found.tolist() == pytest.approx([2.2622, 12.7062, 12.7062], rel=1e-4)


# Intervals


def interval(value, power, square, *, conversion=FROM_REFLECTION, runs=10.0):
    """Of one column."""
    numbers = [torch.tensor([each], dtype=torch.complex128) for each in (value, square)]
    reals = [torch.tensor([each], dtype=torch.float64) for each in (power, runs)]
    return impedance_interval(
        numbers[0], reals[0], numbers[1], reals[1], 0.95, conversion
    ).map(lambda each: each[0])  # fmt: skip


@pytest.mark.parametrize(("size", "error"), [(0.01, 1e-4), (0.1, 5e-4), (0.3, 1e-2)])
@pytest.mark.parametrize("value", [0.0, 0.3 - 0.4j, -0.5j])
def test_a_circle_of_reflections_is_a_circle_of_impedances(value, size, error):
    """Scatter alike in all directions: the bounds are those of the circle's image, known."""
    reach = 2.26216 * size / 2**0.5
    found = interval(value, size**2, 0.0)
    centre, from_pole = 1 - value, abs(1 - value) ** 2 - reach**2
    middle, radius = -1 + 2 * centre.conjugate() / from_pole, 2 * reach / from_pole
    for part in ("real", "imag"):
        about, low, high = (getattr(z, part) for z in (middle, found.low, found.high))
        assert float(low) == pytest.approx(about - radius, abs=error * radius)
        assert float(high) == pytest.approx(about + radius, abs=error * radius)


def test_a_linear_impedance_has_students_interval():
    """value +- t sigma, of real and imaginary part by their own variances; no bias, all runs."""
    power, square = 0.05, 0.03 - 0.02j
    found = interval(2 - 1j, power, square, conversion=ITSELF)
    sigma = [((power + sign * square.real) / 2) ** 0.5 for sign in (1, -1)]
    error = torch.view_as_real(found.standard_error).tolist()
    assert error == pytest.approx(sigma, rel=1e-12)
    for bound, sign in ((found.low, -1), (found.high, 1)):
        wanted = [2 + sign * 2.26216 * sigma[0], -1 + sign * 2.26216 * sigma[1]]
        assert torch.view_as_real(bound).tolist() == pytest.approx(wanted, abs=3e-4 * sigma[0])


def test_bounds_are_the_extremes_on_the_ellipse():
    """Against 20 000 points of ellipses of any shape, drawn from their covariances; they hold the
    value, and for a small one its error is that of first order."""
    generator = torch.Generator().manual_seed(1)
    for _ in range(40):
        half = 0.08 * torch.randn(2, 2, dtype=torch.float64, generator=generator)
        value = complex(*(0.5 * torch.rand(2, generator=generator) - 0.25).tolist())
        angle = torch.linspace(0, math.tau, 20000, dtype=torch.float64)
        covariance = half @ half.T
        power = float(covariance.trace())
        square = complex(covariance[0, 0] - covariance[1, 1], 2 * covariance[0, 1])
        x, y = 2.26216 * half @ torch.stack([angle.cos(), angle.sin()])
        z = impedance_from_reflection(value + torch.complex(x, y))
        found = interval(value, power, square)
        centre = impedance_from_reflection(torch.tensor(value, dtype=torch.complex128))
        for part in ("real", "imag"):
            wanted = getattr(z, part)
            width = float(wanted.max() - wanted.min())
            low, high = float(getattr(found.low, part)), float(getattr(found.high, part))
            assert low == pytest.approx(float(wanted.min()), abs=5e-3 * width)
            assert high == pytest.approx(float(wanted.max()), abs=5e-3 * width)
            assert low < getattr(centre, part) < high


def test_the_same_scatter_by_reflection_or_by_admittance():
    """A small ellipse of R is one of Y: bounds and errors of Z agree to the second order."""
    value, size = torch.tensor(0.2 - 0.3j, dtype=torch.complex128), 1e-4
    slope = complex(-2 / (1 + value) ** 2)
    first = interval(complex(value), size**2, 0.4j * size**2)
    second = interval(
        complex(admittance_from_reflection(value)), abs(slope) ** 2 * size**2,
        slope**2 * 0.4j * size**2, conversion=FROM_ADMITTANCE,
    )  # fmt: skip
    assert abs(first.low - second.low) < 3 * size**2 + 1e-3 * size
    assert abs(first.standard_error - second.standard_error) < 1e-9 * size


def test_around_the_pole_there_are_no_bounds():
    """R = 1 is an impedance of any size: an ellipse that holds it bounds nothing, one beside it
    does, and a rigid wall that stays one has no width."""
    inside, beside = interval(0.9, 0.02, 0.0), interval(0.9, 0.002, 0.0)
    for bound, sign in ((inside.low, -1), (inside.high, 1)):
        assert torch.view_as_real(bound).tolist() == [sign * math.inf, sign * math.inf]
    assert torch.view_as_real(torch.stack([beside.low, beside.high])).isfinite().all()
    # Long across the way to the pole, and as far from it as it is wide along that way.
    assert torch.view_as_real(interval(0.9, 0.02, -0.0199).high).isfinite().all()


def test_a_frozen_series_has_no_width():
    how = Resampling(equal(16), 0.95)
    value = torch.tensor([0.3 + 0.2j, -0.9 + 0j], dtype=torch.complex128)
    found = how.over_time(torch.zeros(16, 2, dtype=torch.complex128), value)
    z = impedance_from_reflection(value)
    assert torch.equal(found.low, z)
    assert torch.equal(found.high, z)
    assert found.standard_error.abs().max() == 0
    assert found.runs.tolist() == [8, 8]
    still = how.scatter(torch.zeros(16, 2, 3, dtype=torch.complex128))
    assert max(each.abs().max() for each in (still.square, still.short, still.pairs)) == 0


def test_columns_do_not_know_each_other():
    """Of other run lengths, in another order, alone: the same bounds; runs are S over the run."""
    white = noise(32, 6)
    series = 0.1 * torch.cat([white[:, :3], white[:, 3:].cumsum(0) / 4], 1)
    series = series - series.mean(0)
    value = 0.2 * noise(6, seed=4)
    how = Resampling(equal(32), 0.9)
    whole = how.over_time(series, value)
    assert whole.runs.min() >= 4
    assert whole.runs.max() == 16
    assert len(whole.runs.unique()) > 1
    for i in range(6):
        alone = how.over_time(series[:, i : i + 1], value[i : i + 1])
        for mine, right in zip(vars(alone).values(), vars(whole).values(), strict=True):
            assert abs(mine[0] - right[i]) < 1e-13 * (1 + abs(right[i]))


def test_scaling_and_turning():
    """Twice the deviation: twice the error; in units of another impedance: bounds in those."""
    series, value = 0.02 * noise(16, 5), 0.3 * noise(5, seed=2)
    series = series - series.mean(0)
    how = Resampling(equal(16), 0.95)
    once, twice = how.over_time(series, value), how.over_time(2 * series, value)
    torch.testing.assert_close(2 * once.standard_error, twice.standard_error)
    upright, turned = how.scatter(series), how.scatter(1j * series)
    torch.testing.assert_close(turned.square, -upright.square)
    torch.testing.assert_close(turned.short, -upright.short)
    plain = Resampling(equal(16), 0.95, ITSELF)
    ohms, unit = plain.over_time(413 * series, 413 * value), plain.over_time(series, value)
    torch.testing.assert_close(ohms.low, 413 * unit.low)
    torch.testing.assert_close(ohms.standard_error, 413 * unit.standard_error)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.6])
def test_the_variance_of_the_mean_is_met(rho):
    """First-order processes of 32 blocks: in the mean over 5000 it is that of their means, and up
    to a tenth more (a correlation below 0 counts as none)."""
    series = noise(72, 5000)
    for k in range(1, 72):
        series[k] += rho * series[k - 1]
    series = series[40:]
    power = Resampling(equal(32), 0.95).scatter(series - series.mean(0)).power
    assert 0.99 < float(power.mean() / series.mean(0).abs().square().mean()) < 1.12
