r"""Least squares over what a duct model offers.

Microphone i hears :math:`\sum_k A_k h_{ik}(Z)`: for each of K waves that are sent into the duct, one from the source or
one from either end, the duct's response h to a unit of it times an amplitude that is not known. With the measured p_i
the residuals are those of :math:`q_i = \sum_k A_k h_{ik}/p_i`: in the real part of q - 1 relative amplitude, in the
imaginary part phase, each over its stated error. The wall's P coordinates (``field_model.py``) are found by Levenberg
and Marquardt's method with the exact derivative of the field by them (h is holomorphic, so one derivative serves both
parts); A is solved for at every place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.least_squares import Minimum, Problem, System, best_of, least_squares, project, solve_linear
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
SIZES = (0.1, 0.2, 0.4, 1.0, 2.0, 4.0)
COARSE: Grid = ((0.0, 0.03, 0.1, 0.3, 0.7, 1.5, 3.0, 6.0), (-8.0, *(-x for x in SIZES[::-1]), 0.0, *SIZES), 4)
FINE: Grid = ((0.0, *STEPS_OF_SIZE), (*(-size for size in STEPS_OF_SIZE), 0.0, *STEPS_OF_SIZE), 8)


@dataclass(frozen=True, eq=False)
class WallSearch(Problem):
    """The wall's coordinates as Re rho, Im rho, ..."""

    model: FieldModel
    pressure: Tensor  # Pa, (B, F, N); frequencies share the solutions of a duct
    weights: tuple[float, float]  # 1 over the error of the amplitude's logarithm, and of the phase in radians
    tolerance: float = TOLERANCE  # of the last step

    longest = 0.3

    def system(self, place: Tensor, index: Tensor) -> System:
        """Residuals (B, F, 2 N) and their derivatives by Re rho, Im rho, ..., with Re A, Im A, ..."""
        pressure = self.pressure[index]
        fields, slopes = self.model.with_slope(place)  # (B, F, N, K), (P, B, F, N, K)
        by_place = torch.stack([self._in_parts(turn * each, pressure) for each in slopes for turn in (1, 1j)], -3)
        one = torch.ones_like(pressure)
        target = torch.cat([one.real * self.weights[0], one.imag * self.weights[1]], -1)
        return project(self._in_parts(fields, pressure), by_place, target)

    def _in_parts(self, fields: Tensor, pressure: Tensor) -> Tensor:
        """What amplitudes Re A, Im A, ... add to level and phase, over their errors, (..., F, 2 N, 2 K)."""
        share = fields / pressure[..., None]
        both = torch.stack([share, 1j * share], -1).flatten(-2)
        return torch.cat([both.real * self.weights[0], both.imag * self.weights[1]], -2)

    def move(self, place: Tensor, step: Tensor, index: Tensor) -> tuple[Tensor, Tensor | bool]:
        """Walls within the bounds of the coordinates."""
        return bounded(place + torch.complex(step[..., ::2], step[..., 1::2])), True


def search(
    model: FieldModel, pressure: Tensor, start: Tensor, weights: tuple[float, float], tolerance: float = TOLERANCE
) -> Minimum:
    """The minimum next to coordinates of the wall, (B, F, P), for pressures (B, F, N); Re A, Im A, ... with it."""
    return least_squares(WallSearch(model, pressure, weights, tolerance), start.to(torch.complex128), STEPS)


def constant_wall(model: FieldModel, pressure: Tensor, weights: tuple[float, float], poor: float) -> Minimum:
    """The best constant wall for pressures (B, F, N), P = 1, with no guess: from a coarse grid of impedances, and from
    a fine one where chi squared is above ``poor``, since a wrong minimum looks like a wrong duct."""
    found = from_grid(model, pressure, weights, COARSE)
    again = (found.cost > poor).any(-1)
    if bool(again.any()):
        fine = from_grid(model, pressure[again], weights, FINE)
        for part, new in zip(found, best_of([Minimum(*(part[again] for part in found)), fine]), strict=True):
            part[again] = new
    return found


def from_grid(model: FieldModel, pressure: Tensor, weights: tuple[float, float], grid: Grid) -> Minimum:
    """The best constant wall from the best impedances of a grid each.

    Quiet microphones, near a node, make many narrow valleys, and so does a phase that counts more than the level. So
    the impedances of the grid are compared by pressure, not by its logarithm, and the first search takes relative
    errors of both parts alike.
    """
    resistance, reactance, starts = grid
    pairs = [[complex(r, x)] for r in resistance for x in reactance]
    places = coordinates(torch.tensor(pairs, dtype=torch.complex128, device=pressure.device))
    fields = model.in_parts(places[:, None].expand(-1, pressure.shape[-2], -1))  # (G, F, N, K)
    misfit = torch.stack([solve_linear(each, pressure)[-1].norm(dim=-1) for each in fields])
    best = places[misfit.topk(starts, 0, largest=False).indices]  # (S, B, F, 1)
    rough = search(model, pressure.repeat(starts, 1, 1), best.flatten(0, 1), ALIKE, NEAR)
    kept = rough.cost.reshape(best.shape[:-1]).topk(KEPT, 0, largest=False).indices[..., None]
    begin = rough.place.reshape(best.shape).gather(0, kept)
    return best_of(search(model, pressure, each, weights) for each in begin)


def covariance_of(found: Minimum) -> Tensor:
    """Of Re rho, Im rho, Re tau, ..., (B, F, 2 P, 2 P), for the errors that the weights are from; large, not 0 as of a
    pseudo-inverse, where nothing is known."""
    normal = found.jacobian.mT @ found.jacobian
    scale = normal.diagonal(dim1=-2, dim2=-1).clamp(min=1e-30).rsqrt()
    by = scale[..., :, None] * scale[..., None, :]
    values, vectors = torch.linalg.eigh(normal * by)
    inverse: Tensor = by * ((vectors / values.clamp(min=SINGULAR)[..., None, :]) @ vectors.mT)
    return inverse
