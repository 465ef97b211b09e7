r"""Least squares over what a duct model offers.

Microphone i hears :math:`\sum_k A_k h_{ik}(Z)`: for each of K waves that are sent into the duct,
one from the source or one from either end, the duct's response h to a unit of it times an amplitude
that is not known. With the measured p_i the residuals are those of :math:`q_i = \sum_k A_k
h_{ik}/p_i`: in the real part of q - 1 relative amplitude, in the imaginary part phase, each over
its stated error. The unknowns, the wall's P coordinates and A, are found by Levenberg and
Marquardt's method with the exact derivative of the field by the former (h is holomorphic in them,
so one derivative serves both parts).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.eduction.field_model import FieldModel
from torchliner.eduction.fitted_wall import bounded, coordinates

STEPS = 60
TOLERANCE, SETTLED = 1e-9, 1e-6  # of a step taken, and of one left, in the wall's coordinates
FARTHEST = 0.3  # step in the wall's coordinates
SINGULAR = 1e-15  # of the normal matrix with a diagonal of 1: rounding
ALIKE = (1.0, 1.0)  # weights of amplitude and phase that make the widest valleys


@dataclass(frozen=True)
class Grid:
    """Impedances to begin from.

    Args:
        resistance, reactance: all pairs of them.
        starts: how many of the pairs are begun from.
    """

    resistance: Sequence[float]
    reactance: Sequence[float]
    starts: int


STEPS_OF_SIZE = [0.01 * 2000 ** (i / 10) for i in range(11)]  # to 20
COARSE = Grid(
    (0.0, 0.03, 0.1, 0.3, 0.7, 1.5, 3.0, 6.0),
    (-8.0, -4.0, -2.0, -1.0, -0.4, -0.2, -0.1, 0.0, 0.1, 0.2, 0.4, 1.0, 2.0, 4.0),
    4,
)
FINE = Grid((0.0, *STEPS_OF_SIZE), (*(-size for size in STEPS_OF_SIZE), 0.0, *STEPS_OF_SIZE), 8)


@dataclass(frozen=True, eq=False)
class Solution:
    """What fits best.

    Args:
        place: coordinates of the wall, (B, F, P).
        amplitude: of the responses, (B, F, K).
        covariance: of Re rho, Im rho, Re tau, ..., (B, F, 2 P, 2 P).
        cost: chi squared, (B, F).
        converged: (B, F).
    """

    place: Tensor
    amplitude: Tensor
    covariance: Tensor
    cost: Tensor
    converged: Tensor


def constant_wall(
    model: FieldModel, pressure: Tensor, weights: tuple[float, float], poor: float
) -> Solution:
    """The best constant wall for pressures (B, F, N), P = 1, with no guess.

    From the best of a coarse grid of impedances, and of a fine one where chi squared is above
    ``poor``: a wrong minimum looks like a wrong duct.
    """
    found = from_grid(model, pressure, weights, COARSE)
    again = (~(found.cost <= poor)).any(-1)
    if bool(again.any()):
        other = from_grid(model, pressure[again], weights, FINE)
        both = [_of_cases(found, again), other]
        best = _best(both)
        parts = {}
        for part in dataclasses.fields(best):
            values = getattr(found, part.name).clone()
            values[again] = getattr(best, part.name)
            parts[part.name] = values
        found = Solution(**parts)
    return found


def _of_cases(found: Solution, which: Tensor) -> Solution:
    return Solution(*(getattr(found, part.name)[which] for part in dataclasses.fields(found)))


def _best(found: Sequence[Solution]) -> Solution:
    """Of several solutions of the same cases that of least cost, each."""
    cost = torch.stack([one.cost for one in found])
    least = torch.where(torch.isfinite(cost), cost, torch.inf).argmin(0)

    def chosen(name: str) -> Tensor:
        each = torch.stack([getattr(one, name) for one in found])
        index = least.reshape(1, *least.shape, *[1] * (each.ndim - 3))
        return each.gather(0, index.expand(1, *each.shape[1:]))[0]

    return Solution(*(chosen(part.name) for part in dataclasses.fields(found[0])))


def from_grid(
    model: FieldModel, pressure: Tensor, weights: tuple[float, float], grid: Grid
) -> Solution:
    """The best constant wall from the best impedances of a grid each.

    Quiet microphones, near a node, make many narrow valleys, and so does a phase that counts more
    than the level. So the impedances of the grid are compared by pressure, not by its logarithm,
    and the first search takes relative errors of both parts alike.
    """
    values = [complex(r, x) for r in grid.resistance for x in grid.reactance]
    places = coordinates(
        torch.tensor(values, dtype=torch.complex128, device=pressure.device)[:, None]
    )
    fields = model.in_parts(places[:, None].expand(-1, pressure.shape[-2], -1))
    misfit = torch.stack([_loud_misfit(each, pressure) for each in fields])
    best = places[misfit.topk(grid.starts, 0, largest=False).indices]  # (S, B, F, 1)
    begin, count = best.flatten(0, 1), grid.starts
    begin = least_squares(model, pressure.repeat(count, 1, 1), begin, ALIKE).place
    tried = least_squares(model, pressure.repeat(count, 1, 1), begin, weights)
    each = zip(*(getattr(tried, part.name).chunk(count) for part in dataclasses.fields(tried)),
               strict=True)  # fmt: skip
    return _best([Solution(*parts) for parts in each])


def _loud_misfit(fields: Tensor, pressure: Tensor) -> Tensor:
    """Of one wall's fields (F, N, K) with the best amplitudes, Pa^2 over Pa^2, (B, F)."""
    amplitude = torch.linalg.pinv(fields) @ pressure[..., None]
    left = (fields @ amplitude)[..., 0] - pressure
    return left.abs().square().sum(-1) / pressure.abs().square().sum(-1)


def least_squares(
    model: FieldModel, pressure: Tensor, start: Tensor, weights: tuple[float, float]
) -> Solution:
    """Levenberg and Marquardt's method on all cases, draws and frequencies at once.

    Args:
        model: of the duct.
        pressure: Pa, (B, F, N).
        start: coordinates of the wall, (B, F, P).
        weights: 1 over the error of the logarithm of the amplitude, and of the phase in radians.
    """
    place = start.to(torch.complex128).clone()  # a view of one number cannot carry a tangent
    count = place.shape[-1]
    a, residual, jacobian = _system(model, place, pressure, weights)
    cost = residual.square().sum(-1)
    damping = torch.full_like(cost, 1e-3)
    moved = torch.full_like(cost, torch.inf)
    for _ in range(STEPS):
        step = _damped_step(residual, jacobian, damping)[..., : 2 * count]
        step = step * (FARTHEST / step.norm(dim=-1, keepdim=True)).clamp(max=1)
        new_place = bounded(place + torch.complex(step[..., ::2], step[..., 1::2]))
        new_a, new_residual, new_jacobian = _system(model, new_place, pressure, weights)
        new_cost = new_residual.square().sum(-1)
        better = new_cost <= cost
        moved = torch.where(better, step.norm(dim=-1), moved)
        place, a = (
            torch.where(better[..., None], *pair) for pair in ((new_place, place), (new_a, a))
        )
        residual = torch.where(better[..., None], new_residual, residual)
        jacobian = torch.where(better[..., None, None], new_jacobian, jacobian)
        cost = torch.where(better, new_cost, cost)
        damping = torch.where(better, damping / 10, damping * 10).clamp(1e-12, 1e12)
        stuck = damping >= 1e8
        if bool(((moved < TOLERANCE) | stuck).all()):
            break
    # Rounding of the cost may refuse the last steps; what is left to go tells as well.
    step = _damped_step(residual, jacobian, torch.full_like(cost, 1e-12))[..., : 2 * count]
    left = step.norm(dim=-1)
    covariance = _inverse(jacobian.mT @ jacobian)[..., : 2 * count, : 2 * count]
    return Solution(place, a, covariance, cost, (moved < TOLERANCE) | (left < SETTLED))


def _inverse(normal: Tensor) -> Tensor:
    """Of a normal matrix; large, not 0 as in a pseudo-inverse, where nothing is known."""
    scale = normal.diagonal(dim1=-2, dim2=-1).clamp(min=1e-30).rsqrt()
    by = scale[..., :, None] * scale[..., None, :]
    values, vectors = torch.linalg.eigh(normal * by)
    found: Tensor = by * ((vectors / values.clamp(min=SINGULAR)[..., None, :]) @ vectors.mT)
    return found


def _over(fields: Tensor, amplitude: Tensor, pressure: Tensor) -> Tensor:
    """q, (..., F, N)."""
    return (fields * amplitude[..., None, :]).sum(-1) / pressure


def _linear_amplitude(fields: Tensor, pressure: Tensor, weights: tuple[float, float]) -> Tensor:
    """A of least weighted error, (..., F, K)."""
    matrix = _by_amplitude(fields, pressure, weights)
    size = matrix.norm(dim=-2).clamp(min=1e-300)
    goal = _residual(torch.ones_like(fields[..., 0]), weights)[..., None]
    scaled = matrix / size[..., None, :]
    found = torch.linalg.pinv(scaled.mT @ scaled, hermitian=True) @ (scaled.mT @ goal)
    parts = found[..., 0] / size
    return torch.complex(parts[..., ::2], parts[..., 1::2])


def _by_amplitude(fields: Tensor, pressure: Tensor, weights: tuple[float, float]) -> Tensor:
    """Derivatives of the residuals by Re A, Im A, ..., (..., F, 2 N, 2 K)."""
    columns = [turn * by / pressure for by in fields.unbind(-1) for turn in (1, 1j)]
    return torch.stack([_residual(column, weights) for column in columns], -1)


def _residual(away: Tensor, weights: tuple[float, float]) -> Tensor:
    """Real and imaginary parts over their errors, (..., 2 N)."""
    return torch.cat([away.real * weights[0], away.imag * weights[1]], -1)


def _system(
    model: FieldModel, place: Tensor, pressure: Tensor, weights: tuple[float, float]
) -> tuple[Tensor, Tensor, Tensor]:
    """Best amplitudes (B, F, K), residuals (B, F, 2 N) and their derivatives by Re rho, Im rho,
    ..., Re A, Im A, ... (B, F, 2 N, 2 P + 2 K)."""
    fields, slopes = model.with_slope(place)
    amplitude = _linear_amplitude(fields, pressure, weights)
    by_place = _over(slopes, amplitude, pressure)
    columns = [turn * by for by in by_place for turn in (1, 1j)]
    first = torch.stack([_residual(column, weights) for column in columns], -1)
    jacobian = torch.cat([first, _by_amplitude(fields, pressure, weights)], -1)
    return amplitude, _residual(_over(fields, amplitude, pressure) - 1, weights), jacobian


def _damped_step(residual: Tensor, jacobian: Tensor, damping: Tensor) -> Tensor:
    normal = jacobian.mT @ jacobian
    scale = normal.diagonal(dim1=-2, dim2=-1).clamp(min=1e-30)
    damped = normal + torch.diag_embed(damping[..., None] * scale)
    right = -(jacobian.mT @ residual[..., None])
    step: Tensor = torch.linalg.solve(damped, right)[..., 0]
    return step
