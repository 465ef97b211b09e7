"""The two inner sums of one pass over a plane, in torch alone: the reference, on any device."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.reduction.sources import Taken

ROWS = 256  # of a piece, at most: float32 sums of more lose digits
DIGIT = 2.0**32
BATCH = 1 << 16  # velocities of few columns that are worked on at once
NARROW = 64  # columns


@dataclass
class Lines:
    """Weighted sums of v over pieces of a slab's rows, added to those of their blocks.

    Args:
        pieces: low, high and block, int64, (pieces, 3): rows low to high - 1, at most 256, belong
            to a block of time; rows in no piece are left out.
        rows: weights in the slab's precision, (R, t).
        sums: (B, R, P), float64, added to; m/s.
        squares: sums of v^2, (B, P), float64, added to, (m/s)^2, or None.
        smallest, largest: extremes of v so far, m/s, (P,), float64; None where ``squares`` is.
    A nan or inf spoils the sums and extremes of its own column alone.
    """

    pieces: np.ndarray
    rows: Tensor
    sums: Tensor
    squares: Tensor | None = None
    smallest: Tensor | None = None
    largest: Tensor | None = None


def continued(sums: Tensor, count: int) -> Tensor:
    """Sums so far, (...), of the first of ``count`` stretches of time, a view of the only one; and
    zeros of the others: (count, ...)."""
    if count == 1:
        return sums[None]
    found = sums.new_zeros(count, *sums.shape)
    found[0] = sums
    return found


@dataclass
class Speeds:
    r"""Moments of :math:`|v^*|` over pieces of a slab's rows, added to totals and blocks.

    The moment k of a piece is :math:`\sum_n w_n T_k(x_n)`, :math:`x = (|v^*| - c)/(|v^*| + c)`,
    with Chebyshev's :math:`T_k`. The sum of a piece, made in the slab's precision, is rounded to a
    multiple of :math:`2^{-32}` before it is added: float64 holds sums of such numbers exactly below
    :math:`2^{21}`, so totals do not depend on the order, or the slabs, in which pieces are added.

    Args:
        pieces: as of ``Lines``.
        count: K >= 2, orders 0 to K - 1.  centre: c > 0, m/s.
        totals: (R, K, P), float64, added to.
        of_blocks: (S, R, K, P) in the slab's precision, added to, or None.
        rows: (R - 1, t), weights of the further rows, or None; row 0 has weight 1.
    A nan or inf makes the moments of its own column nan, but order 0, the sum of the weights.
    """

    pieces: np.ndarray
    count: int
    centre: float
    totals: Tensor
    of_blocks: Tensor | None = None
    rows: Tensor | None = None


def add(
    slab: Tensor, lines: Sequence[Lines] = (), speeds: Speeds | None = None,
    taken: Taken | None = None,
) -> None:  # fmt: skip
    """Add what is asked of a slab.

    Args:
        slab: (t, P), v in m/s, float32 or float64.
        lines, speeds: what is summed.
        taken: what is taken off v first, or None.
    """
    for each in lines:
        _add_lines(slab, each, taken)
    if speeds is not None:
        _add_moments(slab, speeds, taken)


def _batches(
    slab: Tensor, pieces: np.ndarray, columns: slice, taken: Taken | None
) -> Iterator[tuple[list[int], Any, Tensor]]:
    """Pieces of equal length side by side, many of few columns: their numbers, their rows, (n t),
    and v, (n, t, columns)."""
    lengths, width = pieces[:, 1] - pieces[:, 0], columns.stop - columns.start
    for length in dict.fromkeys(lengths.tolist()):
        all_of_them = np.flatnonzero(lengths == length).tolist()
        most = max(1, BATCH // (length * width)) if width < NARROW else 1
        for first in range(0, len(all_of_them), most):
            some = all_of_them[first : first + most]
            lows = torch.from_numpy(pieces[some, 0])
            rows: Any = slice(int(lows[0]), int(lows[0]) + length)
            if len(some) > 1:
                rows = (lows[:, None] + torch.arange(length)).flatten().to(slab.device)
            v = slab[rows, columns]
            if taken is not None:
                v = taken.part(rows, columns).off(v)
            yield some, rows, v.unflatten(0, (len(some), length))


def _blocks(pieces: np.ndarray, some: Sequence[int], device: torch.device) -> Tensor:
    return torch.from_numpy(pieces[some, 2]).to(device)


def _add_lines(slab: Tensor, lines: Lines, taken: Taken | None) -> None:
    weight_sums(slab, lines.pieces, None)
    for left, right in _tiles(slab, 4096):
        columns = slice(left, right)
        for some, rows, v in _batches(slab, lines.pieces, columns, taken):
            blocks = _blocks(lines.pieces, some, slab.device)
            w = lines.rows[:, rows].unflatten(1, (len(some), -1)).transpose(0, 1)
            lines.sums[:, :, columns].index_add_(0, blocks, torch.bmm(w, v).double())
            if lines.squares is None or lines.smallest is None or lines.largest is None:
                continue
            lines.squares[:, columns].index_add_(0, blocks, v.square().sum(1).double())
            for kept, meet, own in (
                (lines.smallest[columns], torch.minimum, v.amin((0, 1))),
                (lines.largest[columns], torch.maximum, v.amax((0, 1))),
            ):
                meet(kept, own, out=kept)


def _add_moments(slab: Tensor, speeds: Speeds, taken: Taken | None) -> None:
    count, further = speeds.count, speeds.rows
    known = weight_sums(slab, speeds.pieces, further).to(slab.device)
    signs, turns = _signs(count)
    for left, right in _tiles(slab, 2048):
        columns = slice(left, right)
        for some, rows, v in _batches(slab, speeds.pieces, columns, taken):
            n, length, width = v.shape
            w = slab.new_ones((n, known.shape[1], length))
            if further is not None:
                w[:, 1:] = further[:, rows].unflatten(1, (n, length)).transpose(0, 1)
            sums = slab.new_empty((count, n, known.shape[1], width))
            each = sums.unbind(0)
            speed = v.abs()
            twice = (speed - speeds.centre).mul_(2).div_(speed.add_(speeds.centre))
            before, now = speed.fill_(1), twice / 2
            for k in range(1, count):
                if k > 1:
                    torch.addcmul(before, twice, now, value=turns[k], out=before)
                    before, now = now, before
                torch.bmm(w, now, out=each[k])
            exact = rounded(sums.double() * signs.to(slab.device)[:, None, None, None])
            exact[0] = known[some][..., None]
            exact = exact.permute(1, 2, 0, 3)
            speeds.totals[:, :, columns] += exact.sum(0)
            if speeds.of_blocks is not None:
                blocks = _blocks(speeds.pieces, some, slab.device)
                speeds.of_blocks[..., columns].index_add_(0, blocks, exact.to(slab.dtype))


def weight_sums(slab: Tensor, pieces: np.ndarray, rows: Tensor | None) -> Tensor:
    """Moments of order 0, the sums of the weights of each piece: (pieces, R), float64, on the CPU.

    Raises:
        ValueError: if a piece has no row, more than 256, or rows that the slab has not.
    """
    count = len(slab)
    lows, highs = pieces[:, 0], pieces[:, 1]
    wrong = (lows < 0) | (highs > count) | (lows >= highs) | (highs - lows > ROWS)
    if wrong.any():
        low, high = pieces[wrong][0, :2]
        raise ValueError(f"a piece is 1 to {ROWS} of the {count} rows, not {low} to {high}")
    known = torch.from_numpy(highs - lows).to(torch.float64)[:, None]
    if rows is None or not len(pieces):
        return known.expand(-1, 1 if rows is None else 1 + len(rows)).contiguous()
    spans = pieces[:, :2].tolist()
    further = [rows[:, low:high].sum(1, dtype=torch.float64) for low, high in spans]
    return torch.cat([known, rounded(torch.stack(further))], 1)


def rounded(sums: Tensor) -> Tensor:
    """float64 to the nearest multiple of 2^-32, half to even."""
    return (sums * DIGIT).round_().div_(DIGIT)


def _tiles(slab: Tensor, width: int) -> list[tuple[int, int]]:
    """Columns that stay in the cache of a CPU while they are worked on; else few launches."""
    width = width if slab.device.type == "cpu" else 1 << 16
    columns = slab.shape[1]
    return [(left, min(left + width, columns)) for left in range(0, columns, width)]


def _signs(count: int) -> tuple[Tensor, list[int]]:
    """Signs s_k for which the recurrence of s_k T_k is one ``addcmul``, and its factors.

    T_k = 2 x T_{k-1} - T_{k-2} takes its last term away; with s_k = -s_{k-2} it is added:
    s_k T_k = s_{k-2} T_{k-2} + (s_k s_{k-1}) 2 x s_{k-1} T_{k-1}.
    """
    signs = [1, 1]
    for k in range(2, count):
        signs.append(-signs[k - 2])
    turns = [0, 0] + [signs[k] * signs[k - 1] for k in range(2, count)]
    return torch.tensor(signs[:count], dtype=torch.float64), turns
