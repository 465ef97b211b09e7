r"""Pressures that a duct model offers for a fit, its answers to waves sent into it, over the wall that is varied, in
coordinates in which a rigid wall is near.

The wall is Z = z_1, or over the lined patch Z(x) = z_1 + z_2 s with s from -1 at its upstream edge to 1 at the other.
Steps in Z would march to a rigid wall without end; the coordinates are the reflection
:math:`\rho = (z_1 - 1)/(z_1 + 1)`, which is 1 there, and :math:`\tau = 2 z_2/(z_1 + 1)^2`, what z_2 adds to it at the
downstream edge to first order. Both ways are holomorphic. The only wall without coordinates, Z = -1, feeds sound.
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
from torchliner.forward_mode import dual_level

NEAREST = 1e-8  # 1 - rho of what counts as rigid: |Z| = 2e8
FARTHEST = 100.0  # |rho|: Z = -1 to 2 %
TOGETHER = 64  # impedances at once


def coordinates(impedance: Tensor) -> Tensor:
    """rho, or rho and tau, (..., P), of z_1, or z_1 and z_2."""
    first = impedance[..., :1]
    return bounded(torch.cat([reflection_from_impedance(first), 2 * impedance[..., 1:] / (first + 1) ** 2], -1))


def bounded(place: Tensor) -> Tensor:
    """With rho moved off 1 and infinity, where Z has no number or is -1."""
    rho = place[..., :1]
    rho = rho * (FARTHEST / rho.abs().clamp(min=FARTHEST))
    moved = torch.where((1 - rho).abs() < NEAREST, 1 - NEAREST, rho)
    return torch.cat([moved, place[..., 1:]], -1)


def impedance_at(place: Tensor) -> Tensor:
    """z_1, or z_1 and z_2, (..., P), of rho, or rho and tau."""
    rho, tau = place[..., :1], place[..., 1:]
    return torch.cat([(1 + rho) / (1 - rho), 2 * tau / (1 - rho) ** 2], -1)


def impedance_covariance(place: Tensor, covariance: Tensor) -> Tensor:
    """Of Re z_1, Im z_1, Re z_2, ..., (..., 2 P, 2 P), from that of Re rho, Im rho, ..., to first order; diagonal and
    infinite where the wall is not told from a rigid one."""
    far, count = 1 / (1 - place[..., :1]), place.shape[-1]
    slope = torch.diag_embed((2 * far**2).expand(place.shape))
    if count == 2:
        slope[..., 1, 0] = 4 * place[..., 1] * far[..., 0] ** 3
    # A step in Im rho is j times one in Re rho: (..., i, j, Re or Im of rho, Re or Im of Z) as a real matrix.
    by_part = torch.view_as_real(torch.stack([slope, 1j * slope], -1))
    turn = by_part.movedim(-1, -3).flatten(-4, -3).flatten(-2, -1)
    infinite = torch.diag_embed(torch.full_like(covariance[..., 0], torch.inf))
    return torch.where(like_rigid(place, covariance)[..., None, None], infinite, turn @ covariance @ turn.mT)


def like_rigid(place: Tensor, covariance: Tensor, errors: float = 2.0) -> Tensor:
    """Whether a rigid wall lies within some standard errors of rho, (...); everything does where the microphones say
    nothing of the wall, since |1 - rho| of a passive one is at most 2."""
    variance = covariance.diagonal(dim1=-2, dim2=-1)[..., :2].sum(-1)
    return (1 - place[..., 0]).abs() < errors * variance.clamp(min=0).sqrt()


@dataclass(frozen=True, eq=False)
class FieldModel:
    """Responses of a duct to the waves sent into it.

    Args:
        solver: the duct.  sources: sides that waves are sent from, (K,).  places: x, m, (N,).
        wall: of the places, ``opposite`` or ``lined``.
    """

    solver: DuctSolver
    sources: Sequence[str]
    places: Tensor
    wall: str

    def fields(self, place: Tensor) -> list[DuctField]:
        """For each source, of walls at coordinates (B, F, P); warnings of a trial are not passed on."""
        start, end = self.solver.case.liner[0]
        wall = impedance_at(place)

        def along(x: Tensor, _: Tensor) -> Tensor:
            return wall[..., :1] + wall[..., 1:] * (2 * (x - start) / (end - start) - 1)

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            return [self.solver.solve(wall if wall.shape[-1] == 1 else along, side) for side in self.sources]

    def response(self, place: Tensor) -> Tensor:
        """h, Pa, (B, F, N, K), for the case's own incident amplitude."""
        return self._at(self.fields(place), self.places)

    def in_parts(self, place: Tensor) -> Tensor:
        """``response``, some walls at a time."""
        return torch.cat([self.response(part) for part in place.split(TOGETHER)])

    def with_slope(self, place: Tensor) -> tuple[Tensor, Tensor]:
        """h, (B, F, N, K), and its forward derivatives by the coordinates, (P, B, F, N, K)."""
        slopes = []
        for unit in torch.eye(place.shape[-1], dtype=place.dtype, device=place.device):
            with dual_level():
                both = [
                    forward_ad.unpack_dual(self.response(forward_ad.make_dual(part, unit.expand_as(part).clone())))
                    for part in place.split(TOGETHER)
                ]
                value, slope = (torch.cat([each.detach() for each in parts]) for parts in zip(*both, strict=True))
            slopes.append(slope)
        return value, torch.stack(slopes)

    def gains(self, place: Tensor) -> Tensor:
        """Energy out and absorbed over that coming in from the source, (B, F); 0 where the wave of no shear layer feeds
        it."""
        with torch.no_grad():
            return self.fields(place)[0].energy.fed

    def heard(self, place: Tensor, amplitude: Tensor, along: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """What walls (B, F, P) and amplitudes (B, F, K) make.

        Returns:
            Pressure at the places, Pa, (B, F, N), and at ``along`` (m, (X,)), (B, F, X); of the end away from the first
            source the plane-like mode in over out, (B, F).
        """
        found, end = [], other_side(self.sources[0])
        for some, a in zip(place.split(TOGETHER), amplitude.split(TOGETHER), strict=True):
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
