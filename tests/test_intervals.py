"""Intervals: laws of the jackknife over runs of blocks, bounds near the pole, how often they hold the truth."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
import torch
from scipy.special import stdtrit
from torch import Tensor

from torchliner.conversions import impedance_from_reflection
from torchliner.engine.intervals import FROM_REFLECTION, ITSELF, impedance_interval, jackknife, replicates
from torchliner.records.educed import Interval

COUNTS = (4, 5, 8, 16, 32)  # blocks


def blocks_of(count: int, columns: int, rho: float = 0.0) -> Tensor:
    """Means of blocks that scatter by 1 in both parts, as a first-order process along time, complex128, (S, N)."""
    white = torch.randn(count, columns, 2, dtype=torch.float64)
    found = [white[0]]
    for each in white[1:]:
        found.append(rho * found[-1] + math.sqrt(1 - rho**2) * each)
    return torch.view_as_complex(torch.stack(found))


def means_of(blocks: Tensor, lengths: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Means over the remaining blocks, and the shares of the blocks; of equal lengths unless stated."""
    lengths = torch.ones(len(blocks), dtype=torch.float64) if lengths is None else lengths
    return replicates(blocks * lengths[:, None], lengths), lengths / lengths.sum()


def interval_of(blocks: Tensor, level: float = 0.95) -> Interval:
    return jackknife(*means_of(blocks), level, ITSELF)


def defined_error(own: list[complex], runs: float) -> complex:
    """Standard errors of both parts by the definition, number by number, from what each block contributes."""
    count, variances = len(own), []
    power = sum(abs(u) ** 2 for u in own)
    rho = sum((u * v.conjugate()).real for u, v in pairwise(own)) / power
    rho = min(0.9, max(-0.9, rho + (1 + 4 * rho) / count))
    length = max(2, min(count // 4, math.ceil(1.1447 * (4 * rho**2 * count / (1 - rho**2) ** 2) ** (1 / 3))))
    assert runs == pytest.approx(count / length)
    for part in ([u.real for u in own], [u.imag for u in own]):
        squares = [sum(part[i : i + length]) ** 2 for i in range(count - length + 1)]
        variances.append(count / length * count / (count - length) * sum(squares) / len(squares))
    shown = 1 + 2 * sum((1 - k / length) * rho**k for k in range(1, length))  # of the correlation, by a run
    return complex(*(math.sqrt(variance * (1 + rho) / (1 - rho) / shown) for variance in variances))


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("rho", [-0.6, 0.0, 0.6])
def test_the_error_of_a_mean_is_that_of_its_runs_whatever_the_blocks(count: int, rho: float) -> None:
    blocks, lengths = blocks_of(count, 5, rho), 100 + 10.0 * torch.randint(0, 5, (count,)).double()
    means, shares = means_of(blocks, lengths)
    found, own = jackknife(means, shares, 0.95, ITSELF), (shares[:, None] * (blocks - means[0])).T.tolist()
    expected = [defined_error(each, float(runs)) for each, runs in zip(own, found.runs, strict=True)]
    torch.testing.assert_close(found.standard_error, torch.tensor(expected, dtype=torch.complex128))
    torch.testing.assert_close(found.bias, torch.zeros_like(found.bias), atol=1e-13, rtol=0)  # a mean has none


@pytest.mark.parametrize(("count", "least", "most"), [(4, 98, 100), (8, 96, 97.5), (16, 95, 97), (32, 94.5, 96.5)])
def test_of_white_noise_the_variance_is_right_and_intervals_hold_the_truth(
    count: int, least: float, most: float
) -> None:
    found = interval_of(blocks_of(count, 20000))
    squares = torch.view_as_real(found.standard_error).square() * count
    spread = 3 * float(squares.std()) / math.sqrt(squares.numel())
    # Allowing for the correlation that a record seems to have adds some of its scatter, of order 1/S.
    assert 1 - spread < float(squares.mean()) < 1 + spread + 1.5 / count
    assert least < 100 * float(((found.low.real <= 0) & (found.high.real >= 0)).double().mean()) < most


@pytest.mark.parametrize("level", [0.5, 0.95, 0.999])
@pytest.mark.parametrize("count", COUNTS)
def test_half_a_width_is_students_quantile_times_the_standard_error(count: int, level: float) -> None:
    found = interval_of(blocks_of(count, 50, 0.5), level)
    quantile = torch.from_numpy(stdtrit((found.runs - 1).numpy(), 0.5 + level / 2))
    torch.testing.assert_close(found.widths, 2 * quantile * torch.view_as_real(found.standard_error).T)


def test_a_square_is_off_by_the_variance_and_the_bounds_are_without_it() -> None:
    means, shares = means_of(blocks_of(16, 40000).real.to(torch.complex128) + 3)
    found = jackknife(means**2, shares, 0.95, ITSELF)
    torch.testing.assert_close(((found.low + found.high) / 2 + found.bias).real, means[0].real ** 2)
    assert float(found.bias.real.mean()) == pytest.approx(1 / 16, rel=0.05)


def test_bounds_are_the_extremes_on_the_ellipse_and_infinite_around_the_pole() -> None:
    value = 1 + 0.3 * torch.randn(400, dtype=torch.complex128)
    long, turn, quantile = (torch.rand(400, dtype=torch.float64) for _ in range(3))
    turned = torch.exp(2j * math.pi * turn)
    axes = torch.stack([long * turned, 0.3j * long * turned])  # R = value + quantile (axes times cos, sin)
    scatter = axes.abs().square().sum(0), axes.square().sum(0)
    found = impedance_interval(value, 0 * value, *scatter, quantile, quantile, FROM_REFLECTION)
    pole = (1 - value) / turned / (quantile * long)  # from the middle, in half axes
    away = pole.real**2 + (pole.imag / 0.3) ** 2
    assert 40 < int((away < 1).sum()) < 200
    assert torch.equal(found.widths == math.inf, (away < 1).expand(2, -1))
    angle = 2 * math.pi / 10000 * torch.arange(10000, dtype=torch.float64)
    around = axes.T @ torch.stack([angle.cos(), angle.sin()]).to(axes)
    z = impedance_from_reflection(value[:, None] + quantile[:, None] * around)
    least, most = torch.view_as_real(z).aminmax(dim=1)
    for end, expected in ((found.low, least), (found.high, most)):
        off = (torch.view_as_real(end) - expected) / (most - least)
        assert float(off[away > 2].abs().max()) < 1e-3


def test_blocks_that_do_not_vary_give_no_width_and_a_rigid_wall_no_bounds() -> None:
    lengths = torch.tensor([30.0, 31, 29, 30, 30, 33, 30, 30], dtype=torch.float64)
    still = jackknife(*means_of(torch.full((8, 3), 0.3 + 0.2j, dtype=torch.complex128), lengths), 0.95)
    assert float(still.widths.abs().max()) < 1e-12
    wall = jackknife(*means_of(torch.ones(8, 3, dtype=torch.complex128)), 0.95)
    assert bool((wall.widths == math.inf).all())
