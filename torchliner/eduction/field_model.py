r"""The pressures that a duct model offers for a fit, and the least squares over them.

Microphone i hears :math:`\sum_k A_k h_{ik}(Z)`: for each of K waves that are sent into the duct,
one from the source or one from either end, the duct's response h to a unit of it times an amplitude
that is not known. With the measured p_i the residuals are those of :math:`q_i = \sum_k A_k
h_{ik}/p_i`: in the real part of q - 1 relative amplitude, in the imaginary part phase, each over
its stated error. The unknowns, Z and A, are found by Levenberg and Marquardt's method with the
exact derivative of the field by Z (h is holomorphic in Z, so one derivative serves both parts).

The wall is Z = z_1, or over the lined patch Z(x) = z_1 + z_2 (2 t - 1), t = 0 at its upstream edge
and 1 at the other: P = 1 or 2 complex parameters.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.autograd.forward_ad as forward_ad
from torch import Tensor

from torchliner.checks import DataWarning
from torchliner.duct.duct_field import DuctField
from torchliner.duct.lee import DuctSolver

STEPS = 60
TOLERANCE, SETTLED = 1e-9, 1e-6  # of a step taken, and of one left, relative to 1 + |Z|
START_R = (0.0, 0.03, 0.1, 0.3, 0.7, 1.5, 3.0, 6.0)
START_X = (-8.0, -4.0, -2.0, -1.0, -0.4, -0.2, -0.1, 0.0, 0.1, 0.2, 0.4, 1.0, 2.0, 4.0)
STARTS = 4
TOGETHER = 64  # impedances at once


@dataclass(frozen=True, eq=False)
class FieldModel:
    """Responses of a duct to the waves sent into it.

    Args:
        solver: the duct.
        sources: sides that waves are sent from, (K,).
        places: x, m, (N,).
        wall: of the places, ``opposite`` or ``lined``.
    """

    solver: DuctSolver
    sources: Sequence[str]
    places: Tensor
    wall: str

    def fields(self, wall: Tensor) -> list[DuctField]:
        """For each source, of walls z (B, F, P); doubts of a trial are not passed on."""
        start, end = self.solver.case.liner[0]

        def along(x: Tensor, _: Tensor) -> Tensor:
            return wall[..., :1] + wall[..., 1:] * (2 * (x - start) / (end - start) - 1)

        impedance = wall if wall.shape[-1] == 1 else along
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            return [self.solver.solve(impedance, side) for side in self.sources]

    def response(self, wall: Tensor) -> Tensor:
        """h, Pa, (B, F, N, K), for the case's own incident amplitude."""
        places = self.places.cpu().numpy()
        return torch.stack(
            [field.wall_pressure(places, self.wall) for field in self.fields(wall)], -1
        )

    def in_parts(self, wall: Tensor) -> Tensor:
        """``response``, some walls at a time."""
        return torch.cat([self.response(part) for part in wall.split(TOGETHER)])

    def with_slope(self, wall: Tensor) -> tuple[Tensor, Tensor]:
        """h, (B, F, N, K), and its forward derivatives by z, (P, B, F, N, K)."""
        units = torch.eye(wall.shape[-1], dtype=wall.dtype, device=wall.device)
        values, slopes = [], []
        for part in wall.split(TOGETHER):
            by_z = []
            for unit in units:
                with forward_ad.dual_level():
                    both = self.response(forward_ad.make_dual(part, unit.expand_as(part).clone()))
                    value, slope = forward_ad.unpack_dual(both)
                by_z.append(slope.detach())
            values.append(value.detach())
            slopes.append(torch.stack(by_z))
        return torch.cat(values), torch.cat(slopes, 1)

    def end_reflection(self, wall: Tensor, amplitude: Tensor, end: str) -> Tensor:
        """Plane-like mode in over out at an end, (B, F), of amplitudes (B, F, K)."""
        parts = []
        split = zip(wall.split(TOGETHER), amplitude.split(TOGETHER), strict=True)
        for z, a in split:
            waves = [torch.stack(field.end_waves(end), -1) for field in self.fields(z)]
            sent, out = (torch.stack(waves, -2) * a[..., None]).sum(-2).unbind(-1)
            parts.append(sent / out)
        return torch.cat(parts)


@dataclass(frozen=True, eq=False)
class Solution:
    """What fits best.

    Args:
        wall: z, (B, F, P).
        amplitude: of the responses, (B, F, K).
        covariance: of Re z_1, Im z_1, Re z_2, ..., (B, F, 2 P, 2 P).
        cost: chi squared, (B, F).
        converged: (B, F).
    """

    wall: Tensor
    amplitude: Tensor
    covariance: Tensor
    cost: Tensor
    converged: Tensor


def from_grid(model: FieldModel, pressure: Tensor, weights: tuple[float, float]) -> Solution:
    """The best constant wall for pressures (B, F, N), P = 1, with no guess.

    From the best of a coarse grid of impedances each, since a soft wall has minima beside the true
    one.
    """
    values = [complex(r, x) for r in START_R for x in START_X]
    grid = torch.tensor(values, dtype=torch.complex128, device=pressure.device)
    fields = model.in_parts(grid[:, None, None].expand(-1, pressure.shape[-2], -1))[:, None]
    amplitude = _linear_amplitude(fields, pressure)
    misfit = _residual(_over(fields, amplitude, pressure) - 1, weights).square().sum(-1)
    starts = grid[misfit.topk(STARTS, 0, largest=False).indices]  # (S, B, F)
    tried = least_squares(
        model, pressure.repeat(STARTS, 1, 1), starts.flatten(0, 1)[..., None], weights
    )
    cost = tried.cost.reshape(STARTS, *pressure.shape[:2])
    best = torch.where(torch.isfinite(cost), cost, torch.inf).argmin(0)

    def chosen(values: Tensor) -> Tensor:
        each = values.reshape(STARTS, *best.shape, *values.shape[2:])
        index = best.reshape(1, *best.shape, *[1] * (values.ndim - 2)).expand(1, *each.shape[1:])
        return each.gather(0, index)[0]

    return Solution(*(chosen(getattr(tried, part.name)) for part in dataclasses.fields(tried)))


def least_squares(
    model: FieldModel, pressure: Tensor, start: Tensor, weights: tuple[float, float]
) -> Solution:
    """Levenberg and Marquardt's method on all cases, draws and frequencies at once.

    Args:
        model: of the duct.
        pressure: Pa, (B, F, N).
        start: z, (B, F, P).
        weights: 1 over the error of the logarithm of the amplitude, and of the phase in radians.
    """
    z = start.to(torch.complex128).clone()  # a view of one number cannot carry a tangent
    count = z.shape[-1]
    a = _linear_amplitude(model.in_parts(z), pressure)
    residual, jacobian = _system(model, z, a, pressure, weights)
    cost = residual.square().sum(-1)
    damping = torch.full_like(cost, 1e-3)
    moved = torch.full_like(cost, torch.inf)
    for _ in range(STEPS):
        step = _damped_step(residual, jacobian, damping)
        by_part = torch.complex(step[..., ::2], step[..., 1::2])
        new_z, new_a = z + by_part[..., :count], a + _scale(a) * by_part[..., count:]
        new_residual, new_jacobian = _system(model, new_z, new_a, pressure, weights)
        new_cost = new_residual.square().sum(-1)
        better = new_cost <= cost
        moved = torch.where(better, _size(step, z), moved)
        z, a = (torch.where(better[..., None], *pair) for pair in ((new_z, z), (new_a, a)))
        residual = torch.where(better[..., None], new_residual, residual)
        jacobian = torch.where(better[..., None, None], new_jacobian, jacobian)
        cost = torch.where(better, new_cost, cost)
        damping = torch.where(better, damping / 10, damping * 10).clamp(1e-12, 1e12)
        stuck = damping >= 1e8
        if bool(((moved < TOLERANCE) | stuck).all()):
            break
    # Rounding of the cost may refuse the last steps; what is left to go tells as well.
    left = _size(_damped_step(residual, jacobian, torch.full_like(cost, 1e-12)), z)
    covariance = torch.linalg.pinv(jacobian.mT @ jacobian, hermitian=True)
    covariance = covariance[..., : 2 * count, : 2 * count]
    return Solution(z, a, covariance, cost, (moved < TOLERANCE) | (left < SETTLED))


def _size(step: Tensor, wall: Tensor) -> Tensor:
    """Of a step's part in z, relative, (B, F)."""
    size: Tensor = step[..., : 2 * wall.shape[-1]].norm(dim=-1) / (1 + wall[..., 0].abs())
    return size


def _over(fields: Tensor, amplitude: Tensor, pressure: Tensor) -> Tensor:
    """q, (..., F, N)."""
    return (fields * amplitude[..., None, :]).sum(-1) / pressure


def _linear_amplitude(fields: Tensor, pressure: Tensor) -> Tensor:
    """A of least relative error, (..., F, K)."""
    ratio = fields / pressure[..., None]
    gram = torch.linalg.pinv(ratio.mH @ ratio, hermitian=True)
    found: Tensor = (gram @ ratio.mH.sum(-1, keepdim=True))[..., 0]
    return found


def _residual(away: Tensor, weights: tuple[float, float]) -> Tensor:
    """Real and imaginary parts over their errors, (..., 2 N)."""
    return torch.cat([away.real * weights[0], away.imag * weights[1]], -1)


def _scale(amplitude: Tensor) -> Tensor:
    """Amplitudes move relative to the first, so that the size of the pressures does not matter."""
    return amplitude[..., :1].abs()


def _system(
    model: FieldModel, wall: Tensor, amplitude: Tensor, pressure: Tensor,
    weights: tuple[float, float],
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Residuals (B, F, 2 N) and their derivatives by Re z, Im z, ..., Re A, Im A, ... (B, F, 2 N,
    2 P + 2 K), the amplitudes over ``_scale``."""
    fields, slopes = model.with_slope(wall)
    ratio = _over(fields, amplitude, pressure)
    by_z = _over(slopes, amplitude, pressure)
    by_a = fields * _scale(amplitude)[..., None] / pressure[..., None]
    columns = [turn * by for by in (*by_z, *by_a.unbind(-1)) for turn in (1, 1j)]
    jacobian = torch.stack([_residual(column, weights) for column in columns], -1)
    return _residual(ratio - 1, weights), jacobian


def _damped_step(residual: Tensor, jacobian: Tensor, damping: Tensor) -> Tensor:
    normal = jacobian.mT @ jacobian
    scale = normal.diagonal(dim1=-2, dim2=-1).clamp(min=1e-30)
    damped = normal + torch.diag_embed(damping[..., None] * scale)
    right = -(jacobian.mT @ residual[..., None])
    step: Tensor = torch.linalg.solve(damped, right)[..., 0]
    return step
