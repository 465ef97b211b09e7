r"""The pressures that a duct model offers for a fit, its answers to waves sent into it, over the
wall that is varied, in coordinates in which a rigid wall is near.

The wall is Z = z_1, or over the lined patch Z(x) = z_1 + z_2 s with s from -1 at its upstream edge
to 1 at the other. Steps in Z would march to a rigid wall without end; the coordinates are the
reflection :math:`\rho = (z_1 - 1)/(z_1 + 1)`, which is 1 there, and
:math:`\tau = 2 z_2/(z_1 + 1)^2`, what z_2 adds to it at the downstream edge to first order. Both
ways are holomorphic. The only wall without coordinates, Z = -1, feeds sound.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.autograd.forward_ad as forward_ad
from torch import Tensor

from torchliner.checks import DataWarning
from torchliner.duct.case import other_side
from torchliner.duct.doubts import FED, GAIN, PASSIVE
from torchliner.duct.field import DuctField
from torchliner.duct.solver import DuctSolver
from torchliner.forward_mode import dual_level

NEAREST = 1e-8  # 1 - rho of what counts as rigid: |Z| = 2e8
FARTHEST = 100.0  # |rho|: Z = -1 to 2 %
TOGETHER = 64  # impedances at once


def coordinates(impedance: Tensor) -> Tensor:
    """rho, or rho and tau, (..., P), of z_1, or z_1 and z_2."""
    first = impedance[..., :1]
    rigid = torch.isinf(first)
    rho = torch.where(rigid, 1, (first - 1) / torch.where(rigid, 1, first + 1))
    return bounded(torch.cat([rho, 2 * impedance[..., 1:] / (first + 1) ** 2], -1))


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
    """Of Re z_1, Im z_1, Re z_2, ..., (..., 2 P, 2 P), from that of Re rho, Im rho, ..., to first
    order; diagonal and infinite where the wall is not told from a rigid one."""
    far = 1 / (1 - place[..., :1])
    count = place.shape[-1]
    slope = torch.zeros(*place.shape, count, dtype=place.dtype, device=place.device)
    slope[..., 0, 0] = 2 * far[..., 0] ** 2
    if count == 2:
        slope[..., 1, 0] = 4 * place[..., 1] * far[..., 0] ** 3
        slope[..., 1, 1] = 2 * far[..., 0] ** 2
    # A complex factor a + jb acts on (Re, Im) as [[a, -b], [b, a]].
    rows = torch.stack([torch.stack([slope.real, -slope.imag], -1), torch.stack([slope.imag, slope.real], -1)], -2)
    turn = rows.transpose(-3, -2).flatten(-4, -3).flatten(-2, -1)
    infinite = torch.diag_embed(torch.full_like(covariance[..., 0], torch.inf))
    return torch.where(like_rigid(place, covariance)[..., None, None], infinite, turn @ covariance @ turn.mT)


def like_rigid(place: Tensor, covariance: Tensor, errors: float = 2.0) -> Tensor:
    """Whether a rigid wall lies within some standard errors of rho, (...); everything does where
    the microphones say nothing of the wall, since |1 - rho| of a passive one is at most 2."""
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

    def gains(self, place: Tensor) -> Tensor:
        """Energy out and absorbed over that coming in from the source, (B, F); 0 where the wave of
        no shear layer feeds it."""
        with torch.no_grad():
            balance = self.fields(place)[0].energy
        total = balance.out + balance.absorbed
        fed = (balance.out > GAIN) | (total > FED)
        return torch.where(fed & (balance.absorbed > PASSIVE), total, 0.0)

    def fields(self, place: Tensor) -> list[DuctField]:
        """For each source, of walls at coordinates (B, F, P) of ``wall.py``; warnings of a
        trial are not passed on."""
        start, end = self.solver.case.liner[0]
        wall = impedance_at(place)

        def along(x: Tensor, _: Tensor) -> Tensor:
            return wall[..., :1] + wall[..., 1:] * (2 * (x - start) / (end - start) - 1)

        impedance = wall if wall.shape[-1] == 1 else along
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            return [self.solver.solve(impedance, side) for side in self.sources]

    def response(self, place: Tensor) -> Tensor:
        """h, Pa, (B, F, N, K), for the case's own incident amplitude."""
        return self._at(self.fields(place), self.places)

    def in_parts(self, place: Tensor) -> Tensor:
        """``response``, some walls at a time."""
        return torch.cat([self.response(part) for part in place.split(TOGETHER)])

    def with_slope(self, place: Tensor) -> tuple[Tensor, Tensor]:
        """h, (B, F, N, K), and its forward derivatives by the coordinates, (P, B, F, N, K)."""
        units = torch.eye(place.shape[-1], dtype=place.dtype, device=place.device)
        values, slopes = [], []
        for part in place.split(TOGETHER):
            by_coordinate = []
            for unit in units:
                with dual_level():
                    both = self.response(forward_ad.make_dual(part, unit.expand_as(part).clone()))
                    value, slope = forward_ad.unpack_dual(both)
                by_coordinate.append(slope.detach())
            values.append(value.detach())
            slopes.append(torch.stack(by_coordinate))
        return torch.cat(values), torch.cat(slopes, 1)

    def heard(self, place: Tensor, amplitude: Tensor, along: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """What walls (B, F, P) and amplitudes (B, F, K) make.

        Returns:
            Pressure at the places, Pa, (B, F, N), and at ``along`` (m, (X,)), (B, F, X); of the end
            away from the first source the plane-like mode in over out, (B, F).
        """
        at, lines, ratios = [], [], []
        end = other_side(self.sources[0])
        for some, a in zip(place.split(TOGETHER), amplitude.split(TOGETHER), strict=True):
            fields = self.fields(some)
            waves = torch.stack([torch.stack(field.end_waves(end), -1) for field in fields], -1)
            sent, out = (waves * a[..., None, :]).sum(-1).unbind(-1)
            ratios.append(sent / out)
            at.append((self._at(fields, self.places) * a[..., None, :]).sum(-1))
            lines.append((self._at(fields, along) * a[..., None, :]).sum(-1))
        return torch.cat(at), torch.cat(lines), torch.cat(ratios)

    def _at(self, fields: Sequence[DuctField], places: Tensor) -> Tensor:
        where = places.cpu().numpy()
        return torch.stack([field.wall_pressure(where, self.wall) for field in fields], -1)
