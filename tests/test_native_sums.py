"""Moments and lines of a slab: compiled and in torch, against float64 and against each other."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from torchliner.reduction import eager, native

CENTRE = 0.9375  # m/s, a float32
BUILT = native.available()
needs_native = pytest.mark.skipif(not BUILT, reason=str(native.reason))
WAYS = [eager, pytest.param(native, marks=needs_native)]


def plane(length, columns, dtype=torch.float32, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return 2 * torch.randn(length, columns, generator=generator, dtype=dtype)


def weight_rows(length, dtype=torch.float32):
    angle = 0.0879 * torch.arange(length, dtype=torch.float64)
    return torch.stack([angle.cos(), angle.sin()]).to(dtype)


def cut(length, rows=142):
    return [(low, min(low + rows, length), low // rows) for low in range(0, length, rows)]


def moments(way, v, pieces=None, count=24, rows=None, taken=None, columns=slice(None)):
    """(R, K, P) and (S, R, K, P) of a slab."""
    pieces = cut(len(v)) if pieces is None else pieces
    shape = (1 if rows is None else 1 + len(rows), count, v.shape[1])
    totals = torch.zeros(shape, dtype=torch.float64)
    of_blocks = torch.zeros((max(b for *_, b in pieces) + 1, *shape), dtype=v.dtype)
    way.add_moments(v, pieces, count, CENTRE, rows, taken, totals, of_blocks)
    return totals, of_blocks


def oracle(v, count, rows=None):
    """The definition, in numpy and float64."""
    s = np.abs(v.double().numpy())
    angle = np.arccos((s - CENTRE) / (s + CENTRE))
    w = np.ones((1, len(s)))
    if rows is not None:
        w = np.concatenate([w, rows.double().numpy()])
    return np.stack([w @ np.cos(k * angle) for k in range(count)], 1)


def lines(way, v, pieces, rows):
    blocks, columns = max(b for *_, b in pieces) + 1, v.shape[1]
    zeros = dict(dtype=torch.float64)
    sums, squares = (
        torch.zeros(blocks, len(rows), columns, **zeros),
        torch.zeros(blocks, columns, **zeros),
    )
    smallest = torch.full((columns,), np.inf, **zeros)
    way.add_lines(v, pieces, rows, sums, squares, smallest, largest := -smallest)
    return sums, squares, smallest, largest


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("dtype", "limit"), [(torch.float32, 2e-7), (torch.float64, 1e-10)])
@pytest.mark.parametrize("further", [0, 1, 2, 8])
def test_moments_are_their_definition(way, dtype, limit, further):
    v = plane(2280, 65, dtype)
    rows = weight_rows(2280, dtype).repeat(4, 1)[:further] if further else None
    totals, of_blocks = moments(way, v, rows=rows)
    np.testing.assert_allclose(totals / 2280, oracle(v, 24, rows) / 2280, atol=limit)
    np.testing.assert_allclose(of_blocks.double().sum(0) / 2280, totals / 2280, atol=limit)


@needs_native
def test_both_ways_agree():
    v, rows = plane(1000, 100), weight_rows(1000)
    both = [moments(way, v, count=32, rows=rows)[0] / 1000 for way in (native, eager)]
    assert (both[0] - both[1]).abs().max() < 2e-7
