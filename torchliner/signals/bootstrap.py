r"""Moving-block bootstrap of a weighted mean over time, batched over columns.

A mean :math:`m = \sum_s W_s r_s` of S block means r_s with known weights W_s (a window) is
resampled by laying runs of b neighbouring blocks, drawn with replacement, over the record: the
order within a run keeps the correlation, the weights stay where they are (Kuensch 1989). The
deviation of a replicate from the replicates' own mean is linear in r, so that all draws of all
columns are one matrix product.

Three corrections, without which 95 % intervals of short records cover less: the run length follows
from the integral scale of r (below); the mean that is taken off was estimated, hence
:math:`\sqrt{S/(S-b)}`; the variance was estimated from S/b runs, hence Student's quantile with
S/b - 1 degrees of freedom over the normal one.
"""

from __future__ import annotations

import functools
import math

import torch
from scipy.special import ndtri, stdtrit
from torch import Tensor

SHORTEST_RUN = 2  # blocks: the correlation across a block's border is always allowed for
FEWEST_RUNS = 2.0
MOST_CORRELATED = 0.9


def run_lengths(series: Tensor) -> Tensor:
    r"""Blocks of a run, int64, (N,), for the mean of each column.

    Args:
        series: real or complex, (S, N).

    With the correlation rho of neighbouring blocks, whose integral scale is
    (1 + rho)/(2 (1 - rho)) blocks, the run that errs least in the variance is
    :math:`1.1447\,(4 \rho^2 S/(1-\rho^2)^2)^{1/3}` blocks; at least 2, at most S/4.
    Source: Andrews, Econometrica 59 (1991), eqs (6.2), (6.4), for the lag window of the
        moving-block bootstrap; rho is corrected for the mean that was taken off, (1 + 4 rho)/S.
    """
    count = len(series)
    away = series - series.mean(0)
    power = (away.abs() ** 2).sum(0)
    cross = (away[1:] * away[:-1].conj()).real.sum(0)
    rho = torch.where(power > 0, cross / power.clamp(min=1e-300), 0.0)
    wanted = _best_length(rho + (1 + 4 * rho) / count, count)
    longest = max(SHORTEST_RUN, count // 4)
    return wanted.ceil().to(torch.int64).clamp(SHORTEST_RUN, longest)


def common_run_length(series: Tensor) -> int:
    """Rows of a run for all columns together, (G, ...), whose mean over the record is 0; 1 to G.

    As ``run_lengths``, with the sums of G - 1 pairs of neighbours against G rows; a run of more
    than half the rows is all of them: tiles could not tell so few rows apart.
    """
    count = len(series)
    power = float((series.abs() ** 2).sum()) / count
    cross = float((series[1:] * series[:-1].conj()).real.sum()) / max(1, count - 1)
    rho = torch.tensor(cross / power if power > 0 else 0.0)
    wanted = max(1, math.ceil(float(_best_length(rho, count))))
    return count if 2 * wanted > count else wanted


def _best_length(rho: Tensor, count: int) -> Tensor:
    rho = rho.clamp(0, MOST_CORRELATED)
    return 1.1447 * (4 * rho**2 / (1 - rho**2) ** 2 * count) ** (1 / 3)


def can_resample(count: int) -> bool:
    """Whether S blocks hold the two runs that a variance needs."""
    return count >= FEWEST_RUNS * SHORTEST_RUN


def deviations(weights: Tensor, length: int, draws: int, seed: int) -> Tensor:
    """Matrix D of all draws: D @ series is the deviation of each replicate of the mean, (M, S).

    Args:
        weights: W, float64, (S,), of sum 1.
        length: blocks of a run, b.
        draws: M.
        seed: of the generator; the same for all columns.

    The replicates' mean over all possible draws, which is known in closed form, is taken off.
    """
    count = len(weights)
    generator = torch.Generator().manual_seed(seed)
    first = torch.randint(0, count - length + 1, (draws, -(-count // length)), generator=generator)
    source = (first[..., None] + torch.arange(length)).flatten(1)[:, :count]
    matrix = torch.zeros(draws, count, dtype=torch.float64)
    matrix.scatter_add_(1, source, weights.expand(draws, count))
    expected = torch.zeros(count, dtype=torch.float64)
    for place in range(count):
        offset = place % length
        last = count - length + offset
        expected[offset : last + 1] += weights[place] / (count - length + 1)
    return matrix - expected


def tile_draws(
    series: Tensor, weights: Tensor, lengths: tuple[int, int], draws: int, seed: int
) -> Tensor:
    """Replicates of a mean over time and rows, from tiles of both, less their mean: (M, ...).

    Args:
        series: (S, G, ...); the rows are alike in their statistics, so that any run of them may
            stand in for any other.
        weights: W of the S blocks, float64, of sum 1.
        lengths: blocks of time and rows of a tile.
        draws: M.
        seed: of the generator.
    """
    blocks, rows = series.shape[:2]
    long, wide = lengths
    generator = torch.Generator().manual_seed(seed)
    shape = (draws, -(-blocks // long), -(-rows // wide))
    when = torch.randint(0, blocks - long + 1, shape, generator=generator)
    where = torch.randint(0, rows - wide + 1, shape, generator=generator)
    steps, places = torch.arange(blocks), torch.arange(rows)
    across = (steps // long)[:, None], (places // wide)[None]
    flat = series.flatten(0, 1)
    share = (weights[:, None] / rows).expand(blocks, rows).flatten().to(series)
    found = []
    for each in range(draws):
        time = when[each][across] + (steps % long)[:, None]
        row = where[each][across] + (places % wide)[None]
        found.append(torch.tensordot(share, flat[(time * rows + row).flatten()], dims=1))
    replicates = torch.stack(found)
    return replicates - replicates.mean(0)


@functools.lru_cache(maxsize=1024)
def tails(draws: Tensor, level: float) -> tuple[Tensor, Tensor]:
    """Lower and upper quantile of an interval, interpolated between draws: (N, M) to (N,) each.

    Only the two tails are sorted, a third of the time that all of the draws take.
    """
    count = draws.shape[1]
    place = (1 - level) / 2 * (count - 1)
    below, share = int(place), place - int(place)
    kept = min(below + 2, count)
    ends = []
    for largest in (False, True):
        tail = draws.topk(kept, dim=1, largest=largest).values
        ends.append((1 - share) * tail[:, below] + share * tail[:, kept - 1])
    return ends[0], ends[1]


def student_factor(runs: float, level: float) -> float:
    """Student's quantile over the normal one, for a variance from ``runs`` independent runs."""
    upper = 0.5 + level / 2
    return float(stdtrit(max(1.0, runs - 1), upper) / ndtri(upper))


def mean_factor(count: int, length: int) -> float:
    """What the taken-off mean hides of the standard deviation: sqrt(S/(S - b))."""
    return math.sqrt(count / (count - length))
