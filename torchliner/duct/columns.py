r"""Elements of the linearised Euler equations, condensed to what goes in and out of their edges; columns of them, to
what goes in and out of two sides and of the lined wall.

With q = (p, u, v), p in units of rho c^2 and velocities of c, j k q + d_x (A_x q) + d_y (A_y q) + B q = 0,
A_x = [[M, 1, 0], [1, M, 0], [0, 0, M]], A_y = [[0, 0, 1], [0, 0, 0], [1, 0, 0]], and M' v in the equation of u.
Discontinuous Galerkin with the upwind flux: outward normal n, M_n = M n_x, w+ = (p + u_n)/2 inside, w- = (p - u_n)/2
outside,

.. math:: F_p = (1 + M_n) w^+ - (1 - M_n) w^-, \quad F_n = (1 + M_n) w^+ + (1 - M_n) w^-, \quad
    F_t = \max(M_n, 0) u_{t,in} + \min(M_n, 0) u_{t,out}.

An element receives through its left edge w = (p + u)/2 and, with flow, v, through its right edge (p - u)/2, through its
bottom (p + v)/2 and through its top (p - v)/2, and gives out the same through the opposite edges. At the rigid wall the
wave that arrives comes back as it is; a lined wall stays open as a third port, so that all impedances share a column.
"""

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from torchliner.duct.flow_profiles import Array, MeanFlow
from torchliner.duct.numerics import derivative_matrix, gauss_points, interpolation_matrix

EXTRA_POINTS = 3  # of quadrature, over degree + 1: M(y) is no polynomial


class Basis:
    """n = degree + 1 Lagrange polynomials phi through the Gauss points of 0..1, float64.

    Attributes:
        nodes, weights, count: Gauss points and weights, (n,), and n; the mass matrix is diag(weights).
        convection: integral of phi_i' phi_j, (n, n).  first, last: phi at 0 and at 1, (n,).
    """

    def __init__(self, degree: int, device: torch.device | None = None) -> None:
        nodes, weights = gauss_points(degree + 1)
        # Exact integrals: products of two polynomials are below the Gauss rule's degree.
        convection = (weights[:, None] * derivative_matrix(nodes)).T
        parts = (nodes, weights, convection, *interpolation_matrix(nodes, [0.0, 1.0]))
        self.nodes, self.weights, self.convection, self.first, self.last = (
            torch.as_tensor(part, device=device) for part in parts
        )
        self.count = len(nodes)

    def values(self, places: ArrayLike) -> Tensor:
        """phi at places of 0..1, (P, n)."""
        return torch.as_tensor(interpolation_matrix(self.nodes.cpu().numpy(), places)).to(self.nodes)

    def quadrature(self) -> tuple[Array, Tensor, Tensor]:
        """Finer Gauss points, phi there (Q, n) and weights (Q,), for what is no polynomial."""
        places, weights = gauss_points(self.count + EXTRA_POINTS)
        return places, self.values(places), torch.as_tensor(weights).to(self.nodes)


class Rows:
    """Integrals across elements between heights (m, (E + 1,)), (E, n, n): ``mass`` of phi_i phi_j, ``flow`` of M phi_i
    phi_j and ``shear`` of dM/dy phi_i phi_j."""

    def __init__(self, basis: Basis, edges: Array, profile: MeanFlow) -> None:
        sizes = np.diff(edges)
        places, values, weights = basis.quadrature()
        y = (edges[:-1, None] + sizes[:, None] * places).clip(0, profile.duct_height)
        self.flow, self.shear = (
            torch.einsum("qi,eq,qj->eij", values, torch.as_tensor(part * sizes[:, None]).to(weights) * weights, values)
            for part in (profile.mach(y), profile.mach_slope(y))
        )
        self.mass = torch.as_tensor(sizes).to(weights)[:, None, None] * torch.diag(basis.weights)


def element_matrices(width: float, basis: Basis, rows: Rows, flow: bool) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The operator without j k, the mass matrix which j k multiplies, and the ports of each element.

    Waves are counted by kind, n of each: along the flow (left to right) w and, with flow, v; against it w; upwards w;
    downwards w.

    Returns:
        Operator and mass (E, 3 n^2, 3 n^2), right-hand sides of unit waves in (E, 3 n^2, I), waves out (E, I, 3 n^2).
    """
    count, first, last = len(rows.mass), basis.first[:, None], basis.last[:, None]
    one, along = torch.eye(basis.count).to(basis.nodes), width * torch.diag(basis.weights)
    # Of each kind: what a wave adds to the equations of p, u, v; across or along the edge that it enters by, the weight
    # of its flux there; the traces at the edge that it enters by and at the one that it leaves by.
    kinds = [
        ((1, 1, 0), rows.mass + rows.flow, first, last),
        ((0, 0, 1), rows.flow, first, last),
        ((1, -1, 0), rows.mass - rows.flow, last, first),
        ((1, 0, 1), None, first, last),
        ((1, 0, -1), None, last, first),
    ]
    ins, leaves, outs = list[Tensor](), list[Tensor](), list[Tensor]()
    for signs, weight, enter, leave in kinds[:1] + kinds[1 if flow else 2 :]:
        if weight is None:  # through bottom or top
            parts = _kron(enter, along), _kron(leave, along), _kron(leave.T, one)
        else:
            parts = _kron(weight, enter), _kron(weight, leave), _kron(one, leave.T)
        for into, part, dim in zip((ins, leaves, outs), parts, (-2, -2, -1), strict=True):
            scale = sum(map(abs, signs)) if into is outs else 1
            into.append(torch.cat([sign * part / scale for sign in signs], dim).expand(count, -1, -1))
    incoming, leaving, outgoing = torch.cat(ins, -1), torch.cat(leaves, -1), torch.cat(outs, -2)
    mass, convected = _kron(rows.mass, along), -_kron(rows.flow, basis.convection)
    x, y = -_kron(rows.mass, basis.convection), -_kron(basis.convection, along).expand_as(mass)
    still = torch.zeros_like(mass)
    inside = _blocks([[convected, x, y], [x, convected, _kron(rows.shear, along)], [y, still, convected]])
    masses = _blocks([[mass, still, still], [still, mass, still], [still, still, mass]])
    return inside + leaving @ outgoing, masses, incoming, outgoing


def _kron(across: Tensor, along: Tensor) -> Tensor:
    """Kronecker products of (E, a, b) or (a, b) with (c, d): (E, a c, b d)."""
    across = across if across.ndim == 3 else across[None]
    return (across[:, :, None, :, None] * along[:, None, :]).flatten(3).flatten(1, 2)


def _blocks(rows: list[list[Tensor]]) -> Tensor:
    return torch.cat([torch.cat(row, -1) for row in rows], -2)


class Column:
    """A column of one width, m, of E elements at k = omega/c, 1/m, (F,); N = E n points across the duct.

    Waves into it are counted (left, right, wall): along the flow w and, with flow (v crosses edges), v, 2 N or N;
    against it N; from a lined wall n, else none.

    Attributes:
        interior: unknowns (field, y, x) of each element for unit waves into it, (F, E, 3 n^2, kinds n).
        vertical: waves up and down into the elements for unit waves into the column, (F, 2 N, I).
        out: waves out to the ``right``, the ``left`` and the ``wall``, for the same waves in.
        into: which waves come in from the ``left``, the ``right`` and the ``wall``.
        lined: how many waves come from the wall, n or 0.
    """

    def __init__(self, k: Tensor, width: float, basis: Basis, rows: Rows, flow: bool, lined: bool) -> None:
        self._n, elements = basis.count, len(rows.mass)
        n, points = self._n, self._n * elements
        steady, mass, incoming, outgoing = element_matrices(width, basis, rows, flow)
        system = 1j * k[:, None, None, None] * mass + steady
        self.interior = torch.linalg.solve(system, incoming.to(system.dtype).expand(len(k), *incoming.shape))
        scattering = outgoing.to(system.dtype) @ self.interior  # of each element, (F, E, kinds n, kinds n)
        # The same as one matrix, by (kind, element, node).
        split = scattering.unflatten(-1, (-1, n)).unflatten(-3, (-1, n)).movedim(1, -1)  # (F, kind, n, kind, n, E)
        across = torch.diag_embed(split, dim1=2, dim2=5).flatten(4, 6).flatten(1, 3)
        sides = across.shape[-1] - 2 * points
        # Up into an element is up out of the one below, down into it is down out of the one above; at a wall they turn.
        up, down = torch.arange(2 * points, device=k.device).split(points)
        passed = across[:, sides + torch.cat([down[:n], up[:-n], down[n:], up[-n:]])]
        right, one = passed[..., :sides], torch.eye(2 * points, dtype=across.dtype, device=k.device)
        if lined:
            passed[:, :n] = 0
            right = torch.cat([right, one[:, :n].expand(len(k), -1, -1)], -1)
        self.vertical = torch.linalg.solve(one - passed[..., sides:], right)
        # Element by element: what leaves one depends on its own edges alone.
        own = scattering.shape[-1] - 2 * n
        parts = scattering[..., own:] @ self.vertical.unflatten(1, (2, elements, n)).transpose(1, 2).flatten(2, 3)
        out = parts[..., :own, :].unflatten(2, (-1, n)).transpose(1, 2).flatten(1, 3)
        out[..., :sides] += across[:, :sides, :sides]
        if lined:
            wall = parts[:, 0, own + n :]
            wall[..., :sides] += across[:, sides + points : sides + points + n, :sides]
            out = torch.cat([out, wall], 1)
        along, self.lined = sides - points, out.shape[-2] - sides
        self.out = dict(zip(("right", "left", "wall"), out.split([along, points, self.lined], -2), strict=True))
        self.into = {"left": slice(0, along), "right": slice(along, sides), "wall": slice(sides, None)}

    def block(self, to: str, side: str) -> Tensor:
        """Waves out to one side for waves in from another."""
        return self.out[to][..., self.into[side]]

    def nodal(self, incoming: Tensor) -> Tensor:
        """p, u and v at the elements' nodes for waves into the column (..., F, I), (..., F, E, 3, n, n)."""
        vertical = (self.vertical @ incoming[..., None])[..., 0]
        sides = incoming[..., : self.into["wall"].start]
        kinds = torch.cat([sides, vertical], -1).unflatten(-1, (-1, self.interior.shape[1], self._n))
        waves = kinds.movedim(-3, -2).flatten(-2)  # (..., F, E, kinds n)
        return (self.interior @ waves[..., None])[..., 0].unflatten(-1, (3, self._n, self._n))
