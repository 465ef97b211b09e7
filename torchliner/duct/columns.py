r"""Elements of the linearised Euler equations, condensed to what goes in and out of their edges;
columns of them, to what goes in and out of two sides and of the lined wall.

With q = (p, u, v), p in units of rho c^2 and velocities of c, and exp(j omega t),

.. math:: j k q + \partial_x (A_x q) + \partial_y (A_y q) + B q = 0,

A_x = [[M, 1, 0], [1, M, 0], [0, 0, M]], A_y = [[0, 0, 1], [0, 0, 0], [1, 0, 0]], and M' v in the
equation of u. Discontinuous Galerkin with the upwind flux: with the outward normal n, M_n = M n_x,
and the waves w+ = (p + u_n)/2 from inside and w- = (p - u_n)/2 from outside,

.. math:: F_p = (1 + M_n) w^+ - (1 - M_n) w^-, \quad F_n = (1 + M_n) w^+ + (1 - M_n) w^-, \quad
    F_t = \max(M_n, 0) u_{t,in} + \min(M_n, 0) u_{t,out}.

So an element (M >= 0) receives through its left edge w = (p + u)/2 and v, through its right edge
(p - u)/2, through its bottom (p + v)/2 and through its top (p - v)/2, and gives out the same
through the opposite edges. Where there is no flow no v crosses an edge, and none is carried.

The walls close the column: at the rigid one the wave that arrives, (p + v_n)/2, comes back as it
is: with a = p + v_n, p* = (1 + R) a/2 and v* = (1 - R) a/2 for R = 1. At a lined one it comes back
times R; but R is left out here: the wall stays open as a third port, so that all impedances share
a column.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.duct.basis import Basis, Rows


@dataclass(frozen=True, eq=False)
class Elements:
    """All elements of a column for a batch of frequencies; n = degree + 1, 3 n^2 unknowns each.

    Incoming and outgoing waves are counted along the edges, in this order: along the flow (left to
    right) w and, with flow, v; against it (right to left) w; upwards w; downwards w; each n.

    Args:
        interior: unknowns (field, y, x) of unit incoming waves, (F, E, 3 n^2, I).
        scattering: outgoing waves of unit incoming ones, (F, E, I, I).
        along: how many waves run along the flow, 2 n or n.
    """

    interior: Tensor
    scattering: Tensor
    along: int


def condense_elements(k: Tensor, width: float, basis: Basis, rows: Rows, flow: bool) -> Elements:
    """Elements of one width, m, at k = omega/c, 1/m, (F,); ``flow``: whether v crosses edges."""
    steady, mass = element_operator(width, basis, rows)
    incoming, outgoing = element_ports(width, basis, rows, flow)
    system = 1j * k[:, None, None, None] * mass + steady
    interior = torch.linalg.solve(system, incoming.to(system.dtype).expand(len(k), *incoming.shape))
    scattering = outgoing.to(system.dtype) @ interior
    return Elements(interior, scattering, basis.count * (2 if flow else 1))


def element_operator(width: float, basis: Basis, rows: Rows) -> tuple[Tensor, Tensor]:
    """What does not depend on k, and the mass matrix which j k multiplies; (E, 3 n^2, 3 n^2)."""
    first, last = (torch.outer(end, end) for end in (basis.first, basis.last))
    mass_x = width * torch.diag(basis.weights)
    ahead, against = (rows.mass + rows.flow) / 2, (rows.mass - rows.flow) / 2
    out = _kron(ahead, last)  # through the right edge, of (p + u)
    back = _kron(against, first)  # through the left edge, of (p - u)
    convected = -_kron(rows.flow, basis.convection)
    acoustic_x = -_kron(rows.mass, basis.convection) + out - back
    acoustic_y = _kron((last - first) / 2 - basis.convection, mass_x).expand_as(out)
    vertical = _kron((last + first) / 2, mass_x).expand_as(out)
    still = torch.zeros_like(out)
    steady = _blocks([
        [convected + out + back + vertical, acoustic_x, acoustic_y],
        [acoustic_x, convected + out + back, _kron(rows.shear, mass_x)],
        [acoustic_y, still, convected + _kron(rows.flow, last) + vertical],
    ])  # fmt: skip
    mass = _kron(rows.mass, mass_x)
    return steady, _blocks([[mass, still, still], [still, mass, still], [still, still, mass]])


def element_ports(width: float, basis: Basis, rows: Rows, flow: bool) -> tuple[Tensor, Tensor]:
    """Right-hand sides of unit incoming waves (E, 3 n^2, I) and outgoing waves (E, I, 3 n^2)."""
    count = len(rows.mass)
    first, last = basis.first[:, None], basis.last[:, None]
    mass_x = (width * torch.diag(basis.weights)).expand(count, -1, -1)
    one = torch.eye(basis.count).to(basis.nodes).expand(count, -1, -1)
    ahead, against = _kron(rows.mass + rows.flow, first), _kron(rows.mass - rows.flow, last)
    up, down = (_kron(end.expand(count, -1, -1), mass_x[0]) for end in (first, last))
    right, left = _kron(one, last.T) / 2, _kron(one, first.T) / 2
    top, bottom = (_kron(end.T.expand(count, -1, -1), one[0]) / 2 for end in (last, first))
    still, none = torch.zeros_like(ahead), torch.zeros_like(right)
    incoming = [[ahead, ahead, still], [against, -against, still], [up, still, up],
                [down, still, -down]]  # fmt: skip
    outgoing = [[right, right, none], [left, -left, none], [top, none, top],
                [bottom, none, -bottom]]  # fmt: skip
    if flow:
        incoming.insert(1, [still, still, _kron(rows.flow, first)])
        outgoing.insert(1, [none, none, 2 * right])
    return (
        torch.cat([torch.cat(part, -2) for part in incoming], -1),
        torch.cat([torch.cat(part, -1) for part in outgoing], -2),
    )


def diagonal_blocks(blocks: Tensor) -> Tensor:
    """(..., E, a, b) as block-diagonal matrices (..., E a, E b)."""
    *lead, count, a, b = blocks.shape
    whole = blocks.new_zeros(*lead, count, a, count, b)
    whole.diagonal(dim1=-4, dim2=-2).copy_(blocks.movedim(-3, -1))
    return whole.reshape(*lead, count * a, count * b)


def _kron(across: Tensor, along: Tensor) -> Tensor:
    """Kronecker products of (E, a, b) or (a, b) with (c, d): (E, a c, b d)."""
    across = across if across.ndim == 3 else across[None]
    product = across[:, :, None, :, None] * along[:, None, :]
    return product.flatten(3).flatten(1, 2)


def _blocks(rows: list[list[Tensor]]) -> Tensor:
    return torch.cat([torch.cat(row, -1) for row in rows], -2)


@dataclass(frozen=True, eq=False)
class Column:
    """Waves of a column for a batch of frequencies; N = E n points across the duct.

    A wave vector along the flow holds w = (p + u)/2 over all points and, with flow, v over all
    points: (2 N) or (N). One against it holds (p - u)/2: (N). The wall's holds n.

    Args:
        lined: whether the lower wall is a port.  elements: of the column.
        vertical: waves (E, up and down, n) that go into elements through horizontal edges, of unit
            waves into the column from the left, from the right and from the wall, (F, 2 N, I).
        out: waves out to the ``right``, the ``left`` and the ``wall``, of the same waves in.
        blocks: the same by (out, in).
    """

    lined: bool
    elements: Elements
    vertical: Tensor
    out: dict[str, Tensor]
    blocks: dict[tuple[str, str], Tensor]

    @property
    def points(self) -> int:
        """n; waves against the flow, up and down are n each."""
        return (self.elements.interior.shape[-1] - self.elements.along) // 3

    @property
    def open_waves(self) -> int:
        """How many come from the wall: n of a lined column, else none."""
        return self.points if self.lined else 0


def condense_column(k: Tensor, width: float, basis: Basis, rows: Rows, flow: bool, lined: bool) -> Column:
    """One column of a given width; see ``condense_elements``."""
    elements = condense_elements(k, width, basis, rows, flow)
    n, count = basis.count, len(rows.mass)
    along = elements.along
    sides = along + n  # waves of one element through its left and right edges
    scattering = elements.scattering
    # Vertical waves out of every element, by vertical waves in and by waves in through the sides.
    to_vertical = diagonal_blocks(scattering[..., sides:, sides:])
    from_sides = diagonal_blocks(scattering[..., sides:, :sides])
    source, closed = _neighbours(count, n, lined, k.device)
    one = torch.eye(2 * n * count, dtype=scattering.dtype, device=k.device)
    arriving = torch.where(closed[:, None], to_vertical[:, source], 0)
    right = torch.where(closed[:, None], from_sides[:, source], 0)
    if lined:
        right = torch.cat([right, one[:, :n].expand(len(k), -1, -1)], -1)
    vertical = torch.linalg.solve(one - arriving, right)
    out = diagonal_blocks(scattering[..., :sides, sides:]) @ vertical
    direct = diagonal_blocks(scattering[..., :sides, :sides])
    out[..., : direct.shape[-1]] += direct
    parts = [out]
    if lined:
        down = to_vertical[:, n : 2 * n] @ vertical
        down[..., : direct.shape[-1]] += from_sides[:, n : 2 * n]
        parts.append(down)
    # From (element, w, v, w back) to (w, v over all elements; w back over all elements; wall).
    order = torch.arange(count * sides, device=k.device).reshape(count, -1, n)
    order = order.transpose(0, 1).flatten()
    order = torch.cat([order, torch.arange(n if lined else 0, device=k.device) + order.numel()])
    whole = torch.cat(parts, -2)[:, order][..., order]
    sizes = {"right": count * along, "left": count * n, "wall": n if lined else 0}
    names_in = ("left", "right", "wall")
    rows_out = dict(zip(sizes, whole.split(list(sizes.values()), -2), strict=True))
    blocks = {
        (to, source_side): block
        for to, row in rows_out.items()
        for source_side, block in zip(names_in, row.split(list(sizes.values()), -1), strict=True)
    }
    return Column(lined, elements, vertical[..., order], rows_out, blocks)


def _neighbours(count: int, n: int, lined: bool, device: torch.device) -> tuple[Tensor, Tensor]:
    """For every vertical wave into an element, the wave out that it is, and whether it is one.

    Waves are counted (E, up and down, n). Up into an element is up out of the one below, down into
    it is down out of the one above; at a rigid wall they turn. The lowest n are a lined wall's.
    """
    index = torch.arange(2 * n * count, device=device).reshape(count, 2, n)
    source = torch.empty_like(index)
    source[1:, 0] = index[:-1, 0]
    source[:-1, 1] = index[1:, 1]
    source[-1, 1] = index[-1, 0]
    source[0, 0] = index[0, 1]
    closed = torch.ones_like(index, dtype=torch.bool)
    closed[0, 0] = not lined
    return source.flatten(), closed.flatten()
