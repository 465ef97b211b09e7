r"""Roots of analytic functions followed along a parameter, many at once, without jumps.

F(z, t) is analytic in z and linear in t; a root at t = 0 is carried to t = 1 by a tangent step and
Newton's method. Two bounds choose the step of each root by itself, so that a root never lands on
a neighbour: the step is short beside the distance at which F' could vanish,
:math:`|\Delta z\,F''/F'| \le 0.3`, and the Newton-Kantorovich number at the predicted point,
:math:`|F F''/F'^2|`, which must be below 1/2 for the iteration to have one limit, is at most 0.05.
Where two roots meet, F' = 0, the steps shrink to nothing: such a root is reported as stalled,
unless they meet at t = 1 itself, where the pair is found as one root of F/F'.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

REACH, KANTOROVICH = 0.3, 0.05
FIRST_STEP, LONGEST_STEP, SHORTEST_STEP = 0.05, 0.25, 1e-9
CORRECTIONS = 2  # from 0.05 to 1e-5 of the distance at which another root could be
POLISHING = 6
DOUBLE_CORRECTIONS = 12
NEARBY = 1e-3  # a root that stalls short of a double one is within the root of the shortest step
DOUBLE = 1e-12  # of |z|^2: F/F'' at a double root, where z itself has half the digits
MOST_STEPS = 4000


class Values(NamedTuple):
    """F, dF/dz, d2F/dz2 and dF/dt at one point of each item."""

    value: Tensor
    slope: Tensor
    curvature: Tensor
    rate: Tensor


Function = Callable[[Tensor, Tensor, Tensor], Values]


def follow_roots(function: Function, start: Tensor, first_step: float = FIRST_STEP) -> tuple[Tensor, Tensor]:
    """Carry roots from t = 0 to t = 1.

    Args:
        function: ``function(z, t, index)`` gives the values at the items ``index`` of the batch;
            z, t and index have one length.
        start: roots at t = 0, complex128, (N,).  first_step: of t, that is tried.
    Returns:
        Roots at t = 1, (N,), and whether each arrived, (N,); one that stalled stays where it did.
    """
    root = start.clone()
    longest = max(first_step, LONGEST_STEP)
    place = torch.zeros_like(start.real)
    step = torch.full_like(place, first_step)
    todo = torch.arange(len(start), device=start.device)
    for _ in range(MOST_STEPS):
        if not len(todo):
            break
        z, here, ahead = root[todo], place[todo], (place[todo] + step[todo]).clamp(max=1)
        now = function(z, here, todo)
        move = -(ahead - here) * now.rate / now.slope
        guess = z + move
        there = function(guess, ahead, todo)
        bend = (move * now.curvature / now.slope).abs()
        number = (there.value * there.curvature / there.slope**2).abs()
        good = (bend <= REACH) & (number <= KANTOROVICH)  # nan is not
        kept = todo[good]
        root[kept] = _newton(function, guess[good], ahead[good], kept, CORRECTIONS)
        place[kept] = ahead[good]
        step[todo] = torch.where(good, (1.6 * step[todo]).clamp(max=longest), step[todo] / 3)
        todo = todo[(place[todo] < 1) & (step[todo] > SHORTEST_STEP)]
    arrived = place == 1
    last = arrived.nonzero()[:, 0]
    root[last] = _newton(function, root[last], place[last], last, POLISHING)
    return _settle_pairs(function, root, arrived)


def _settle_pairs(function: Function, root: Tensor, arrived: Tensor) -> tuple[Tensor, Tensor]:
    """Stalled roots beside a double root at t = 1 become that root: Newton's method on F/F'."""
    lost = (~arrived).nonzero()[:, 0]
    if not len(lost):
        return root, arrived
    end = torch.ones_like(root[lost].real)
    z = root[lost]
    last = torch.full_like(end, torch.inf)
    for _ in range(DOUBLE_CORRECTIONS):
        f = function(z, end, lost)
        change = f.value * f.slope / (f.slope**2 - f.value * f.curvature)
        z = torch.where(change.abs() < last, z - change, z)
        last = torch.minimum(last, change.abs())
    f = function(z, end, lost)
    double = (f.value / f.curvature).abs() <= DOUBLE * z.abs() ** 2
    double &= (z - root[lost]).abs() <= NEARBY * z.abs()
    found = lost[double]
    root, arrived = root.clone(), arrived.clone()
    root[found], arrived[found] = z[double], True
    return root, arrived


def _newton(function: Function, z: Tensor, t: Tensor, index: Tensor, times: int) -> Tensor:
    """Newton's method; a correction that does not shrink any more is rounding and is left out."""
    last = torch.full_like(z.real, torch.inf)
    for _ in range(times):
        found = function(z, t, index)
        change = found.value / found.slope
        size = change.abs()
        z = torch.where(size < last, z - change, z)
        last = torch.minimum(size, last)
    return z
