"""The sums of ``eager`` by the compiled library."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.compiled.library import address, in_threads
from torchliner.compiled.threads import threads
from torchliner.reduction.eager import Lines, Speeds, weight_sums
from torchliner.reduction.sources import Taken

TILE = 64  # columns; the ranges of threads begin at multiples of it
SHARES = 4  # of each thread, which may be done sooner or later than the others


def add(
    slab: Tensor, lines: Sequence[Lines] = (), speeds: Speeds | None = None,
    taken: Taken | None = None,
) -> None:  # fmt: skip
    """``eager.add`` on a CPU, to the same bits for any threads and any order of columns.

    Raises:
        ValueError, IndexError: where a tensor or a block does not fit; nothing is added then.
    """
    kept: list[Any] = []  # till the end: what the addresses point to
    slab_of = _slab(slab, taken, kept)
    asked = (_Lines * len(lines))(*(_lines(slab, each, kept) for each in lines))
    moments = None if speeds is None else ctypes.byref(_moments(slab, speeds, kept))
    columns = slab.shape[1]
    share = -(-columns // (TILE * SHARES * threads())) * TILE
    given = ctypes.byref(slab_of), asked, ctypes.c_int64(len(lines)), moments
    in_threads(_of("add", slab), share, columns, given)
    del kept


def _moments(slab: Tensor, speeds: Speeds, kept: list[Any]) -> _Moments:
    known = weight_sums(slab, speeds.pieces, speeds.rows)
    rows = None if speeds.rows is None else speeds.rows.contiguous()
    kept += [known, rows]
    further, dtype, (length, columns) = known.shape[1], slab.dtype, slab.shape
    return _Moments(
        _pieces(speeds.pieces, speeds.of_blocks, kept),
        address(rows, (further - 1, length), dtype),
        length,
        further,
        speeds.count,
        speeds.centre,
        address(known, known.shape),
        address(speeds.totals, (further, speeds.count, columns)),
        address(speeds.of_blocks, (-1, further, speeds.count, columns), dtype),
    )


def _lines(slab: Tensor, lines: Lines, kept: list[Any]) -> _Lines:
    weight_sums(slab, lines.pieces, None)
    (length, columns), count = slab.shape, len(lines.rows)
    rows = lines.rows.contiguous()
    kept.append(rows)
    return _Lines(
        _pieces(lines.pieces, lines.sums, kept),
        address(rows, (count, length), slab.dtype),
        length,
        count,
        address(lines.sums, (-1, count, columns)),
        address(lines.squares, (len(lines.sums), columns)),
        address(lines.smallest, (columns,)),
        address(lines.largest, (columns,)),
    )


def cell_averages(slab: Tensor, runs: Tensor, shares: Tensor) -> Tensor:
    """Of v over cells, (t, C), of sums in float64.

    Args:
        slab: v, m/s, (t, P), columns side by side in memory.
        runs: of neighbouring columns of one cell: first column, how many, cell; int64, (n, 3).
        shares: of a column in its cell, float64, (C,).
    """
    found = slab.new_empty(len(slab), len(shares))
    slab_of = _slab(slab, None, [])
    given = (
        ctypes.c_void_p(address(runs, (-1, 3), torch.int64)), ctypes.c_int64(len(runs)),
        ctypes.c_void_p(address(shares, (-1,))), ctypes.c_int64(len(shares)),
        ctypes.c_void_p(found.data_ptr()),
    )  # fmt: skip
    share = -(-len(slab) // (SHARES * threads()))
    in_threads(_of("cells", slab), share, len(slab), (ctypes.byref(slab_of), *given))
    return found


def _of(name: str, slab: Tensor) -> str:
    """The function for slabs of this precision; there is none for a GPU."""
    return f"{name}_{str(slab.dtype).removeprefix('torch.')}" if slab.is_cpu else slab.device.type


def _members(text: str) -> list[tuple[str, Any]]:
    """Of a structure of the C++ file: pointers with a star, else int64."""
    return [(name.lstrip("*"), ctypes.c_void_p if name[0] == "*" else ctypes.c_int64) for name in text.split()]


class _Slab(ctypes.Structure):
    _fields_ = _members("*v row_stride column_stride columns *taken_rows *taken_coefficients *scale taken_count")


class _Pieces(ctypes.Structure):
    _fields_ = _members("*at count")


class _Moments(ctypes.Structure):
    _fields_ = [
        ("pieces", _Pieces), *_members("*weights weight_stride rows count"),
        ("centre", ctypes.c_double), *_members("*known *totals *of_blocks"),
    ]  # fmt: skip


class _Lines(ctypes.Structure):
    _fields_ = [
        ("pieces", _Pieces),
        *_members("*weights weight_stride rows *sums *squares *smallest *largest"),
    ]


def _slab(slab: Tensor, taken: Taken | None, kept: list[Any]) -> _Slab:
    """What the C++ file knows of a slab; what must live as long is put into ``kept``."""
    length, columns = slab.shape
    rows = coefficients = scale = None
    if taken is not None:
        rows, coefficients = taken.rows.contiguous(), taken.coefficients.contiguous()
        scale = None if taken.scale is None else taken.scale.contiguous()
        kept += [rows, coefficients, scale]
    of = 0 if rows is None else rows.shape[1]
    return _Slab(
        slab.data_ptr(),
        slab.stride(0),
        slab.stride(1),
        columns,
        address(rows, (length, of), slab.dtype),
        address(coefficients, (of, columns), slab.dtype),
        address(scale, (columns,), slab.dtype),
        of,
    )


def _pieces(pieces: np.ndarray, of_blocks: Tensor | None, kept: list[Any]) -> _Pieces:
    blocks = pieces[:, 2]
    if of_blocks is not None and ((blocks < 0) | (blocks >= len(of_blocks))).any():
        raise IndexError(f"blocks {blocks.min()} to {blocks.max()}, but room for {len(of_blocks)}")
    table = np.ascontiguousarray(pieces, dtype=np.int64)
    kept.append(table)
    return _Pieces(table.ctypes.data, len(table))
