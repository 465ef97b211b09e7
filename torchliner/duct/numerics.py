r"""Polynomials through given points of 0 to 1, and roots of analytic functions: Newton's method, roots followed.

A polynomial is its N values at the points; Legendre coefficients lead from them to what is asked for.

F(z, t) is analytic; a root at t = 0 is carried to t = 1 by tangent steps and Newton's method. A step never lands on a
neighbour: F' may change over it by 0.3, the Newton-Kantorovich number |F F''/F'^2| there is 0.05 at most. Where two
roots meet, F' = 0, the steps shrink to nothing and the root stalls, unless they meet at t = 1.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from torchliner.duct.flow_profiles import Array

REACH, KANTOROVICH = 0.3, 0.05
LONGEST_STEP, SHORTEST_STEP, MOST_STEPS = 0.25, 1e-9, 4000
POLISHING, HALVINGS = 8, 40  # Newton's steps to a simple root, and to a double one
ROUNDING = 1e-13  # of |z|: a correction that polishes no more
NOISE = 1e-6  # of |z|: a correction below it that does not shrink is rounding; double roots have half the digits
NEARBY = 1e-3  # of |z|: a root that stalls short of a double one is that near to it

# function(z, t, index): F, dF/dz and dF/dt at the items ``index`` of a batch; z, t and index have one length.
Function = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, Tensor, Tensor]]


def gauss_points(count: int) -> tuple[Array, Array]:
    """Gauss points and weights of 0 to 1, (N,) each."""
    places, weights = legendre.leggauss(count)
    return (1 + places) / 2, weights / 2


def chebyshev_points(count: int) -> Array:
    """Gauss-Lobatto points of Chebyshev, increasing from 0 to 1, (N,)."""
    return np.sin(np.pi * np.arange(count) / (count - 1) / 2) ** 2  # (1 - cos)/2 without cancellation


def interpolation_matrix(points: Array, places: ArrayLike) -> Array:
    """Values at ``places`` from those at the points, (P, N)."""
    return _values(_coefficients(points), places)


def derivative_matrix(points: Array) -> Array:
    """Derivatives at the points, (N, N)."""
    return _values(2 * legendre.legder(_coefficients(points), axis=0), points)


def integral_matrix(points: Array) -> Array:
    """Integrals from 0 to each point, (N, N)."""
    return _values(legendre.legint(_coefficients(points), lbnd=-1, axis=0) / 2, points)


def _values(coefficients: NDArray[Any], places: ArrayLike) -> Array:
    return legendre.legvander(2 * np.asarray(places, np.float64) - 1, len(coefficients) - 1) @ coefficients


def _coefficients(points: Array) -> Array:
    """Legendre coefficients of the polynomials that are 1 at one point and 0 at the others, (N, N)."""
    return np.asarray(np.linalg.inv(legendre.legvander(2 * points - 1, len(points) - 1)), np.float64)


def with_slopes(function: Callable[..., Tensor], *at: Tensor) -> tuple[Tensor, ...]:
    """An analytic function and its derivative by each argument, (N,), where no item depends on another's."""
    with torch.enable_grad():
        places = [each.detach().to(torch.complex128).requires_grad_() for each in at]
        value = function(*places)
        slopes = torch.autograd.grad(value, places, torch.ones_like(value))
    return value.detach(), *(slope.conj() for slope in slopes)


def follow_roots(function: Function, start: Tensor, first_step: float = LONGEST_STEP) -> tuple[Tensor, Tensor]:
    """Carry roots, complex128, (N,), from t = 0 to t = 1; ``first_step`` of the way is tried first.

    Returns:
        Roots, (N,), and how far each came, (N,): 1, or less for one that stalled and stayed there.
    """
    root, place = start.clone(), torch.zeros_like(start.real)
    step, longest = torch.full_like(place, first_step), max(first_step, LONGEST_STEP)
    todo = torch.arange(len(start), device=start.device)
    _, slope, rate = function(root, place, todo)
    for _ in range(MOST_STEPS):
        if not len(todo):
            break
        ahead = (place[todo] + step[todo]).clamp(max=1)
        guess = root[todo] - (ahead - place[todo]) * rate[todo] / slope[todo]
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
    for arrived, steps in ((True, POLISHING), (False, HALVINGS)):
        index = ((place == 1) == arrived).nonzero()[:, 0]
        z, end = root[index], torch.ones_like(place[index])
        last = torch.full_like(end, torch.inf)
        for _ in range(steps if len(index) else 0):  # Newton's method, but for small corrections that grow
            value, slope, _ = function(z, end, index)
            change = value / slope
            moves = (change.abs() < last) | (change.abs() > NOISE * z.abs())
            last = torch.where(moves, change.abs(), last)
            z = torch.where(moves, z - change, z)
            if bool((last <= ROUNDING * z.abs()).all()):
                break
        near = (last <= NOISE * z.abs()) & ((z - root[index]).abs() <= NEARBY * z.abs())
        settled = near | arrived
        root[index[settled]], place[index[settled]] = z[settled], 1.0
    return root, place
