r"""All columns of a duct, swept from the right end to the left and back.

With a the waves along the flow, b those against it and x those from the lined wall, each column
gives a' = S_aa a + S_ab b' + S_aw x and b = S_ba a + S_bb b' + S_bw x, primes on its right side.
Let b' = R' a' + s' hold there for everything on the right. Then b' = P a + t with

.. math:: P = (1 - R' S_{ab})^{-1} R' S_{aa}, \quad
    t = (1 - R' S_{ab})^{-1} (R' S_{aw} x + s'),

and R = S_ba + S_bb P, s = S_bb t + S_bw x hold on its left side. At the right end R = 0. The second
sweep runs from a at the left end through a' = S_aa a + S_ab (P a + t) + S_aw x.

All x at once: the waves are matrices with one column for each unit wave into the duct, at its left
end, through its lined wall in the order of x, and at its right end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.lee.columns import Column


@dataclass(frozen=True, eq=False)
class Station:
    """One column in the duct, with all waves into it for unit waves into the duct.

    Args:
        number: of the column, from the left.
        column: its scattering.
        incoming: from the left, from the right and, if lined, from the wall, (F, I, D).
        wall_out: waves (p - v)/2 that arrive at a lined wall, (F, n, D), or (F, 0, D).
    """

    number: int
    column: Column
    incoming: Tensor
    wall_out: Tensor


@dataclass(frozen=True, eq=False)
class Ends:
    """Unit waves into the duct: at its left end (F, along, L), at its right end (F, N, R)."""

    left: Tensor
    right: Tensor


def sweep(columns: list[Column], ends: Ends) -> Iterator[Station | tuple[Tensor, Tensor]]:
    """Stations from left to right, then b at the left end and a at the right end, (F, ., D)."""
    first, last = ends.left.shape[-1], ends.right.shape[-1]
    widths = [c.blocks["wall", "wall"].shape[-1] for c in columns]
    total = first + sum(widths) + last
    wall_from = [first + sum(widths[:i]) for i in range(len(columns))]
    passes, sources = _backward(columns, ends, wall_from, widths, total)
    along = ends.left.new_zeros(*ends.left.shape[:2], total)
    along[..., :first] = ends.left
    left_out: Tensor | None = None
    for i, column in enumerate(columns):
        at = slice(wall_from[i], wall_from[i] + widths[i])
        back = passes[i] @ along
        back[..., wall_from[i] :] += sources[i]
        passes[i] = sources[i] = back[..., :0]  # done with
        wall_in = along.new_zeros(len(along), widths[i], total)
        wall_in[..., at] = torch.eye(widths[i], dtype=along.dtype, device=along.device)
        incoming = torch.cat([along, back, wall_in], -2)
        if left_out is None:
            left_out = column.out["left"] @ incoming
        yield Station(i, column, incoming, column.out["wall"] @ incoming)
        along = column.out["right"] @ incoming
    assert left_out is not None
    yield left_out, along


def _backward(
    columns: list[Column], ends: Ends, wall_from: list[int], widths: list[int], total: int
) -> tuple[list[Tensor], list[Tensor]]:
    """P and t of every column; t has the columns of its own wall and of all on its right."""
    reflection = ends.right.new_zeros(len(ends.right), ends.right.shape[1], ends.left.shape[1])
    source = ends.right
    passes: list[Tensor] = []
    sources: list[Tensor] = []
    for i in reversed(range(len(columns))):
        blocks, width = columns[i].blocks, widths[i]
        one = torch.eye(reflection.shape[-2], dtype=reflection.dtype, device=reflection.device)
        right = torch.cat(
            [reflection @ blocks["right", "left"], reflection @ blocks["right", "wall"], source], -1
        )
        solved = torch.linalg.solve(one - reflection @ blocks["right", "right"], right)
        passed, source = solved.tensor_split([blocks["right", "left"].shape[-1]], -1)
        passes.append(passed)
        sources.append(source)
        reflection = blocks["left", "left"] + blocks["left", "right"] @ passed
        source = blocks["left", "right"] @ source
        source[..., :width] += blocks["left", "wall"]
        assert source.shape[-1] == total - wall_from[i]
    return passes[::-1], sources[::-1]
