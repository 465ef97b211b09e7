"""The two inner sums of a pass, by the compiled kernel where there is one, else by torch alone."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from torch import Tensor

from torchliner.reduction import eager, native
from torchliner.reduction.plan import Piece


def _kernel(slab: Tensor) -> ModuleType:
    return native if slab.device.type == "cpu" and native.available() else eager


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
    _kernel(slab).add_lines(slab, pieces, rows, sums, squares, smallest, largest)


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
