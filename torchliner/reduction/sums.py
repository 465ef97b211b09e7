"""The two inner sums of a pass, by the compiled kernel where there is one, else by torch alone."""

from __future__ import annotations

import contextlib
from types import ModuleType
from typing import Any

import torch
from torch import Tensor

from torchliner.reduction import eager, native
from torchliner.reduction.plan import Piece
from torchliner.reduction.threads import one_thread

NARROW = 64  # columns: fewer are folded, so that time fills the vectors


def _kernel(slab: Tensor) -> ModuleType:
    return native if slab.device.type == "cpu" and native.available() else eager


def sums_alone(device: torch.device) -> contextlib.AbstractContextManager[None]:
    """Let the compiled sums, where there are any, have the processors to themselves."""
    own = device.type == "cpu" and native.available()
    return one_thread() if own else contextlib.nullcontext()


def add_lines(
    slab: Tensor,
    pieces: list[Piece],
    rows: Tensor,
    sums: Tensor,
    squares: Tensor | None,
    smallest: Tensor | None,
    largest: Tensor | None,
) -> None:
    """Weighted sums of v over pieces of time, added to running ones; and v squared, and extremes.

    Args:
        slab: v, m/s, (t, P).
        pieces: (low, high, block) of its rows.
        rows: weights, (R, t).
        sums: (B, R, P), float64.
        squares: (B, P), float64.
        smallest, largest: (P,), float64.
    """
    if slab.shape[1] < NARROW and len(pieces) > 1:
        _add_narrow(slab, pieces, rows, sums, squares)
        if smallest is not None and largest is not None:
            torch.minimum(smallest, slab[pieces[0][0] : pieces[-1][1]].amin(0), out=smallest)
            torch.maximum(largest, slab[pieces[0][0] : pieces[-1][1]].amax(0), out=largest)
        return
    _kernel(slab).add_lines(slab, pieces, rows, sums, squares, smallest, largest)


def by_length(pieces: list[Piece]) -> dict[int, list[Piece]]:
    """Pieces of equal length, which fit side by side."""
    found: dict[int, list[Piece]] = {}
    for piece in pieces:
        found.setdefault(piece[1] - piece[0], []).append(piece)
    return found


def _add_narrow(
    slab: Tensor, pieces: list[Piece], rows: Tensor, sums: Tensor, squares: Tensor | None
) -> None:
    """``add_lines`` of few columns: pieces of equal length as a batch of products."""
    for length, same in by_length(pieces).items():
        first = torch.tensor([low for low, _, _ in same], device=slab.device)
        block = torch.tensor([number for *_, number in same], device=slab.device)
        where = first[:, None] + torch.arange(length, device=slab.device)
        own = slab[where]  # (n, length, P)
        found = torch.bmm(rows[:, where].movedim(0, 1), own)
        sums.index_add_(0, block, found.to(torch.float64))
        if squares is not None:
            squares.index_add_(0, block, own.square().sum(1).to(torch.float64))


def add_moments(
    slab: Tensor,
    pieces: list[Piece],
    count: int,
    centre: float,
    rows: Tensor | None,
    taken: Any,
    totals: Tensor,
    of_blocks: Tensor | None,
) -> None:
    """Chebyshev moments of |v| over pieces of time, added to running ones.

    Args:
        slab: v, m/s, (t, P).
        pieces: (low, high, block) of its rows, of at most 256.
        count, centre: K and c of ``basis.Chebyshev``.
        rows: weights beside the weight 1, (R - 1, t), or None.
        taken: what is taken off v beforehand, a ``sources.Taken``, or None.
        totals: (R, K, P), float64, in which sums of pieces are multiples of 2^-32.
        of_blocks: (S, R, K, P) in the data's precision, or None.
    """
    _kernel(slab).add_moments(slab, pieces, count, centre, rows, taken, totals, of_blocks)
