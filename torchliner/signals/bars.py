"""The sums behind error bars of many columns."""

from __future__ import annotations

import math

import torch
from torch import Tensor

ANGLES = 32  # on the ellipse; with a parabola through the best three 1e-4 of half a width, and 1e-2
# where the ellipse comes half as near to the pole as its centre


def neighbours(series: Tensor) -> Tensor:
    """Sums over the blocks of |d|^2 and of the product with the next block's d, (2, N), where d is
    a complex128 (S, N) less its mean."""
    parts = torch.stack([series.real, series.imag])
    away = parts - parts.mean(1, keepdim=True)
    count = len(series)
    return torch.stack([(away[:, begin:] * away[:, : count - begin]).sum((0, 1)) for begin in (0, 1)])


def forms(series: Tensor, covariances: Tensor, which: Tensor) -> Tensor:
    """x'Cx, y'Cy and x'Cy of the real parts x and imaginary parts y of each column, (3, N).

    Args:
        series: complex128, (S, N).
        covariances: C, float64, (L, S, S).
        which: of them each column has, int64, (N,).
    """
    # In real parts, (2, S, N), whose sums over blocks are several times as fast.
    parts = torch.stack([series.real, series.imag])
    sums = parts.new_empty(3, series.shape[1])
    for number, covariance in enumerate(covariances):
        mine = (which == number).nonzero()[:, 0]
        own = parts.index_select(2, mine)
        turned = covariance @ own
        cross = own[0] * turned[1]
        sums[:, mine] = torch.stack([*(own.mul_(turned)).sum(1), cross.sum(0)])
    return sums


def extremes(ahead: Tensor, share: Tensor) -> Tensor:
    """Least and largest real part, least and largest imaginary part of n/(1 - u), (4, N), around
    ellipses n and u whose half axes, complex128, (2, N), are given."""
    angle = math.tau / ANGLES * torch.arange(ANGLES, dtype=torch.float64, device=share.device)
    circle = torch.stack([angle.cos(), angle.sin()])
    n_real, n_imaginary, u_real, u_imaginary = (
        each.T.contiguous() @ circle for each in (ahead.real, ahead.imag, share.real, share.imag)
    )
    left = u_real.neg_().add_(1)
    scale = (left * left).addcmul_(u_imaginary, u_imaginary).reciprocal_()
    real = (n_real * left).addcmul_(n_imaginary, u_imaginary, value=-1).mul_(scale)
    imaginary = n_real.mul_(u_imaginary).addcmul_(n_imaginary, left).mul_(scale)
    return torch.stack([_peak(part, sign) for part in (real, imaginary) for sign in (-1, 1)])


def _peak(values: Tensor, sign: int) -> Tensor:
    """Largest (sign 1) or least (-1) value of a smooth periodic function at equal steps, (N, A):
    (N,)."""
    top, place = values.max(1) if sign > 0 else values.min(1)
    steps = (place[:, None] + torch.tensor([-1, 1], device=place.device)) % values.shape[1]
    before, after = values.gather(1, steps).unbind(1)
    curve = 2 * top - before - after
    return top + torch.where(sign * curve > 0, (after - before) ** 2 / (8 * curve), 0.0)
