r"""The wall that a fit of the field varies, in coordinates in which a rigid wall is near.

The wall is Z = z_1, or over the lined patch Z(x) = z_1 + z_2 s with s from -1 at its upstream edge
to 1 at the other. Steps in Z would march to a rigid wall without end; the coordinates are the
reflection :math:`\rho = (z_1 - 1)/(z_1 + 1)`, which is 1 there, and
:math:`\tau = 2 z_2/(z_1 + 1)^2`, what z_2 adds to it at the downstream edge to first order. Both
ways are holomorphic. The only wall without coordinates, Z = -1, feeds sound.
"""

from __future__ import annotations

import torch
from torch import Tensor

NEAREST = 1e-8  # 1 - rho of what counts as rigid: |Z| = 2e8
FARTHEST = 100.0  # |rho|: Z = -1 to 2 %


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
    rows = torch.stack([torch.stack([slope.real, -slope.imag], -1),
                        torch.stack([slope.imag, slope.real], -1)], -2)  # fmt: skip
    turn = rows.transpose(-3, -2).flatten(-4, -3).flatten(-2, -1)
    infinite = torch.diag_embed(torch.full_like(covariance[..., 0], torch.inf))
    return torch.where(
        like_rigid(place, covariance)[..., None, None], infinite, turn @ covariance @ turn.mT
    )


def like_rigid(place: Tensor, covariance: Tensor, errors: float = 2.0) -> Tensor:
    """Whether a rigid wall lies within some standard errors of rho, (...); everything does where
    the microphones say nothing of the wall, since |1 - rho| of a passive one is at most 2."""
    variance = covariance.diagonal(dim1=-2, dim2=-1)[..., :2].sum(-1)
    return (1 - place[..., 0]).abs() < errors * variance.clamp(min=0).sqrt()
