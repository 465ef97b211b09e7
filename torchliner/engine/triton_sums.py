"""Sums of Chebyshev functions of |v| on a GPU: one Triton kernel, with the contract of ``nodes.torch_sums``.

Checked in Triton's interpreter and on an NVIDIA H200, where it sums 27 400 x 2280 velocities, 24 orders, in 1 ms.

A program has one slab, ``TILE`` columns, some rows of weights and a run of orders. A thread has one column and keeps
its sums in registers, a tuple that is unrolled when the kernel is compiled, while v streams past. Orders beyond
``REGISTERS`` go to other programs, which repeat the recurrence up to their first one.
"""

from __future__ import annotations

import functools
import importlib
import math
import os
from typing import Any, no_type_check

import torch
from torch import Tensor

TILE, WARPS = 64, 2  # columns of a program, and its groups of 32 threads
REGISTERS = 96  # of 32 bits, for the sums of a thread
MOST_ROWS = 3  # of weights in a program: with more, fewer orders would share a reading of v

tl: Any = None  # triton.language, where Triton looks for it; imported with the first sums


def available() -> bool:
    """Whether Triton 3.3 or newer is installed and has a GPU, or its interpreter (``TRITON_INTERPRET=1``)."""
    try:
        version = importlib.import_module("triton").__version__
    except ImportError:
        return False
    new = tuple(map(int, version.split(".")[:2])) >= (3, 3)  # torch 2.6 brings 3.2, which takes no tuples
    return new and (os.environ.get("TRITON_INTERPRET") == "1" or torch.cuda.is_available())


def sums(weights: Tensor, columns: Tensor, count: int, centre: float) -> Tensor:
    """m_k of each slab, row of weights and column, as ``nodes.torch_sums`` defines them; strides are any."""
    slabs, rows, length = weights.shape
    width = columns.shape[2]
    rows_each = math.ceil(rows / math.ceil(rows / MOST_ROWS))
    orders = math.ceil(count / math.ceil(count * rows_each * columns.element_size() / (4 * REGISTERS)))
    programs = slabs * math.ceil(width / TILE) * math.ceil(rows / rows_each) * math.ceil(count / orders)
    found = torch.empty(slabs, rows, count, width, dtype=torch.float64, device=columns.device)
    sizes, steps = (rows, length, width, count), (*weights.stride(), *columns.stride())
    with torch.cuda.device_of(columns):
        run = _compiled()[(programs,)]
        run(weights, columns, found, centre, sizes, steps, rows_each, orders, TILE, num_warps=WARPS)
    return found


@functools.cache
def _compiled() -> Any:
    global tl
    tl = importlib.import_module("triton.language")
    return importlib.import_module("triton").jit(_kernel)


@no_type_check
def _kernel(w, v, out, centre: tl.float64, sizes, steps, ROWS: tl.constexpr, ORDERS: tl.constexpr, TILE: tl.constexpr):
    rows, length, width, count = sizes
    w_slab, w_row, w_time, v_slab, v_time, v_column = steps
    tl.assume(length > 0)  # else the compiler keeps the sums in float64, in twice as many registers
    groups, parts, tiles = tl.cdiv(rows, ROWS), tl.cdiv(count, ORDERS), tl.cdiv(width, TILE)
    program = tl.program_id(0)  # neighbours read the same v
    first, row, program = program % parts * ORDERS, program // parts % groups * ROWS, program // (parts * groups)
    slab, column = (program // tiles).to(tl.int64), program % tiles * TILE + tl.arange(0, TILE)
    inside, block = column < width, tl.zeros((TILE,), tl.int32)  # Triton 3.9 interprets no scalars in a mask
    kind = v.dtype.element_ty
    one, c = tl.full((TILE,), 1.0, kind), tl.full((), centre, kind)
    v += slab * v_slab + column.to(tl.int64) * v_column
    w += slab * w_slab + row * w_row
    totals = (one - one,) * (ORDERS * ROWS)
    for _ in range(length):
        speed, each, larger = tl.abs(tl.load(v, mask=inside, other=0.0)), (), ()
        for r in tl.static_range(ROWS):
            each += (tl.load(w + r * w_row, mask=row + r < rows, other=0.0),)
        v, w = v + v_time, w + w_time
        if kind == tl.float32:
            now = tl.div_rn(speed - c, speed + c)  # "/" would round less well than torch does
        else:
            now = (speed - c) / (speed + c)
        before, twice = one, now + now
        for _ in range(first):
            before, now = now, twice * now - before
        for k in tl.static_range(ORDERS):
            for r in tl.static_range(ROWS):
                larger += (totals[k * ROWS + r] + each[r] * before,)
            before, now = now, twice * now - before
        totals = larger
    for k in tl.static_range(ORDERS):
        for r in tl.static_range(ROWS):
            place = ((slab * rows + row + r) * count + first + k) * width + column
            there = inside & (block + row + r < rows) & (block + first + k < count)
            tl.store(out + place, totals[k * ROWS + r].to(tl.float64), mask=there)
