r"""Least squares over the waves that a duct model offers.

Microphone i hears :math:`\sum_k A_k h_{ik}(\rho)`: for each of K waves sent into the duct, one from the source or one
from either end, the duct's response h to a unit of it times an amplitude that is not known. With the measured p_i the
residuals are those of :math:`q_i = \sum_k A_k h_{ik}/p_i`: in the real part of q - 1 relative amplitude, in the
imaginary part phase, each over its stated error. The wall is sought as its reflection :math:`\rho = (Z - 1)/(Z + 1)`,
since steps in Z would march to a rigid wall without end. Levenberg and Marquardt's method takes the exact derivative of
the field by rho (h is holomorphic, so one derivative serves both parts); A is solved for at every place.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.autograd.forward_ad as forward_ad
from torch import Tensor

from torchliner.checks import DataWarning
from torchliner.conversions import reflection_from_impedance
from torchliner.duct.case import other_side
from torchliner.duct.field import DuctField
from torchliner.duct.solver import DuctSolver
from torchliner.least_squares import Minimum, Problem, System, best_of, dual_level, least_squares, project, solve_linear

NEAREST = 1e-8  # 1 - rho of what counts as rigid: |Z| = 2e8
FARTHEST = 100.0  # |rho|: Z = -1 to 2 %
TOGETHER = 64  # impedances at once
STEPS = 60
TOLERANCE = 1e-9  # of a step in rho
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


def bounded(rho: Tensor) -> Tensor:
    """Moved off 1 and infinity, where Z has no number or is -1."""
    rho = rho * (FARTHEST / rho.abs().clamp(min=FARTHEST))
    return torch.where((1 - rho).abs() < NEAREST, 1 - NEAREST, rho)


def impedance_at(rho: Tensor) -> Tensor:
    """Z of a reflection."""
    return (1 + rho) / (1 - rho)


def like_rigid(rho: Tensor, covariance: Tensor, errors: float = 2.0) -> Tensor:
    """Whether a rigid wall lies within some standard errors of rho, (...)."""
    variance = covariance.diagonal(dim1=-2, dim2=-1).sum(-1)
    return (1 - rho).abs() < errors * variance.clamp(min=0).sqrt()


def impedance_covariance(rho: Tensor, covariance: Tensor) -> Tensor:
    """Of Re Z and Im Z, (..., 2, 2), from that of Re rho and Im rho, to first order; diagonal and infinite where the
    wall is not told from a rigid one."""
    slope = 2 / (1 - rho) ** 2
    turn = torch.stack([torch.stack([slope.real, -slope.imag], -1), torch.stack([slope.imag, slope.real], -1)], -2)
    infinite = torch.diag_embed(torch.full_like(covariance[..., 0], torch.inf))
    return torch.where(like_rigid(rho, covariance)[..., None, None], infinite, turn @ covariance @ turn.mT)


@dataclass(frozen=True, eq=False)
class FieldModel:
    """Responses of a duct to the waves sent into it."""

    solver: DuctSolver
    sources: Sequence[str]  # sides that waves are sent from, (K,)
    places: Tensor  # x, m, (N,)
    wall: str  # of the places, ``opposite`` or ``lined``

    def fields(self, rho: Tensor) -> list[DuctField]:
        """For each source, of walls (B, F, 1); warnings of a trial are not passed on."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            return [self.solver.solve(impedance_at(rho), side) for side in self.sources]

    def response(self, rho: Tensor) -> Tensor:
        """h, Pa, (B, F, N, K), for the case's own incident amplitude."""
        return self._at(self.fields(rho), self.places)

    def with_slope(self, rho: Tensor) -> tuple[Tensor, Tensor]:
        """h and its derivative by rho, (B, F, N, K)."""
        with dual_level():
            both = [
                forward_ad.unpack_dual(self.response(forward_ad.make_dual(part, torch.ones_like(part))))
                for part in rho.split(TOGETHER)
            ]
            value, slope = (torch.cat([each.detach() for each in parts]) for parts in zip(*both, strict=True))
        return value, slope

    def gains(self, rho: Tensor) -> Tensor:
        """Energy out and absorbed over that coming in from the source, (B, F); 0 where the wave of no shear layer feeds
        it."""
        with torch.no_grad():
            return self.fields(rho)[0].energy.fed

    def heard(self, rho: Tensor, amplitude: Tensor, along: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Pressure of walls (B, F, 1) and amplitudes (B, F, K) at the places, Pa, (B, F, N), and at ``along`` (m,
        (X,)), (B, F, X); of the end away from the first source the plane-like mode in over out, (B, F)."""
        found, end = [], other_side(self.sources[0])
        for some, a in zip(rho.split(TOGETHER), amplitude.split(TOGETHER), strict=True):
            fields = self.fields(some)
            waves = torch.stack([torch.stack(field.end_waves(end), -1) for field in fields], -1)
            sent, out = (waves * a[..., None, :]).sum(-1).unbind(-1)
            lines = [(self._at(fields, each) * a[..., None, :]).sum(-1) for each in (self.places, along)]
            found.append((*lines, sent / out))
        at, between, ratio = (torch.cat(each) for each in zip(*found, strict=True))
        return at, between, ratio

    def _at(self, fields: Sequence[DuctField], places: Tensor) -> Tensor:
        where = places.cpu().numpy()
        return torch.stack([field.wall_pressure(where, self.wall) for field in fields], -1)


@dataclass(frozen=True, eq=False)
class WallSearch(Problem):
    """rho as Re rho, Im rho."""

    model: FieldModel
    pressure: Tensor  # Pa, (B, F, N); frequencies share the solutions of a duct
    weights: tuple[float, float]  # 1 over the error of the amplitude's logarithm, and of the phase in radians
    tolerance: float = TOLERANCE  # of the last step

    longest = 0.3

    def system(self, place: Tensor, index: Tensor) -> System:
        """Residuals (B, F, 2 N) and their derivatives by Re rho, Im rho, with Re A, Im A, ..."""
        pressure = self.pressure[index]
        fields, slope = self.model.with_slope(place)
        by_place = torch.stack([self._in_parts(turn * slope, pressure) for turn in (1, 1j)], -3)
        one = torch.ones_like(pressure.real)
        target = torch.cat([one * self.weights[0], 0 * one], -1)
        return project(self._in_parts(fields, pressure), by_place, target)

    def _in_parts(self, fields: Tensor, pressure: Tensor) -> Tensor:
        """What amplitudes Re A, Im A, ... add to level and phase, over their errors, (..., F, 2 N, 2 K)."""
        share = fields / pressure[..., None]
        both = torch.stack([share, 1j * share], -1).flatten(-2)
        return torch.cat([both.real * self.weights[0], both.imag * self.weights[1]], -2)

    def move(self, place: Tensor, step: Tensor, index: Tensor) -> tuple[Tensor, Tensor | bool]:
        """Walls within the bounds of rho."""
        del index
        return bounded(place + torch.complex(step[..., ::2], step[..., 1::2])), True


def search(
    model: FieldModel, pressure: Tensor, start: Tensor, weights: tuple[float, float], tolerance: float = TOLERANCE
) -> Minimum:
    """The minimum next to walls rho, (B, F, 1), for pressures (B, F, N); Re A, Im A, ... with it."""
    return least_squares(WallSearch(model, pressure, weights, tolerance), start.to(torch.complex128), STEPS)


def best_wall(model: FieldModel, pressure: Tensor, weights: tuple[float, float], poor: float) -> Minimum:
    """The best wall for pressures (B, F, N), with no guess: from a coarse grid of impedances, and a fine one where chi
    squared is above ``poor``, since a wrong minimum looks like a wrong duct."""
    found = from_grid(model, pressure, weights, COARSE)
    again = (found.cost > poor).any(-1)
    if bool(again.any()):
        fine = from_grid(model, pressure[again], weights, FINE)
        for part, new in zip(found, best_of([Minimum(*(part[again] for part in found)), fine]), strict=True):
            part[again] = new
    return found


def from_grid(model: FieldModel, pressure: Tensor, weights: tuple[float, float], grid: Grid) -> Minimum:
    """The best wall from the best impedances of a grid each.

    Quiet microphones, near a node, make many narrow valleys, and so does a phase that counts more than the level. So
    the impedances of the grid are compared by pressure, not by its logarithm, and the first search takes relative
    errors of both parts alike.
    """
    resistance, reactance, starts = grid
    walls = torch.tensor([complex(r, x) for r in resistance for x in reactance], dtype=torch.complex128)
    places = bounded(reflection_from_impedance(walls)).to(pressure.device)[:, None]
    parts = places[:, None].expand(-1, pressure.shape[-2], -1).split(TOGETHER)
    fields = torch.cat([model.response(part) for part in parts])  # (G, F, N, K)
    misfit = torch.stack([solve_linear(each, pressure)[-1].norm(dim=-1) for each in fields])
    best = places[misfit.topk(starts, 0, largest=False).indices]  # (S, B, F, 1)
    rough = search(model, pressure.repeat(starts, 1, 1), best.flatten(0, 1), ALIKE, NEAR)
    kept = rough.cost.reshape(best.shape[:-1]).topk(KEPT, 0, largest=False).indices[..., None]
    begin = rough.place.reshape(best.shape).gather(0, kept)
    return best_of(search(model, pressure, each, weights) for each in begin)


def covariance_of(found: Minimum) -> Tensor:
    """Of Re rho and Im rho, (B, F, 2, 2), for the errors that the weights are from; large, and not 0 as of a
    pseudo-inverse, where nothing is known."""
    normal = found.jacobian.mT @ found.jacobian
    scale = normal.diagonal(dim1=-2, dim2=-1).clamp(min=1e-30).rsqrt()
    by = scale[..., :, None] * scale[..., None, :]
    values, vectors = torch.linalg.eigh(normal * by)
    inverse: Tensor = by * ((vectors / values.clamp(min=SINGULAR)[..., None, :]) @ vectors.mT)
    return inverse
