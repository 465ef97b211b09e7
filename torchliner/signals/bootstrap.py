r"""Moving-block bootstrap of a weighted mean over time, in closed form: no draw is made.

A mean :math:`m = \sum_s W_s r_s` of S block means r_s with known weights W_s (a window) is
resampled by laying runs of b neighbouring blocks, their first block uniform over the record, one
after another over the record: the order within a run keeps the correlation, the weights stay where
they are (Kuensch 1989). The runs of a replicate are independent and every first block is as likely
as any other, so that the replicates' variance is a quadratic form in r, known without a replicate:

.. math:: \sum_j \Big(\frac1n \sum_i |T_{ji}|^2 - \Big|\frac1n \sum_i T_{ji}\Big|^2\Big),
   \qquad T_{ji} = \sum_{k<b} W_{jb+k}\, r_{i+k}, \quad i < n = S - b + 1.

Four corrections, without which 95 % intervals of short records cover less: the run length follows
from the integral scale of r (below); the correlation that runs cut off is put back, as it is in a
first-order process; the mean that is taken off was estimated, hence :math:`S/(S-b)` times the
variance; it was estimated from S/b runs, hence Student's quantile with S/b - 1 degrees of freedom.
"""

from __future__ import annotations

import torch
from scipy.special import stdtrit
from torch import Tensor

from torchliner.signals.bars import neighbours

SHORTEST_RUN = 2  # blocks: the correlation across a block's border is always allowed for
FEWEST_RUNS = 2.0
MOST_CORRELATED = 0.9


def neighbour_correlation(series: Tensor) -> Tensor:
    """``correlation_of`` the blocks of each column of a complex128 (S, N)."""
    return correlation_of(neighbours(series), len(series))


def correlation_of(sums: Tensor, count: int) -> Tensor:
    """Correlation rho of neighbouring blocks, 0 to 0.9, (...), from ``neighbours`` of S blocks.

    What taking the mean off hides of it, (1 + 4 rho)/S, is added (Marriott and Pope 1954,
    Biometrika 41, 390).
    """
    power, cross = sums
    rho = torch.where(power > 0, cross / power.clamp(min=1e-300), 0.0)
    return (rho + (1 + 4 * rho) / count).clamp(0, MOST_CORRELATED)


def run_lengths(rho: Tensor, count: int) -> Tensor:
    r"""Blocks of a run, int64, (N,), for the mean of each column.

    Args:
        rho: correlation of neighbouring blocks, (N,).  count: S.

    With the integral scale (1 + rho)/(2 (1 - rho)) blocks, the run that errs least in the variance
    is :math:`1.1447\,(4 \rho^2 S/(1-\rho^2)^2)^{1/3}` blocks; at least 2, at most S/4.
    Source: Andrews, Econometrica 59 (1991), eqs (6.2), (6.4), for the lag window of the
        moving-block bootstrap.
    """
    longest = max(SHORTEST_RUN, count // 4)
    return _best_length(rho, count).ceil().to(torch.int64).clamp(SHORTEST_RUN, longest)


def beyond_runs(rho: Tensor, lengths: Tensor) -> Tensor:
    r"""True variance over that which runs of b blocks show, (N,); at least 1.

    Args:
        rho: correlation of neighbouring blocks, :math:`\rho^k` of those k apart, (N,).
        lengths: b, (N,).

    The mean varies as :math:`1 + 2\sum_k \rho^k = (1 + \rho)/(1 - \rho)`; a run has no
    correlation from :math:`k = b` on, and :math:`1 - k/b` of what there is before.
    """
    whole = (1 + rho) / (1 - rho)
    return whole / (whole - 2 * rho * (1 - rho**lengths) / (lengths * (1 - rho) ** 2))


def _best_length(rho: Tensor, count: int) -> Tensor:
    return 1.1447 * (4 * rho**2 / (1 - rho**2) ** 2 * count) ** (1 / 3)


def can_resample(count: int) -> bool:
    """Whether S blocks hold the two runs that a variance needs."""
    return count >= FEWEST_RUNS * SHORTEST_RUN


def runs_laid(weights: Tensor, length: int) -> Tensor:
    """What a run gives each block it may take: T = runs_laid @ series, (J, n, S).

    Args:
        weights: W, float64, (S,).
        length: blocks of a run, b; the last of the J runs is cut off at the record's end.
    """
    count = len(weights)
    runs, starts = -(-count // length), count - length + 1
    of_run = torch.nn.functional.pad(weights, (0, runs * length - count)).reshape(runs, 1, length)
    taken = torch.arange(starts)[:, None] + torch.arange(length)
    laid = torch.zeros(runs, starts, count, dtype=weights.dtype)
    return laid.scatter_(2, taken.expand(runs, -1, -1), of_run.expand(-1, starts, -1))


def replicate_covariance(weights: Tensor, length: int) -> Tensor:
    """C, (S, S): series^H C series is E|d|^2 of the replicates' deviation d from their mean, and
    series^T C series E[d^2]; arguments as for ``runs_laid``.

    Its S^3/b numbers need not be laid out: a run joins blocks less than b apart, and in the mean
    over all starts blocks b or more from both ends are alike."""
    count = len(weights)
    runs, starts = -(-count // length), count - length + 1
    of_run = torch.nn.functional.pad(weights, (0, runs * length - count)).reshape(runs, length)
    products = of_run.T @ of_run / starts
    covariance = torch.zeros(count, count, dtype=weights.dtype)
    for apart in range(length):
        across = _at_all_starts(products.diagonal(apart)[None], starts)[0]
        covariance.diagonal(apart).copy_(across)
        covariance.diagonal(-apart).copy_(across)
    ends = min(starts, length)
    expected = _at_all_starts(of_run, ends) / starts
    blocks = torch.arange(count)
    place = blocks.clamp(max=ends - 1) + (blocks - (starts - 1)).clamp(min=0)
    return covariance.sub_((expected.T @ expected)[place[:, None], place])


def _at_all_starts(rows: Tensor, starts: int) -> Tensor:
    """Sum of each row (N, L) laid at 0, 1, .. starts - 1: (N, L + starts - 1)."""
    ones = torch.ones(1, 1, starts, dtype=rows.dtype)
    kernels = rows.flip(1)[:, None]
    return torch.nn.functional.conv1d(ones, kernels, padding=rows.shape[1] - 1)[0]


def student_quantile(runs: Tensor, level: float) -> Tensor:
    """Half the width of an interval over the standard deviation that so many runs show, (N,)."""
    different, which = runs.cpu().unique(return_inverse=True)
    found = stdtrit((different - 1).clamp(min=1).numpy(), 0.5 + level / 2)
    return torch.from_numpy(found)[which].to(runs.device)


def mean_factor(count: int, length: int) -> float:
    """What the taken-off mean hides of the variance: S/(S - b)."""
    return count / (count - length)
