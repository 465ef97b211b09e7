r"""What comes back from the boundaries of a swept duct: one description of lined wall and ends.

Every boundary has amplitudes eta of its own: a wall half the sum of p* and w, p in units of rho c^2 and w, the velocity
of its face, of c; an end the plane-like mode that goes out. Linear in eta and finite for every wall are

.. math:: \text{wall: } x = E \eta, \quad a(X) = T \eta, \qquad
    \text{end: } s = s_0 + r c, \quad m(X) = 0, \quad \eta = c,

with X = (s_L, c_L, x, s_R, c_R) the unit waves of ``sweep.py``, a the waves (p - v)/2 that arrive at the wall and m
what goes out at an end besides its modes: one system for eta, some hundred unknowns.

Of a wall p* = (1 + R) eta and w = (1 - R) eta, R = (Z - 1)/(Z + 1), projected on the column's polynomials. Without slip
v* = w: T = 1, E = R. With slip at Mach M v* = w + (M/j k) dw/dx (Ingard, Myers): T = 1 + S, E = R - S,
S = M/(2 j k) D (1 - R), where D takes its values at element edges from downstream and is 0 beyond the last: transported
from upstream, the hydrodynamic wave grows without bound.

An end lets the plane-like mode of the rigid duct out, whose outgoing and incoming parts are a_m and b_m: of what goes
out, a, the amplitude c = (w.a)/(w.a_m), w the mean of p +- u, comes back as b = c b_m, which reflects none of that mode
(nothing coming in would reflect 1e-3 of it in a sheared flow), and r times as much of the mode the other way.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchliner.duct.case import wall_reflection
from torchliner.duct.columns import Basis
from torchliner.duct.mesh import DuctMesh

SINGULAR = 1e-6  # residual over right-hand side
CHUNK = 64 * 2**20  # bytes of matrices solved at once
GAIN, FED = 1.01, 2.0  # energy out, and out or absorbed, over that in
PASSIVE = -1e-6  # of the energy in: what a wall takes; below, it gives


def wall_matrices(impedance: Any, mesh: DuctMesh, basis: Basis, frequency: Tensor) -> Tensor:
    """R of the C lined columns, n points each, (..., F, C, n, n), of an impedance as ``DuctSolver.solve`` takes it;
    ValueError for shapes that do not fit."""
    wall, wanted, words = impedance, (len(frequency), len(mesh.case.liner)), "lined patches"
    if along := callable(impedance):
        inside, values, weights = basis.quadrature()
        x = torch.as_tensor(mesh.x[:-1, None][mesh.lined] + mesh.lined_widths[:, None] * inside)
        wall, wanted, words = impedance(x.flatten().to(frequency), frequency), (len(frequency), x.numel()), "places"
    reflection = wall_reflection(wall, frequency.device).to(frequency.device)
    try:
        each = reflection.expand(*reflection.shape[:-2], *wanted)
    except RuntimeError:
        raise ValueError(
            f"impedance has shape {tuple(reflection.shape)}; its last two axes must fit {wanted}: frequencies and "
            f"{words} (one value of each for all: 1)"
        ) from None
    if not along:
        each = each[..., torch.as_tensor(mesh.patch_numbers[mesh.lined])]
        return each[..., None, None] * torch.eye(basis.count, dtype=each.dtype, device=each.device)
    values, weights = values.to(each), weights.to(each)
    return values.mT @ ((each.unflatten(-1, x.shape) * weights)[..., None] * values) / basis.weights[:, None]


def downwind_derivative(mesh: DuctMesh, basis: Basis) -> Tensor:
    """d/dx over the lined columns, edge values from the right neighbour, (W, W)."""
    n, widths, columns = basis.count, mesh.lined_widths, np.flatnonzero(mesh.lined)
    whole = torch.zeros(len(widths), n, len(widths), n, dtype=torch.float64)
    first, last = basis.first.cpu(), basis.last.cpu()
    inner, weights = -basis.convection.cpu() - torch.outer(first, first), basis.weights.cpu()[:, None]
    for i, width in enumerate(widths):
        whole[i, :, i] = inner / (width * weights)
        if columns[i] + 1 in columns:
            whole[i, :, i + 1] = torch.outer(last, first) / (width * weights)
    return whole.reshape(len(widths) * n, len(widths) * n)


def reflected(wall: Tensor, eta: Tensor) -> Tensor:
    """R eta, (..., F, W)."""
    return (wall @ eta.unflatten(-1, wall.shape[-3:-1])[..., None])[..., 0].flatten(-2)


class Boundaries:
    """The boundaries of a swept duct, for every wall and every end.

    Args:
        reading: of the swept duct, (F, W + 2, D).
        slip: (M/2jk) D, (F, W, W), where the condition is Ingard's and Myers', else None.
    """

    def __init__(self, reading: Tensor, slip: Tensor | None) -> None:
        lined, one = reading[..., 2:-2], torch.eye(reading.shape[-2], reading.shape[-1] - 4).to(reading)
        more = 0 if slip is None else (lined + one) @ slip
        # The wall's part of the system is reading E - T = (reading + more) R - (1 + more).
        # Contiguous, since a number with a derivative beside it may share no memory with another.
        self.slip, self.back, self.own = slip, lined + more, (one + more).expand_as(lined).contiguous()
        self.coming, self.going = reading[..., [0, -2]], reading[..., [1, -1]]

    def solve(self, wall: Tensor, starts: Tensor, returns: Tensor) -> tuple[Tensor, Tensor]:
        """X and eta for waves sent in from the ends, some items at a time, so that their matrices do not pile up.

        Args:
            wall: R of ``wall_matrices``, (..., F, C, n, n).
            starts, returns: s0 and r of the left and right end, (..., F, 2).
        Returns:
            X, (..., F, D), and eta of the wall, (..., F, W).
        Raises:
            RuntimeError: the system is singular; the message holds the residual.
        """
        parts = (wall, 4), (starts, 2), (returns, 2)
        lead = torch.Size(np.broadcast_shapes(*(part.shape[:-inner] for part, inner in parts)))
        step = max(1, CHUNK // (16 * self.back.shape[-2] ** 2 * len(self.back)))
        flat = (part.expand(*lead, *part.shape[-n:]).reshape(lead.numel(), *part.shape[-n:]) for part, n in parts)
        found = [self._solve(*some) for some in zip(*(part.contiguous().split(step) for part in flat), strict=True)]
        waves, eta = (torch.cat(part) for part in zip(*found, strict=True))
        return waves.reshape(*lead, *waves.shape[1:]), eta.reshape(*lead, *eta.shape[1:])

    def _solve(self, wall: Tensor, starts: Tensor, returns: Tensor) -> tuple[Tensor, Tensor]:
        """The same of one row of items."""
        lined = self.back.unflatten(-1, wall.shape[-3:-1]).transpose(-2, -3) @ wall
        ends = self.going + returns[..., None, :] * self.coming
        system = torch.cat([lined.transpose(-2, -3).flatten(-2) - self.own, ends], -1)
        right = -(self.coming * starts[..., None, :]).sum(-1)
        found = torch.linalg.solve_ex(system, right[..., None])[0][..., 0]
        matrix, solution = system.detach(), found.detach()
        left = ((matrix @ solution[..., None])[..., 0] - right).abs().amax(-1)
        # Of a singular system the residual may be small by luck; rounding of a solution so large is not.
        rounding = torch.finfo(torch.float64).eps * matrix.abs().amax((-2, -1)) * solution.abs().amax(-1)
        share = torch.maximum(left, rounding) / right.abs().amax(-1).clamp(min=1e-300)
        worst = float(torch.nan_to_num(share, nan=torch.inf).max())
        if worst > SINGULAR:
            raise RuntimeError(
                f"the duct's equations are singular: their solution leaves a residual of {worst:.2g} of the incident "
                "wave (a wall or two ends that feed a resonance); change the impedance, the end reflections or the "
                "frequency"
            )
        eta, out = found[..., :-2], found[..., -2:]
        into, waves = starts + returns * out, reflected(wall, eta)
        if self.slip is not None:
            waves = waves - (self.slip @ (eta - waves)[..., None])[..., 0]
        return torch.cat([into[..., :1], out[..., :1], waves, into[..., 1:], out[..., 1:]], -1), eta


class EnergyBalance(NamedTuple):
    """Shares of the energy that comes in, (..., F)."""

    out: Tensor  # plane-like modes out of both ends, with (1 +- M)^2, M the bulk Mach number
    absorbed: Tensor  # by the liner, from p and w on its face

    @property
    def missing(self) -> Tensor:
        """1 - out - absorbed: to the mean flow, if negative from it; errors of the mesh; mode 1."""
        return 1 - self.out - self.absorbed

    @property
    def fed(self) -> Tensor:
        """out + absorbed where more goes out than comes in past a wall that gives none: a wave grew; else 0."""
        out, absorbed = self.out.detach(), self.absorbed.detach()
        grown = ((out > GAIN) | (out + absorbed > FED)) & (absorbed > PASSIVE)
        return torch.where(grown, out + absorbed, 0.0)


def energy_balance(mesh: DuctMesh, basis: Basis, waves: Tensor, eta: Tensor, wall: Tensor) -> EnergyBalance:
    """Of X (..., F, D), eta (..., F, W) and the wall that they were solved with."""
    mach, back = mesh.case.profile.bulk_mach, reflected(wall, eta)
    along, against = (1 + mach) ** 2, (1 - mach) ** 2
    size = waves[..., [0, 1, -2, -1]].abs().square()
    coming = along * size[..., 0] + against * size[..., 2]
    out = against * size[..., 1] + along * size[..., 3]
    weights = torch.outer(torch.as_tensor(mesh.lined_widths).to(basis.weights), basis.weights).flatten()
    absorbed = ((eta + back) * (eta - back).conj()).real @ weights / mesh.case.height
    return EnergyBalance(out / coming, absorbed / coming)
