r"""Levenberg and Marquardt's method on many problems at once.

With residuals r and their Jacobian J at a place, each step solves :math:`(J^H J + \lambda D) s = -J^H r`, D the
diagonal of :math:`J^H J`. The damping :math:`\lambda` falls tenfold where the step did not raise the cost
:math:`|r|^2`; where it did, the step is refused and the damping rises tenfold. Residuals may be complex if they are
holomorphic in the unknowns.

Where the residual :math:`\Phi(\theta) c - p` is linear in amplitudes c, these are solved for at every place theta
(Golub and Pereyra 1973). With Q an orthonormal basis of the columns of Phi, what is left changes with theta by
:math:`(1 - QQ^H)\,\Phi' c` to the order that Kaufman (1975) keeps, which is analytic in theta where Phi is.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import torch
from torch import Tensor

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-12, 1e10  # beyond the last a problem is given up
SMALLEST = 1e-30  # of the diagonal: an unknown that changes nothing
ROUNDING = 1e-13  # of a cost, by which a step may raise it
SETTLED = 1e-6  # size of a step that may be left where a search ended otherwise

# Problems at their places, leading axes (B, ...): residual r (B, ..., R), Jacobian J (B, ..., R, U), and the amplitudes
# c (B, ..., K) that were solved for at each place.
System = tuple[Tensor, Tensor, Tensor]
Move = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, Tensor | bool]]  # of places, steps and numbers of problems


class Minimum(NamedTuple):
    """Where searches ended: the place (B, ..., P), the system there, and whether the last step was below the tolerance
    or what is left is settled, (B, ...)."""

    place: Tensor
    residual: Tensor
    jacobian: Tensor
    amplitude: Tensor
    converged: Tensor

    @property
    def cost(self) -> Tensor:
        """Sum of squares, (B, ...); inf where the search lost its way."""
        return self.residual.abs().square().sum(-1).nan_to_num(torch.inf)


def best_of(found: Iterable[Minimum]) -> Minimum:
    """Of several minima of the same problems that of least cost each, the first of equal ones."""
    best, *others = found
    for other in others:
        first = best.cost <= other.cost
        best = Minimum(*(torch.where(_over(first, a), a, b) for a, b in zip(best, other, strict=True)))
    return best


def solve_linear(columns: Tensor, target: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The basis Q of columns (..., N, K), the best amplitudes (..., K) and what they leave of p, (..., N)."""
    basis, triangle = torch.linalg.qr(columns)
    inside = basis.mH @ target[..., None]
    amplitude = torch.linalg.solve_triangular(triangle, inside, upper=True)[..., 0]
    return basis, amplitude, target - (basis @ inside)[..., 0]


def project(columns: Tensor, slopes: Tensor, target: Tensor) -> System:
    """The problem at a place, with its amplitudes: Phi, (..., N, K), its derivative by each of U unknowns, (..., U, N,
    K), and p, (..., N)."""
    basis, amplitude, left = solve_linear(columns, target)
    change = (slopes @ amplitude[..., None, :, None])[..., 0].movedim(-2, -1)  # (..., N, U)
    return -left, change - basis @ (basis.mH @ change), amplitude


def least_squares(
    system: Callable[[Tensor, Tensor], System],
    start: Tensor,
    move: Move = lambda place, step, _: (place + step, True),
    *,
    tolerance: float = 1e-10,
    longest: float = 0.3,
    steps: int = 60,
) -> Minimum:
    """Search from every start; problems that are done are left alone while others go on.

    ``system``: of places (B, ..., P) of the problems ``index``, (B,). ``start``: places of all of them; problems along
    further axes share their evaluations, so that those of one row go on together until the last is done. ``move``:
    places after steps (B, ..., U), and whether each can be taken. ``tolerance``, ``longest``: of the last step, of any.
    """
    place, index = start.clone(), torch.arange(len(start), device=start.device)
    found = system(place, index)
    cost = found[0].abs().square().sum(-1)
    damping = torch.full_like(cost, FIRST_DAMPING)
    moved = torch.full_like(cost, torch.inf)
    for _ in range(steps):
        done = (moved < tolerance) | (damping >= MOST_DAMPING)
        on = index[~done.reshape(len(done), -1).all(-1)]
        if not len(on):
            break
        step = damped_step(found[0][on], found[1][on], damping[on])
        size = step.norm(dim=-1)
        step = step * (longest / size[..., None]).clamp(max=1)
        tried, possible = move(place[on], step, on)
        there = system(tried, on)
        rest = there[0].abs().square().sum(-1)
        better = (rest <= (1 + ROUNDING) * cost[on]) & possible
        # A step so small tells as well if rounding of the cost refuses it.
        tells = better | (damping[on] <= 1)
        moved[on] = torch.where(tells, size.clamp(max=longest), moved[on])
        damping[on] = torch.where(better, damping[on] / 10, damping[on] * 10).clamp(LEAST_DAMPING)
        for value, new in zip((place, cost, *found), (tried, rest, *there), strict=True):
            value[on] = torch.where(_over(better, value), new, value[on])
    left = damped_step(*found[:2], torch.full_like(cost, LEAST_DAMPING))
    return Minimum(place, *found, (moved < tolerance) | (left.norm(dim=-1) < SETTLED))


def _over(which: Tensor, values: Tensor) -> Tensor:
    """A choice (B, ...) with axes of 1 behind it, to go with values that have more."""
    return which.reshape(*which.shape, *[1] * (values.ndim - which.ndim))


def damped_step(residual: Tensor, jacobian: Tensor, damping: Tensor) -> Tensor:
    """The step of the module's text, (..., U)."""
    normal = jacobian.mH @ jacobian
    scale = normal.diagonal(dim1=-2, dim2=-1).real.clamp(min=SMALLEST)
    damped = normal + torch.diag_embed(damping[..., None] * scale)
    step: Tensor = torch.linalg.solve(damped, -(jacobian.mH @ residual[..., None]))[..., 0]
    return step
