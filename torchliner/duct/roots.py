r"""Roots of analytic functions, many at once: Newton's method, and roots followed without jumps.

F(z, t) is analytic in z; a root at t = 0 is carried to t = 1 by a tangent step and Newton's method. Two
bounds choose the step of each root by itself, so that a root never lands on a neighbour. F' may change
over the step by 0.3 at most: the step is short beside the distance at which F' could vanish. And the
Newton-Kantorovich number at the predicted point, :math:`|F F''/F'^2|`, which must be below 1/2 for the
iteration to have one limit, is at most 0.05; it is by how much F' changes over the first correction.
Where two roots meet, F' = 0, the steps shrink to nothing: such a root is reported as stalled, unless
they meet at t = 1 itself, where F' = 0 is solved for the two.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

REACH, KANTOROVICH = 0.3, 0.05
FIRST_STEP, LONGEST_STEP, SHORTEST_STEP = 0.05, 0.25, 1e-9
POLISHING = 8
ROUNDING = 1e-13  # of |z|: a correction that polishes no more
DOUBLE_CORRECTIONS = 12
NEARBY = 1e-3  # a root that stalls short of a double one is within the root of the shortest step
DOUBLE = 1e-12  # of |z|^2: F/F'' at a double root, where z itself has half the digits
APART = 1e-5  # of |z|: of differences of F'
MOST_STEPS = 4000

# function(z, t, index): F, dF/dz and dF/dt at the items ``index`` of a batch; z, t and index have one length.
Function = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, Tensor, Tensor]]


def with_slope(function: Callable[[Tensor], Tensor], z: Tensor) -> tuple[Tensor, Tensor]:
    """An analytic function and its derivative at z, (N,), where no item depends on another's z."""
    with torch.enable_grad():
        place = z.detach().requires_grad_()
        value = function(place)
        (slope,) = torch.autograd.grad(value, place, torch.ones_like(value))
    return value.detach(), slope.conj()


def newton(function: Function, z: Tensor, t: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
    """Newton's method from z, (N,): the roots, and the size of each one's last correction.

    A correction that does not shrink any more is rounding, or a sign that no root is near, and is left out.
    """
    last = torch.full_like(z.real, torch.inf)
    for _ in range(POLISHING):
        value, slope, _ = function(z, t, index)
        change = value / slope
        size = change.abs()
        z = torch.where(size < last, z - change, z)
        last = torch.where(size < last, size, last)
        if bool((last <= ROUNDING * z.abs()).all()):
            break
    return z, last


def follow_roots(function: Function, start: Tensor, first_step: float = FIRST_STEP) -> tuple[Tensor, Tensor]:
    """Carry roots from t = 0 to t = 1.

    Args:
        function: F, as above.  start: roots at t = 0, complex128, (N,).  first_step: of t, that is tried.
    Returns:
        Roots at t = 1, (N,), and how far each came, (N,): 1, or less for one that stalled and stayed there.
    """
    root, place = start.clone(), torch.zeros_like(start.real)
    step = torch.full_like(place, first_step)
    longest = max(first_step, LONGEST_STEP)
    todo = torch.arange(len(start), device=start.device)
    _, slope, rate = function(root, place, todo)
    for _ in range(MOST_STEPS):
        if not len(todo):
            break
        ahead = (place[todo] + step[todo]).clamp(max=1)
        move = -(ahead - place[todo]) * rate[todo] / slope[todo]
        guess = root[todo] + move
        value, there, _ = function(guess, ahead, todo)
        nearer = guess - value / there
        value, after, turn = function(nearer, ahead, todo)
        good = (there / slope[todo] - 1).abs() <= REACH
        good &= (after / there - 1).abs() <= KANTOROVICH  # nan is not
        kept = todo[good]
        slope[kept], rate[kept] = after[good], turn[good]
        root[kept], place[kept] = (nearer - value / after)[good], ahead[good]
        step[todo] = torch.where(good, (1.6 * step[todo]).clamp(max=longest), step[todo] / 3)
        todo = todo[(place[todo] < 1) & (step[todo] > SHORTEST_STEP)]
    last = (place == 1).nonzero()[:, 0]
    root[last], _ = newton(function, root[last], place[last], last)
    return _settle_pairs(function, root, place)


def _settle_pairs(function: Function, root: Tensor, place: Tensor) -> tuple[Tensor, Tensor]:
    """Stalled roots beside a double root at t = 1 become that root: F' = 0, by differences of F'."""
    lost = (place < 1).nonzero()[:, 0]
    if not len(lost):
        return root, place
    end, z = torch.ones_like(place[lost]), root[lost]
    last = torch.full_like(end, torch.inf)
    for _ in range(DOUBLE_CORRECTIONS):
        apart = APART * z.abs()
        ahead, behind = (function(z + side * apart, end, lost)[1] for side in (1, -1))
        value, slope, _ = function(z, end, lost)
        curvature = (ahead - behind) / (2 * apart)
        change = slope / curvature
        z = torch.where(change.abs() < last, z - change, z)
        last = torch.minimum(last, change.abs())
    value, _, _ = function(z, end, lost)
    double = (value / curvature).abs() <= DOUBLE * z.abs() ** 2
    double &= (z - root[lost]).abs() <= NEARBY * z.abs()
    root[lost[double]], place[lost[double]] = z[double], 1.0
    return root, place
