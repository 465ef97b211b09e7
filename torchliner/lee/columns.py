"""A column of elements, condensed to what goes in and out of its two sides and of the lined wall.

The walls close the column: at the rigid one the wave that arrives, (p + v_n)/2, comes back as it
is: with a = p + v_n, p* = (1 + R) a/2 and v* = (1 - R) a/2 for R = 1. At a lined one it comes back
times R; but R is left out here: the wall stays open as a third port, so that all impedances share
a column.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.lee.basis import Basis, Rows
from torchliner.lee.elements import Elements, condense_elements


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


def condense_column(
    k: Tensor, width: float, basis: Basis, rows: Rows, flow: bool, lined: bool
) -> Column:
    """One column of a given width; see ``condense_elements``."""
    elements = condense_elements(k, width, basis, rows, flow)
    n, count = basis.count, len(rows.mass)
    along = elements.along
    sides = along + n  # waves of one element through its left and right edges
    scattering = elements.scattering
    # Vertical waves out of every element, by vertical waves in and by waves in through the sides.
    to_vertical = _diagonal(scattering[..., sides:, sides:])
    from_sides = _diagonal(scattering[..., sides:, :sides])
    source, closed = _neighbours(count, n, lined, k.device)
    one = torch.eye(2 * n * count, dtype=scattering.dtype, device=k.device)
    arriving = torch.where(closed[:, None], to_vertical[:, source], 0)
    right = torch.where(closed[:, None], from_sides[:, source], 0)
    if lined:
        right = torch.cat([right, one[:, :n].expand(len(k), -1, -1)], -1)
    vertical = torch.linalg.solve(one - arriving, right)
    out = _diagonal(scattering[..., :sides, sides:]) @ vertical
    direct = _diagonal(scattering[..., :sides, :sides])
    out[..., : direct.shape[-1]] += direct
    parts = [out]
    if lined:
        down = to_vertical[:, n : 2 * n] @ vertical
        down[..., : direct.shape[-1]] += from_sides[:, n : 2 * n]
        parts.append(down)
    order = _side_order(count, n, along, lined, k.device)
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


def _diagonal(blocks: Tensor) -> Tensor:
    """(F, E, a, b) as block-diagonal matrices (F, E a, E b)."""
    frequencies, count, a, b = blocks.shape
    whole = blocks.new_zeros(frequencies, count, a, count, b)
    index = torch.arange(count, device=blocks.device)
    whole[:, index, :, index] = blocks.transpose(0, 1)
    return whole.reshape(frequencies, count * a, count * b)


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


def _side_order(count: int, n: int, along: int, lined: bool, device: torch.device) -> Tensor:
    """From (element, w, v, w back) to (w, v over all elements; w back over all elements; wall)."""
    index = torch.arange(count * (along + n), device=device).reshape(count, -1, n)
    order = index.transpose(0, 1).flatten()
    extra = torch.arange(n if lined else 0, device=device) + order.numel()
    return torch.cat([order, extra])
