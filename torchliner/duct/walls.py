r"""What the lined wall does with the waves that arrive: x = E eta for a = T eta.

a = (p - v)/2 arrives from above, x goes back up, both over the n points of every lined column. For
a locally reacting wall x = R a: T = 1, E = R, point by point, R = (Z - 1)/(Z + 1); where Z varies
within a column R is projected on its polynomials.

Where the flow slips at Mach M, Ingard's and Myers' condition takes w = p*/Z, times 1/(j omega) the
displacement, to the velocity v* = w + (M/j k) dw/dx. With p* = (1 + R) eta and w = (1 - R) eta,
finite for every wall, and D the discrete derivative,

.. math:: 2 a = p^* + v^* = 2 T \eta, \quad T = 1 + \frac{M}{2 j k} D (1 - R), \quad
    E = 1 + R - T.

D takes its values at element edges from downstream and is 0 beyond the last: transported from
upstream, the hydrodynamic wave grows without bound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.duct.basis import Basis
from torchliner.duct.columns import diagonal_blocks
from torchliner.duct.mesh import DuctMesh
from torchliner.duct.wall_impedance import wall_reflection


@dataclass(frozen=True, eq=False)
class Wall:
    """T and E of the module's text.

    Args:
        send: E as blocks of the lined columns, (..., F, C, n, n), or whole, (..., F, W, W).
        arrive: T, (..., F, W, W), or None for 1.
        inner: n.
    """

    send: Tensor
    arrive: Tensor | None = None
    inner: int = 0

    def waves(self, eta: Tensor) -> Tensor:
        """x = E eta, (..., F, W)."""
        if self.arrive is not None:
            return (self.send @ eta[..., None])[..., 0]
        blocks = eta.reshape(*eta.shape[:-1], *self.send.shape[-3:-1])
        return (self.send @ blocks[..., None])[..., 0].flatten(-2)

    def of_pressure(self, pressure: Tensor) -> Tensor:
        """eta of p = (T + E) eta = (1 + R) eta, (..., F, W), column by column; where Z = 0, and so
        p = 0, the least."""
        assert self.arrive is not None
        n = self.inner
        whole = (self.send + self.arrive).unflatten(-2, (-1, n)).unflatten(-1, (-1, n))
        blocks = whole.diagonal(dim1=-4, dim2=-2).movedim(-1, -3)  # (..., F, C, n, n)
        columns = pressure.unflatten(-1, (-1, n))[..., None]
        return (torch.linalg.pinv(blocks) @ columns)[..., 0].flatten(-2)

    def after(self, response: Tensor) -> Tensor:
        """response E for (F, rows, W): (..., F, rows, W)."""
        if self.arrive is not None:
            return response @ self.send
        columns, n = self.send.shape[-3:-1]
        split = response.reshape(*response.shape[:-1], columns, n).transpose(-2, -3)
        return (split @ self.send).transpose(-2, -3).flatten(-2)

    def flattened(self, lead: torch.Size) -> Wall:
        """All leading axes as one, the frequencies' kept."""
        count = lead.numel()
        inner = 3 if self.arrive is not None else 4
        parts = [
            None if part is None
            else part.expand(*lead, *part.shape[-inner:]).reshape(count, *part.shape[-inner:])
            for part in (self.send, self.arrive)
        ]  # fmt: skip
        assert parts[0] is not None
        return Wall(parts[0], parts[1], self.inner)

    def select(self, chosen: slice) -> Wall:
        """Some of the items along the first axis."""
        arrive = None if self.arrive is None else self.arrive[chosen]
        return Wall(self.send[chosen], arrive, self.inner)


def wall_of(impedance: Any, mesh: DuctMesh, basis: Basis, k: Tensor, frequency: Tensor, slip_mach: float) -> Wall:
    """The wall of an impedance.

    Args:
        impedance: numbers, broadcast against (F, S), S lined patches, leading axes free; or a
            function of x (m, (P,)) and frequency (Hz, (F,)) that returns (..., F, P).
        mesh, basis: of the duct.  k, frequency: 1/m and Hz, (F,).
        slip_mach: M at the wall for Ingard's and Myers' condition, else 0.
    Raises:
        ValueError: shapes that do not fit; see ``wall_reflection``.
    """
    pick = _varying if callable(impedance) else _piecewise
    blocks = pick(impedance, mesh, basis, frequency)
    if slip_mach == 0:
        return Wall(blocks)
    whole = diagonal_blocks(blocks)
    one = torch.eye(whole.shape[-1], dtype=blocks.dtype, device=blocks.device)
    share = (slip_mach / (2j * k))[:, None, None]
    arrive = one + share * (_downwind_derivative(mesh, basis).to(blocks) @ (one - whole))
    return Wall(one + whole - arrive, arrive, basis.count)


def _piecewise(impedance: Any, mesh: DuctMesh, basis: Basis, frequency: Tensor) -> Tensor:
    patches = len(mesh.case.liner)
    reflection = wall_reflection(impedance, frequency.device).to(frequency.device)
    wanted = (len(frequency), patches)
    try:
        shape = np.broadcast_shapes(reflection.shape, wanted)
    except ValueError:
        shape = ()
    if shape[-2:] != wanted:
        raise ValueError(
            f"impedance has shape {tuple(reflection.shape)}; its last two axes must fit "
            f"{wanted}: frequencies, lined patches (one value of each for all: 1)"
        )
    each = reflection.expand(shape)[..., torch.as_tensor(mesh.patch_numbers[mesh.lined])]
    return each[..., None, None] * torch.eye(basis.count, dtype=each.dtype, device=each.device)


def _varying(impedance: Callable[..., Any], mesh: DuctMesh, basis: Basis, frequency: Tensor) -> Tensor:
    places, values, weights = basis.quadrature()
    x = torch.as_tensor(mesh.lined_starts[:, None] + mesh.lined_widths[:, None] * places)
    found = impedance(x.flatten().to(frequency), frequency)
    reflection = wall_reflection(found, frequency.device).to(frequency.device)
    wanted = (len(frequency), x.numel())
    if reflection.shape[-2:] != wanted:
        raise ValueError(
            f"the impedance function returned shape {tuple(reflection.shape)} for {wanted[0]} "
            f"frequencies and {wanted[1]} places; its last two axes must be these"
        )
    reflection = reflection.reshape(*reflection.shape[:-1], *x.shape)
    values, weights = (t.to(reflection) for t in (values, weights))
    blocks = values.mT @ ((reflection * weights)[..., None] * values)
    return blocks / basis.weights[:, None]


def _downwind_derivative(mesh: DuctMesh, basis: Basis) -> Tensor:
    """d/dx over the lined columns, edge values from the right neighbour, (W, W)."""
    n, widths, starts = basis.count, mesh.lined_widths, mesh.lined_starts
    whole = torch.zeros(len(widths), n, len(widths), n, dtype=torch.float64)
    first, last = basis.first.cpu(), basis.last.cpu()
    inner = -basis.convection.cpu() - torch.outer(first, first)
    weights = basis.weights.cpu()[:, None]
    for i, width in enumerate(widths):
        whole[i, :, i] = inner / (width * weights)
        touches = i + 1 < len(widths) and abs(starts[i] + width - starts[i + 1]) < 1e-9 * width
        if touches:
            whole[i, :, i + 1] = torch.outer(last, first) / (width * weights)
    return whole.reshape(len(widths) * n, len(widths) * n)
