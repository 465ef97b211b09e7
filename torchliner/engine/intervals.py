r"""How far a result may be off because its record is finite: a delete-run jackknife, for everything.

Every result is a function of sums over S blocks. It is computed once from all blocks and once without each of them
(``replicates``): its change without block s, times :math:`-(1 - w_s)`, is what block s contributes to it, to first
order: :math:`u_s`. The jackknife over all runs of L neighbouring blocks gives the variance

.. math:: \frac{S}{L}\,\frac{S}{S - L}\;\operatorname{mean}_i\Big|\sum_{k < L} u_{i + k}\Big|^2 .

The run length follows from the correlation of neighbouring blocks (Andrews 1991), which a tone beside turbulence can
make negative. The interval takes Student's quantile with S/L - 1 degrees of freedom, and its bounds are without the
bias of a result that is not linear in its sums. The bias is estimated without each quarter of the record: single blocks
are not independent.

Complex results scatter by :math:`E|d|^2` and :math:`E[d^2]`: an ellipse in the plane of R. The bounds of resistance and
reactance are the extremes of Z on that ellipse, Student's quantile times as large. Where it encloses the pole of Z
(R = 1, a rigid wall) the record does not bound Z and the bounds are infinite, as Fieller's theorem says of any ratio.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from scipy.special import stdtrit
from torch import Tensor

from torchliner.conversions import impedance_from_admittance, impedance_from_reflection
from torchliner.records.educed import Interval

SHORTEST_RUN = 2  # blocks: the correlation across a block's border is always allowed for
MOST_CORRELATED = 0.9
FEWEST_BLOCKS = 4  # two runs
FEWEST_RUNS = 8  # below, an interval says little
ROUNDED = 1e-14  # in R: nearer to the pole it is at it
SMALLEST_WIDTH = 1e-9  # of an interval: what is steady leaves rounding
QUARTERS = 4  # each long enough to hold most of the correlation
BENT = 8.0  # an ellipse is small beside its distance to the pole if Z bends this many times less than it moves
ANGLES, STEPS = 64, 2  # tried on a larger ellipse, and of Newton's method from the best


def replicates(sums: Tensor, lengths: Tensor | None = None, *, every: bool = True) -> Tensor:
    """From sums over blocks, (S, ...), those over all blocks, without each block, then without each quarter of them:
    (1 + S + 4, ...); divided by the ``lengths`` of what is left, from those of the blocks, (S,), if these are given.
    Those over all blocks alone, (1, ...), unless ``every``."""
    own = torch.eye(len(sums), dtype=torch.float64, device=sums.device)
    quarters = torch.stack([quarter.sum(0) for quarter in own.tensor_split(QUARTERS)])
    kept = torch.cat([torch.ones_like(own[:1]), 1 - own, 1 - quarters])[: None if every else 1]
    if lengths is not None:
        kept = kept / (kept @ lengths)[:, None]
    return (kept.to(sums.dtype) @ sums.flatten(1)).unflatten(1, sums.shape[1:])


def correlation(power: Tensor, neighbours: Tensor, count: int, least: float = 0.0) -> Tensor:
    """rho of neighbouring blocks, ``least`` to 0.9, from sums over S blocks of |d|^2 and of products of neighbours.

    What taking the mean off hides of it, (1 + 4 rho)/S, is added (Marriott and Pope, Biometrika 41, 1954, 390).
    """
    rho = torch.where(power > 0, neighbours / power.clamp(min=1e-300), 0.0)
    return (rho + (1 + 4 * rho) / count).clamp(least, MOST_CORRELATED)


class Conversion(NamedTuple):
    """How Z follows from what is resampled, a function of first degree over first degree: Z of it, dZ by it, and
    where Z is infinite."""

    impedance: Callable[[Tensor], Tensor]
    slope: Callable[[Tensor], Tensor]
    pole: complex


FROM_REFLECTION = Conversion(impedance_from_reflection, lambda r: 2 / (1 - r) ** 2, 1)
FROM_ADMITTANCE = Conversion(impedance_from_admittance, lambda y: -1 / y**2, 0)
ITSELF = Conversion(lambda z: z, torch.ones_like, 1e30)  # nowhere near


def jackknife(values: Tensor, shares: Tensor, level: float, conversion: Conversion = FROM_REFLECTION) -> Interval:
    """Interval of Z at every place, (...), from ``values`` as of ``replicates``, complex128, (1 + S + 4, ...), S at
    least 4; ``shares`` of each block in the whole record, w, of sum 1, float64, (S,); ``level`` 0 to 1."""
    value, count = values[0], len(shares)
    power, square, lengths = scatter(values[1 : 1 + count].flatten(1), shares)
    possible = torch.arange(1, count + 1, dtype=torch.float64)
    student = torch.from_numpy(stdtrit((count / possible - 1).clamp(min=1).numpy(), 0.5 + level / 2))
    weight = torch.stack([1 - quarter.sum() for quarter in shares.tensor_split(QUARTERS)])
    bias = (weight[:, None] * (values[1 + count :] - value).flatten(1)).sum(0)
    quantile = student.to(value.device)[lengths - 1]
    return impedance_interval(value, bias, power, square, quantile, count / lengths.double(), conversion)


def scatter(left: Tensor, shares: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    r"""E|d|^2 and E[d^2] of the deviation d of results, and the blocks of a run, (N,) each.

    A run has :math:`1.1447\,(4 \rho^2 S/(1-\rho^2)^2)^{1/3}` blocks, at least 2, at most S/4. For a correlation
    :math:`\rho^k` of blocks k apart the mean varies as :math:`(1 + \rho)/(1 - \rho)`; a run of L has none from
    :math:`k = L` on and :math:`1 - k/L` of what there is before, which is allowed for. ``left``: the results without
    each block, complex128, (S, N).

    Source: Andrews, Econometrica 59 (1991), eqs (6.2), (6.4), for runs of blocks.
    """
    kept, count = (1 - shares)[:, None], len(shares)
    centre = (kept * left).sum(0) / (count - 1)  # of a linear result its value, whatever the shares
    own = (centre - left) * kept
    power = own.abs().square().sum(0)
    rho = correlation(power, (own[1:] * own[:-1].conj()).real.sum(0), count, -MOST_CORRELATED)
    best = 1.1447 * (4 * rho**2 / (1 - rho**2) ** 2 * count) ** (1 / 3)
    lengths = best.ceil().to(torch.int64).clamp(SHORTEST_RUN, max(SHORTEST_RUN, count // 4))

    total = torch.nn.functional.pad(own.cumsum(0), (0, 0, 1, 0))
    end = torch.arange(count, device=own.device)[:, None] + lengths
    runs = (total.gather(0, end.clamp(max=count)) - total[:-1]) * (end <= count)
    number, whole = lengths.double(), (1 + rho) / (1 - rho)
    factor = count / number * count / (count - number) / (count - number + 1)
    factor = factor * whole / (whole - 2 * rho * (1 - rho**lengths) / (lengths * (1 - rho) ** 2))
    return factor * runs.abs().square().sum(0), factor * (runs * runs).sum(0), lengths


def impedance_interval(
    value: Tensor, bias: Tensor, power: Tensor, square: Tensor, quantile: Tensor, runs: Tensor, conversion: Conversion
) -> Interval:
    """Bounds of Z and its standard error, of one shape; infinite where the record does not bound Z.

    ``bias`` is what ``value`` is off in the mean; ``power`` and ``square`` are E|d|^2 and E[d^2] of its scatter d;
    ``quantile`` is of Student's distribution.
    """
    shape = value.shape
    value, bias, power, square, quantile, runs = map(torch.flatten, (value, bias, power, square, quantile, runs))
    middle = value - bias
    # d = e^{jt} (long cos a + j short sin a), t half the angle of E[d^2].
    long, short = (quantile * ((power + sign * square.abs()).clamp(min=0) / 2).sqrt() for sign in (1, -1))
    turn = torch.exp(0.5j * square.angle())
    axes = torch.stack([long * turn, 1j * short * turn])
    slope, z = conversion.slope(middle), conversion.impedance(middle)
    pole = conversion.pole - middle
    changes, along = _extremes(slope * pole, axes / pole), pole * turn.conj()
    inside = ((along.real * short) ** 2 + (along.imag * long) ** 2 < (long * short) ** 2) | (pole.abs() < ROUNDED)
    bounds = [
        torch.where(inside, sign * math.inf, part + change)
        for sign, part, change in zip((-1, 1, -1, 1), (z.real, z.real, z.imag, z.imag), changes, strict=True)
    ]
    turned = (slope**2 * square).real
    error = (slope.abs() ** 2 * power + torch.stack([turned, -turned])).clamp(min=0).div(2).sqrt()
    low, high = torch.complex(bounds[0], bounds[2]), torch.complex(bounds[1], bounds[3])
    found = (low, high, torch.complex(*error), runs.expand_as(z), conversion.impedance(value) - z)
    return Interval(*(each.reshape(shape) for each in found))


def _extremes(factor: Tensor, axes: Tensor) -> Tensor:
    """Least and largest real part, least and largest imaginary part of k u/(1 - u), (4, N), around an ellipse u of half
    axes (2, N) about 0; ``factor``: k, (N,)."""
    # The largest real part of these times u/(1 - u) is what is looked for, but for the sign of the least.
    turned = factor * factor.new_tensor([-1, 1, 1j, -1j])[:, None]
    along, reach = (turned * axes[:, None]).real, axes.abs().sum(0)
    angle = torch.atan2(along[1], along[0])  # of a small ellipse: there u/(1 - u) is nearly u
    bent = (torch.hypot(*along) * (1 - reach).clamp(min=0) < BENT * factor.abs() * reach**2).any(0)
    # The best of ``ANGLES`` on the larger ones; single precision is enough for that. On a CPU only those are looked at.
    some = bent.nonzero()[:, 0] if axes.is_cpu else torch.arange(len(bent), device=axes.device)
    tried = 2 * math.pi / ANGLES * torch.arange(ANGLES, dtype=torch.float32, device=axes.device)
    u = axes[:, some].T.to(torch.complex64) @ torch.stack([tried.cos(), tried.sin()]).to(torch.complex64)
    w = factor[some].sgn().to(u)[:, None] * u / (1 - u)
    best = torch.stack([w.real.argmin(1), w.real.argmax(1), w.imag.argmin(1), w.imag.argmax(1)])
    angle[:, some] = torch.where(bent[some], 2 * math.pi / ANGLES * best.double(), angle[:, some])

    top, cosine, sine = torch.full_like(angle, -math.inf), angle.cos(), angle.sin()
    for step in range(1 + STEPS):
        u = axes[0] * cosine + axes[1] * sine
        over = 1 / (1 - u)
        scaled = turned * over
        top = torch.maximum(top, (scaled * u).real)
        if step < STEPS:  # Newton: by the angle k u' over^2 and k over^2 (2 over u'^2 - u), since u'' = -u
            by_u, scaled = axes[1] * cosine - axes[0] * sine, scaled * over
            slope, curve = (scaled * by_u).real, (scaled * (2 * over * by_u * by_u - u)).real
            tangent = torch.where(curve < 0, -slope / curve, 0.0).clamp(-math.pi / ANGLES, math.pi / ANGLES)
            shorter = torch.rsqrt(1 + tangent * tangent)
            cosine, sine = (cosine - tangent * sine) * shorter, (sine + tangent * cosine) * shorter
    return top * top.new_tensor([-1, 1, -1, 1])[:, None]
