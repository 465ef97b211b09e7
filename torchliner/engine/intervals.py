r"""How far a result may be off because its record is finite: a delete-run jackknife, for everything.

Every result is a function of sums over S blocks. It is computed once from all blocks and once without each of them
(``replicates``): whatever function it is, its change without block s, times :math:`-(1 - w_s)`, is what block s
contributes to it to first order, :math:`u_s`. Leaving out a run of L neighbouring blocks changes the result by the sum
of their contributions, and the jackknife over all runs gives the variance

.. math:: \frac{S}{L}\,\frac{S}{S - L}\;\operatorname{mean}_i\Big|\sum_{k < L} u_{i + k}\Big|^2 .

The run length follows from the correlation rho of neighbouring blocks (Andrews 1991), which a tone beside turbulence
can make negative; the part of the correlation that reaches beyond a run is allowed for as in a first-order process.
The interval takes Student's quantile with S/L - 1 degrees of freedom.

A result that is not linear in its sums is off in the mean, a mean over many probes by several times its scatter. The
bounds are without that bias, which is estimated without each quarter of the record: single blocks are not independent,
and a factor from the correlation in a single record would scatter by half.

Complex results scatter by :math:`E|d|^2` and :math:`E[d^2]`: an ellipse in the plane of R. The bounds of resistance and
reactance are the extreme values of Z on that ellipse, Student's quantile times as large. Z has a pole (R = 1, a rigid
wall); where the ellipse encloses it the record does not bound Z and the bounds are infinite, as Fieller's theorem says
of any ratio.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from scipy.special import stdtrit
from torch import Tensor

from torchliner.conversions import impedance_from_reflection
from torchliner.records.uncertainty import Interval

SHORTEST_RUN = 2  # blocks: the correlation across a block's border is always allowed for
MOST_CORRELATED = 0.9
FEWEST_BLOCKS = 4  # two runs
QUARTERS = 4  # each long enough to hold most of the correlation
ANGLES, STEPS = 32, 2  # tried on the ellipse, and of Newton's method from the best


def remaining(sums: Tensor) -> Tensor:
    """Sums over all blocks, without each block, then without each quarter of them: (S, ...) to (1 + S + 4, ...)."""
    quarters = torch.stack([quarter.sum(0) for quarter in sums.tensor_split(QUARTERS)])
    total = sums.sum(0, keepdim=True)
    return torch.cat([total, total - sums, total - quarters])


def replicates(sums: Tensor, lengths: Tensor) -> Tensor:
    """Means over the same: (S, ...) to (1 + S + 4, ...).

    Args:
        sums: over each block.
        lengths: samples of each block, (S,).
    """
    return remaining(sums) / remaining(lengths).reshape(-1, *[1] * (sums.ndim - 1))


def correlation(power: Tensor, neighbours: Tensor, count: int, least: float = 0.0) -> Tensor:
    """rho of neighbouring blocks, ``least`` to 0.9, from sums over S blocks of |d|^2 and of products of neighbours.

    What taking the mean off hides of it, (1 + 4 rho)/S, is added (Marriott and Pope, Biometrika 41, 1954, 390).
    """
    rho = torch.where(power > 0, neighbours / power.clamp(min=1e-300), 0.0)
    return (rho + (1 + 4 * rho) / count).clamp(least, MOST_CORRELATED)


@dataclass(frozen=True)
class Conversion:
    """How Z follows from what is resampled: a function of first degree over first degree.

    Args:
        impedance: Z of it.
        slope: dZ by it.
        pole: where Z is infinite; inf for nowhere.
    """

    impedance: Callable[[Tensor], Tensor]
    slope: Callable[[Tensor], Tensor]
    pole: complex


FROM_REFLECTION = Conversion(impedance_from_reflection, lambda r: 2 / (1 - r) ** 2, 1)
ITSELF = Conversion(lambda z: z, torch.ones_like, math.inf)


def jackknife(values: Tensor, shares: Tensor, level: float, conversion: Conversion = FROM_REFLECTION) -> Interval:
    """Interval of Z at every place.

    Args:
        values: complex128, of ``remaining`` blocks, (1 + S + 4, ...), S at least 4.
        shares: of each block in the whole record, w, of sum 1, float64, (S,).
        level: of the interval, 0 to 1.
        conversion: from ``values`` to Z, the reflection coefficient unless stated.
    Returns:
        Bounds and standard errors of resistance and reactance, (...).
    """
    shape, count = values.shape[1:], len(shares)
    value, left = values[0].flatten(), torch.view_as_real(values[1 : 1 + count].flatten(1))  # (S, N, 2)
    kept = (1 - shares)[:, None, None]
    centre = (kept * left).sum(0) / (count - 1)  # of a linear result its value, whatever the shares
    own = (centre - left) * kept
    power, neighbours = own.square().sum(0).sum(-1), (own[1:] * own[:-1]).sum(0).sum(-1)
    rho = correlation(power, neighbours, count, -MOST_CORRELATED)
    lengths = run_lengths(rho, count)
    moments = _of_runs(own, lengths) * _beyond_runs(rho, lengths)
    quantile = _student(count, level).to(value.device)[lengths - SHORTEST_RUN]
    weight = torch.stack([1 - quarter.sum() for quarter in shares.tensor_split(QUARTERS)])
    bias = (weight[:, None] * (values[1 + count :].flatten(1) - value)).sum(0)
    found = impedance_interval(value, bias, moments, quantile, count / lengths.double(), conversion)
    return found.map(lambda each: each.reshape(shape))


def run_lengths(rho: Tensor, count: int) -> Tensor:
    r"""Blocks of a run, int64, (N,): :math:`1.1447\,(4 \rho^2 S/(1-\rho^2)^2)^{1/3}`, at least 2, at most S/4.

    Source: Andrews, Econometrica 59 (1991), eqs (6.2), (6.4), for runs of blocks.
    """
    best = 1.1447 * (4 * rho**2 / (1 - rho**2) ** 2 * count) ** (1 / 3)
    return best.ceil().to(torch.int64).clamp(SHORTEST_RUN, _longest(count))


def _longest(count: int) -> int:
    return max(SHORTEST_RUN, count // 4)


def _of_runs(own: Tensor, lengths: Tensor) -> Tensor:
    """Variances of real and imaginary part and their covariance, (3, N), from runs of each column's length."""
    count = len(own)
    total = torch.nn.functional.pad(own.cumsum(0), (0, 0, 0, 0, 1, 0))
    found = own.new_zeros(3, own.shape[1])
    for length in range(SHORTEST_RUN, _longest(count) + 1):
        runs = total[length:] - total[:-length]
        squares, cross = runs.square().mean(0), (runs[..., 0] * runs[..., 1]).mean(0)
        factor = count / length * count / (count - length)
        found = torch.where(lengths == length, factor * torch.cat([squares.T, cross[None]]), found)
    return found


def _beyond_runs(rho: Tensor, lengths: Tensor) -> Tensor:
    r"""True variance over that which runs of L blocks show, for a correlation :math:`\rho^k` of blocks k apart.

    The mean varies as :math:`(1 + \rho)/(1 - \rho)`; a run has no correlation from :math:`k = L` on, and
    :math:`1 - k/L` of what there is before.
    """
    whole = (1 + rho) / (1 - rho)
    return whole / (whole - 2 * rho * (1 - rho**lengths) / (lengths * (1 - rho) ** 2))


def _student(count: int, level: float) -> Tensor:
    """Student's quantile for runs of 2 .. S/4 blocks."""
    lengths = torch.arange(SHORTEST_RUN, _longest(count) + 1, dtype=torch.float64)
    return torch.from_numpy(stdtrit((count / lengths - 1).clamp(min=1).numpy(), 0.5 + level / 2))


def impedance_interval(
    value: Tensor, bias: Tensor, moments: Tensor, quantile: Tensor, runs: Tensor, conversion: Conversion
) -> Interval:
    """Bounds of Z and its standard error, (N,); infinite where the record does not bound Z.

    Args:
        value: complex128, (N,); bias: what it is off in the mean; the bounds are without it.
        moments: variances of its real and imaginary part and their covariance, (3, N).
        quantile: of Student's distribution.  runs: independent runs of the record.  conversion: to Z.
    """
    middle = value - bias
    power, square = moments[0] + moments[1], torch.complex(moments[0] - moments[1], 2 * moments[2])
    # d = e^{jt} (long cos a + j short sin a), t half the angle of E[d^2].
    long, short = ((power + sign * square.abs()).clamp(min=0).div(2).sqrt() for sign in (1, -1))
    turn = torch.exp(0.5j * square.angle())
    slope, pole = conversion.slope(middle), (conversion.pole - middle) * turn.conj()
    axes = torch.stack([quantile * long * turn, 1j * quantile * short * turn])
    share = axes / (conversion.pole - middle) if math.isfinite(abs(conversion.pole)) else 0 * axes
    changes = _extremes(axes * slope, share)
    inside = (pole.real * short) ** 2 + (pole.imag * long) ** 2 < (long * short * quantile) ** 2
    inside = inside | (middle == conversion.pole)
    z = conversion.impedance(middle)
    low, high = (
        torch.complex(
            *(
                torch.where(inside, sign * math.inf, part + changes[2 * i + end])
                for i, part in enumerate((z.real, z.imag))
            )
        )
        for end, sign in enumerate((-1, 1))
    )
    turned = (slope**2 * square).real
    error = (slope.abs() ** 2 * power + torch.stack([turned, -turned])).clamp(min=0).div(2).sqrt()
    return Interval(low, high, torch.complex(*error), runs.expand_as(error[0]), conversion.impedance(value) - z)


def _extremes(axes: Tensor, share: Tensor) -> Tensor:
    """Least and largest real part, least and largest imaginary part of n/(1 - u), (4, N), around ellipses n and u whose
    half axes, complex128, (2, N), are given; n is a multiple of u, or u is 0."""
    angle = 2 * math.pi / ANGLES * torch.arange(ANGLES, dtype=torch.float64, device=share.device)
    circle = torch.stack([angle.cos(), angle.sin()])
    n_real, n_imag, u_real, u_imag = (
        part.T.contiguous() @ circle for part in (axes.real, axes.imag, share.real, share.imag)
    )
    left = 1 - u_real
    scale = (left * left).addcmul_(u_imag, u_imag).reciprocal_()
    real = (n_real * left).addcmul_(n_imag, u_imag, value=-1).mul_(scale)
    imag = n_real.mul_(u_imag).addcmul_(n_imag, left).mul_(scale)
    places = torch.stack([real.argmin(1), real.argmax(1), imag.argmin(1), imag.argmax(1)])
    # The largest real part of these times n/(1 - u) is what is looked for, but for the sign of the least.
    turns = axes.new_tensor([-1, 1, 1j, -1j])[:, None]
    top = _top(axes[:, None] * turns, share[:, None], angle[places])
    return top * angle.new_tensor([-1, 1, -1, 1])[:, None]


def _top(axes: Tensor, share: Tensor, angle: Tensor) -> Tensor:
    """Largest real part of n/(1 - u), (4, N), at angles and where Newton's steps lead from there."""
    top = torch.full_like(angle, -math.inf)
    for _ in range(1 + STEPS):
        cosine, sine = angle.cos(), angle.sin()
        n, u = (pair[0] * cosine + pair[1] * sine for pair in (axes, share))
        by_n, by_u = (pair[1] * cosine - pair[0] * sine for pair in (axes, share))
        over = 1 / (1 - u)
        square = over * over
        top = torch.maximum(top, (n * over).real)
        # By the angle; n' (1 - u) + n u' = n', since n is a multiple of u.
        slope, curve = (by_n * square).real, ((2 * by_n * by_u * over - n) * square).real
        step = torch.where(curve < 0, -slope / curve, 0.0)
        angle = angle + step.clamp(-math.pi / ANGLES, math.pi / ANGLES)
    return top
