r"""A liner between rigid walls without flow, by mode matching.

With yh = 1 - y/H, kappa = k H, the rigid duct carries cos(n pi yh), the lined part cos(g_m yh) with
g tan g = j kappa/Z, axial wavenumbers beta_n and alpha_m in units of 1/H, Im <= 0. With amplitudes
a + b left of the liner (b runs back), c + d above it (d runs back from its end), t + i right of it
(i comes in), E = exp(-j alpha L) and C the overlaps of the two families, N and Lambda their norms,
continuity of p tested by the lined modes and continuity of u tested by the rigid ones are

.. math:: c + E d = P (a + b), \quad a - b = Q (c - E d), \quad P = \Lambda^{-1} C^T, \quad
    Q = (N \beta)^{-1} C \alpha,

and alike at the other end. Eliminating b and t leaves two systems, for c + d and c - d:
[(1 + P Q) +- (1 - P Q) E] (c +- d) = 2 P (a +- i).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_choice, require_positive
from torchliner.duct.polynomials import chebyshev_points, derivative_matrix
from torchliner.duct.wall_impedance import result_type, wall_reflection
from torchliner.names import SOURCES

EXTRA_POINTS = 30  # Chebyshev points beyond twice the modes
RESIDUAL = 1e-8  # of the eigenvalue relation, after which a mode counts as found


@dataclass(frozen=True, eq=False)
class MatchedDuct:
    """The sound field; an incident plane wave of 1 Pa (peak) at the liner's edge that it meets.

    Args:
        frequency: Hz, (F,).
        height, sound_speed: H, m; c, m/s.
        liner: x of its ends, m.
        rigid, lined: transverse numbers n pi and g_m, (N,) and (..., F, N).
        rigid_axial, lined_axial: beta and alpha in 1/m, (F, N) and (..., F, N).
        left, right: amplitudes (to the right, to the left) at the liner's ends, (..., F, 2, N).
        inside: amplitudes c and d, (..., F, 2, N).
        reflection, transmission: of the plane wave, at the edges met first and last, (..., F).
    """

    frequency: Tensor
    height: float
    sound_speed: float
    liner: tuple[float, float]
    rigid: Tensor
    lined: Tensor
    rigid_axial: Tensor
    lined_axial: Tensor
    left: Tensor
    inside: Tensor
    right: Tensor
    reflection: Tensor
    transmission: Tensor

    def fields(self, x: Any, y: Any) -> tuple[Tensor, Tensor, Tensor]:
        """p, rho c u and rho c v in Pa at points x, y (m, (P,) or numbers), each (..., F, P)."""
        places, heights = torch.broadcast_tensors(
            *(torch.as_tensor(v, dtype=torch.float64).reshape(-1).to(self.rigid) for v in (x, y))
        )
        start, stop = self.liner
        lined = self._sum(self.lined, self.lined_axial, self.inside, places, heights, start, stop)
        left = self._sum(self.rigid, self.rigid_axial, self.left, places, heights, start, start)
        right = self._sum(self.rigid, self.rigid_axial, self.right, places, heights, stop, stop)
        p, u, v = (
            torch.where(places < start, le, torch.where(places > stop, ri, li))
            for le, li, ri in zip(left, lined, right, strict=True)
        )
        return p, u, v

    def _sum(
        self, numbers: Tensor, axial: Tensor, waves: Tensor, x: Tensor, y: Tensor,
        forth_from: float, back_from: float,
    ) -> list[Tensor]:  # fmt: skip
        """Modes (..., N) at points (P,): phases counted from where each direction starts."""
        ahead = -1j * axial[..., None]
        forth = waves[..., 0, :, None] * _decay(ahead * (x - forth_from))
        back = waves[..., 1, :, None] * _decay(-ahead * (x - back_from))
        turned = numbers[..., None] * (1 - y / self.height)
        k = (2 * math.pi / self.sound_speed * self.frequency)[:, None].to(waves.dtype)
        p = ((forth + back) * torch.cos(turned)).sum(-2)
        u = (axial[..., None] * (forth - back) * torch.cos(turned)).sum(-2) / k
        slope = numbers[..., None] / self.height * torch.sin(turned)
        v = 1j * ((forth + back) * slope).sum(-2) / k
        return [p, u, v]


def match_modes(
    height: float,
    liner: tuple[float, float],
    frequency: Any,
    impedance: Any,
    *,
    sound_speed: float = 343.2,
    source: str = "upstream",
    modes: int = 40,
) -> MatchedDuct:
    """A plane wave on a uniform liner in a straight rigid duct without flow.

    The lined modes' transverse numbers are eigenvalues at Chebyshev points, none of which can be
    missed, polished by Newton's method. On the opposite wall the error falls with the square of
    the number of modes: 40 leave 2e-5 for Z = 2.33-0.30j, 1e-4 for 0.3-0.6j; for Z = 0, whose
    edges are sharper, only with the number: 2e-2.

    Args:
        height: H, m.
        liner: x of its two ends, m, at y = 0.
        frequency: Hz, (F,).
        impedance: Z, normalised; broadcast against (F,), leading axes free; inf is rigid.
        sound_speed: c, m/s.
        source: ``upstream`` sends the wave along +x, ``downstream`` along -x.
        modes: N of each family.
    Raises:
        ValueError: lengths not above 0, fewer than one mode; see ``wall_reflection``.
        RuntimeError: a system is singular: a rigid mode at cut-on, or two lined modes that are one.
    Warns:
        DataWarning: negative resistance.
    """
    require_positive("duct height (m)", height)
    require_positive("sound_speed (m/s)", sound_speed)
    require_choice("source", source, SOURCES)
    length = liner[1] - liner[0]
    require_positive("liner length (m)", length)
    if modes < 1:
        raise ValueError(f"modes is {modes}; at least one is needed")
    wanted = frequency_tensor(frequency)
    wall = wall_reflection(impedance, wanted.device)
    kappa = (2 * math.pi * height / sound_speed * wanted).to(wall)
    wall = torch.broadcast_to(wall, torch.broadcast_shapes(wall.shape, kappa.shape))
    rigid = math.pi * torch.arange(modes, device=wall.device, dtype=torch.float64)
    lined = _transverse_numbers(kappa.expand_as(wall), wall, modes)
    beta, alpha = _axial(kappa, rigid.to(wall)), _axial(kappa, lined)
    plane = torch.zeros_like(alpha)
    plane[..., 0] = 1
    still = torch.zeros_like(plane)
    coming = (plane, still) if source == "upstream" else (still, plane)
    waves = _match(rigid, lined, beta, alpha, length / height, *coming)
    b, c, d, t = waves
    if not bool(torch.isfinite(torch.cat(waves, -1).abs()).all()):
        raise RuntimeError(
            "the matching equations are singular (residual nan): a rigid mode at cut-on, or two "
            "lined modes that have become one; change the frequency or the impedance slightly"
        )
    back, on = (b, t) if source == "upstream" else (t, b)
    parts = (
        lined, beta / height, alpha / height, torch.stack([coming[0], b], -2),
        torch.stack([c, d], -2), torch.stack([t, coming[1]], -2), back[..., 0], on[..., 0],
    )  # fmt: skip
    typed = [part.to(result_type(impedance)) for part in parts]
    return MatchedDuct(wanted.to(wall.device), height, sound_speed, liner, rigid, *typed)


def _match(
    rigid: Tensor, lined: Tensor, beta: Tensor, alpha: Tensor, length: float, a: Tensor, i: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """b, c, d, t of the module's text, (..., F, N)."""
    overlap = (_sinc(lined[..., None, :] - rigid[:, None]) + _sinc(
        lined[..., None, :] + rigid[:, None]
    )) / 2  # fmt: skip
    to_lined = overlap.mT / ((1 + _sinc(2 * lined)) / 2)[..., None]
    norm = torch.full_like(rigid, 0.5)
    norm[0] = 1
    to_rigid = overlap * alpha[..., None, :] / (norm * beta)[..., None]
    both = to_lined @ to_rigid
    one = torch.eye(both.shape[-1], dtype=both.dtype, device=both.device)
    decay = torch.exp(-1j * alpha * length)
    crossed = (one - both) * decay[..., None, :]
    even, odd = (
        torch.linalg.solve_ex(one + both + sign * crossed, 2 * _times(to_lined, a + sign * i))[0] for sign in (1, -1)
    )
    c, d = (even + odd) / 2, (even - odd) / 2
    b = a - _times(to_rigid, c - decay * d)
    t = i + _times(to_rigid, decay * c - d)
    return b, c, d, t


def _transverse_numbers(kappa: Tensor, wall: Tensor, modes: int) -> Tensor:
    """g of the lowest modes, (..., F, N): (1 + R) g sin g = j kappa (1 - R) cos g."""
    points = 2 * modes + EXTRA_POINTS
    first = torch.as_tensor(derivative_matrix(chebyshev_points(points))).to(wall)
    second = first @ first
    # (1 + R) p' = j kappa (1 - R) p at eta = 0 and p' = 0 at eta = 1 give both ends' values.
    condition = (1 + wall)[..., None, None] * first[:1].expand(*wall.shape, 1, points)
    condition = condition - (1j * kappa * (1 - wall))[..., None, None] * torch.eye(
        1, points, dtype=wall.dtype, device=wall.device
    )
    conditions = torch.cat([condition, first[-1:].expand_as(condition)], -2)
    ends = [0, points - 1]
    inner = conditions[..., 1:-1]
    values = -torch.linalg.solve(conditions[..., ends], inner)
    operator = second[1:-1, 1:-1] + second[1:-1][:, ends] @ values
    squares = -torch.linalg.eigvals(operator)
    order = torch.argsort(squares.real, dim=-1)[..., :modes]
    g = torch.sqrt(torch.gather(squares, -1, order))
    for _ in range(4):
        g = g - _relation(g, kappa, wall) / _relation_slope(g, kappa, wall)
    left = _relation(g, kappa, wall).abs() / (1 + g.abs() ** 2) / torch.cos(g).abs().clamp(min=1)
    if not bool((left < RESIDUAL).all()):
        raise RuntimeError(
            f"{modes} lined modes are not resolved: the relation of one is off by "
            f"{float(torch.nan_to_num(left, nan=torch.inf).max()):.2g}; take fewer"
        )
    return g


def _relation(g: Tensor, kappa: Tensor, wall: Tensor) -> Tensor:
    wall, kappa = wall[..., None], kappa[..., None]
    return (1 + wall) * g * torch.sin(g) - 1j * kappa * (1 - wall) * torch.cos(g)


def _relation_slope(g: Tensor, kappa: Tensor, wall: Tensor) -> Tensor:
    wall, kappa = wall[..., None], kappa[..., None]
    slope = (1 + wall) * (torch.sin(g) + g * torch.cos(g)) + 1j * kappa * (1 - wall) * torch.sin(g)
    return torch.where(slope.abs() < 1e-12, torch.ones_like(slope), slope)


def _axial(kappa: Tensor, numbers: Tensor) -> Tensor:
    """sqrt(kappa^2 - g^2), decaying or running towards +x, (..., F, N)."""
    root = torch.sqrt(kappa[..., None] ** 2 - numbers**2)
    turn = (root.imag > 0) | ((root.imag == 0) & (root.real < 0))
    return torch.where(turn, -root, root)


def _sinc(z: Tensor) -> Tensor:
    small = z.abs() < 1e-4
    return torch.where(small, 1 - z**2 / 6, torch.sin(z) / torch.where(small, torch.ones_like(z), z))


def _decay(exponent: Tensor) -> Tensor:
    """exp; its growth is cut, which only points outside a part of the duct or nought would see."""
    return torch.exp(torch.complex(exponent.real.clamp(max=50), exponent.imag))


def _times(matrix: Tensor, vector: Tensor) -> Tensor:
    return (matrix @ vector[..., None])[..., 0]
