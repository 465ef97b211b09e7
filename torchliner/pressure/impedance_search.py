r"""Least squares over what a duct model offers.

Microphone i hears :math:`\sum_k A_k h_{ik}(Z)`: for each of K waves that are sent into the duct,
one from the source or one from either end, the duct's response h to a unit of it times an amplitude
that is not known. With the measured p_i the residuals are those of :math:`q_i = \sum_k A_k
h_{ik}/p_i`: in the real part of q - 1 relative amplitude, in the imaginary part phase, each over
its stated error. The wall's P coordinates are found by Levenberg and Marquardt's method with the
exact derivative of the field by them (h is holomorphic, so one derivative serves both parts); A, in
which the residuals are linear, is solved for at every place (variable projection: Golub and Pereyra
1973, with Kaufman's step of 1975).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.least_squares import Problem, System, least_squares
from torchliner.pressure.field_model import FieldModel, bounded, coordinates

STEPS = 60
TOLERANCE = 1e-9  # of a step in the wall's coordinates
NEAR = 1e-3  # tolerance of a first search
KEPT = 2  # of the places that first searches end at
SINGULAR = 1e-15  # of the normal matrix with a diagonal of 1: rounding
ALIKE = (1.0, 1.0)  # weights of amplitude and phase that make the widest valleys
# Impedances to begin from: all pairs of resistances and reactances, so many of them.
Grid = tuple[Sequence[float], Sequence[float], int]
STEPS_OF_SIZE = [0.01 * 2000 ** (i / 10) for i in range(11)]  # to 20
COARSE = (
    (0.0, 0.03, 0.1, 0.3, 0.7, 1.5, 3.0, 6.0),
    (-8.0, -4.0, -2.0, -1.0, -0.4, -0.2, -0.1, 0.0, 0.1, 0.2, 0.4, 1.0, 2.0, 4.0), 4,
)  # fmt: skip
FINE = ((0.0, *STEPS_OF_SIZE), (*(-size for size in STEPS_OF_SIZE), 0.0, *STEPS_OF_SIZE), 8)


@dataclass(frozen=True, eq=False)
class Solution:
    """What fits best.

    Args:
        place: coordinates of the wall, (B, F, P).  amplitude: of the responses, (B, F, K).
        covariance: of Re rho, Im rho, Re tau, ..., (B, F, 2 P, 2 P).  cost: chi squared, (B, F).
        converged: (B, F).
    """

    place: Tensor
    amplitude: Tensor
    covariance: Tensor
    cost: Tensor
    converged: Tensor


def constant_wall(model: FieldModel, pressure: Tensor, weights: tuple[float, float], poor: float) -> Solution:
    """The best constant wall for pressures (B, F, N), P = 1, with no guess.

    From the best of a coarse grid of impedances, and of a fine one where chi squared is above
    ``poor``: a wrong minimum looks like a wrong duct.
    """
    found = from_grid(model, pressure, weights, COARSE)
    again = (~(found.cost <= poor)).any(-1)
    if bool(again.any()):
        other = from_grid(model, pressure[again], weights, FINE)
        best = _best([_part_by_part(lambda part: part[again], found), other])
        found = _part_by_part(lambda part, new: part.index_put((again,), new), found, best)
    return found


def _part_by_part(function: Callable[..., Tensor], *found: Solution) -> Solution:
    """A solution of whose parts each is a function of those of others."""
    names = [part.name for part in dataclasses.fields(Solution)]
    return Solution(*(function(*(getattr(one, name) for one in found)) for name in names))


def _best(found: Sequence[Solution]) -> Solution:
    """Of several solutions of the same cases that of least cost, each."""
    cost = torch.stack([one.cost for one in found])
    least = torch.where(torch.isfinite(cost), cost, torch.inf).argmin(0)

    def chosen(*parts: Tensor) -> Tensor:
        each = torch.stack(parts)
        index = least.reshape(1, *least.shape, *[1] * (each.ndim - 3))
        return each.gather(0, index.expand(1, *each.shape[1:]))[0]

    return _part_by_part(chosen, *found)


def from_grid(model: FieldModel, pressure: Tensor, weights: tuple[float, float], grid: Grid) -> Solution:
    """The best constant wall from the best impedances of a grid each.

    Quiet microphones, near a node, make many narrow valleys, and so does a phase that counts more
    than the level. So the impedances of the grid are compared by pressure, not by its logarithm,
    and the first search takes relative errors of both parts alike.
    """
    resistance, reactance, starts = grid
    pairs = [[complex(r, x)] for r in resistance for x in reactance]
    places = coordinates(torch.tensor(pairs, dtype=torch.complex128, device=pressure.device))
    fields = model.in_parts(places[:, None].expand(-1, pressure.shape[-2], -1))
    misfit = torch.stack([_loud_misfit(each, pressure) for each in fields])
    best = places[misfit.topk(starts, 0, largest=False).indices]  # (S, B, F, 1)
    repeated = pressure.repeat(starts, 1, 1)
    rough = search(model, repeated, best.flatten(0, 1), ALIKE, NEAR)
    cost = rough.cost.reshape(best.shape[:-1]).nan_to_num(torch.inf)
    kept = cost.topk(KEPT, 0, largest=False).indices[..., None]
    begin = rough.place.reshape(best.shape).gather(0, kept)
    return _best([search(model, pressure, each, weights) for each in begin])


def _loud_misfit(fields: Tensor, pressure: Tensor) -> Tensor:
    """Of one wall's fields (F, N, K) with the best amplitudes, Pa^2 over Pa^2, (B, F)."""
    amplitude = torch.linalg.pinv(fields) @ pressure[..., None]
    left = (fields @ amplitude)[..., 0] - pressure
    return left.abs().square().sum(-1) / pressure.abs().square().sum(-1)


@dataclass(frozen=True, eq=False)
class WallSearch(Problem):
    """The wall's coordinates as Re rho, Im rho, ..., and the amplitudes, solved for at each place.

    Args:
        model: of the duct.  pressure: Pa, (B, F, N); frequencies share the solutions of a duct.
        weights: 1 over the error of the logarithm of the amplitude, and of the phase in radians.
        tolerance: of the last step.  unknowns: 2 P.
    """

    model: FieldModel
    pressure: Tensor
    weights: tuple[float, float]
    tolerance: float = TOLERANCE
    unknowns: int = 2

    longest = 0.3

    def system(self, place: Tensor, index: Tensor) -> System:
        """Residuals (B, F, 2 N) and their derivatives by Re rho, Im rho, ..., Re A, Im A, ..."""
        pressure = self.pressure[index]
        fields, slopes = self.model.with_slope(place)
        amplitude = _linear_amplitude(fields, pressure, self.weights)
        by_place = _over(slopes, amplitude, pressure)
        columns = [turn * by for by in by_place for turn in (1, 1j)]
        first = torch.stack([_residual(column, self.weights) for column in columns], -1)
        jacobian = torch.cat([first, _by_amplitude(fields, pressure, self.weights)], -1)
        left = _over(fields, amplitude, pressure) - 1
        return System(_residual(left, self.weights), jacobian, amplitude)

    def move(self, place: Tensor, step: Tensor, index: Tensor) -> tuple[Tensor, Tensor | bool]:
        """Walls within the bounds of the coordinates."""
        del index
        return bounded(place + torch.complex(step[..., ::2], step[..., 1::2])), True


def search(
    model: FieldModel, pressure: Tensor, start: Tensor, weights: tuple[float, float],
    tolerance: float = TOLERANCE,
) -> Solution:  # fmt: skip
    """The minimum next to coordinates of the wall, (B, F, P), for pressures (B, F, N)."""
    unknowns = 2 * start.shape[-1]
    problem = WallSearch(model, pressure, weights, tolerance, unknowns)
    found = least_squares(problem, start.to(torch.complex128), STEPS)
    jacobian = found.system.jacobian
    covariance = _inverse(jacobian.mT @ jacobian)[..., :unknowns, :unknowns]
    return Solution(found.place, found.system.amplitude, covariance, found.system.cost, found.converged)


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
