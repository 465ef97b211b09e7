"""Sums of Chebyshev functions of |v|: the definition in torch, and where faster code for a device is found.

A faster function takes and gives what ``torch_sums`` does, and its module says by ``available()`` whether it can be
used here. ``TORCHLINER_SUMS=torch`` in the environment keeps to torch alone.
"""

from __future__ import annotations

import importlib

import torch
from torch import Tensor

TILE = 1 << 17  # velocities whose temporaries stay in the cache of a CPU
FASTER = {"cpu": "torchliner.engine.native", "cuda": "torchliner.engine.triton_sums"}  # by kind of device


def sums(weights: Tensor, columns: Tensor, count: int, centre: float) -> Tensor:
    r"""m_k = sum_t w_t T_k(x_t), x = (|v| - c)/(|v| + c), with the fastest code of the device.

    Args:
        weights: w of G slabs of at most 256 rows, in the precision of the data, (G, R, L).
        columns: v, m/s, (G, L, N), float32 or float64.
        count: K, 2 or more.
        centre: c, m/s.
    Returns:
        float64, (G, R, K, N). A nan or inf in v makes the sums of its own column nan, but for order 0, the sum of w.
    """
    home = FASTER.get(columns.device.type)
    if home is not None:
        faster = importlib.import_module(home)
        if faster.available():
            found: Tensor = faster.sums(weights, columns, count, centre)
            return found
    return torch_sums(weights, columns, count, centre)


def torch_sums(weights: Tensor, columns: Tensor, count: int, centre: float) -> Tensor:
    """``sums`` in torch alone: the definition, on any device."""
    slabs, rows, length = weights.shape
    width = columns.shape[2]
    found = torch.empty(slabs, rows, count, width, dtype=torch.float64, device=columns.device)

    tile = max(1, TILE // (slabs * length)) if columns.device.type == "cpu" else width
    for left in range(0, width, tile):
        v = columns[:, :, left : left + tile]
        each = v.new_empty(count, slabs, rows, v.shape[2])
        speed = v.abs()
        twice = (speed - centre).mul_(2).div_(speed.add_(centre))
        # T_k = 2 x T_{k-1} - T_{k-2}: with the signs +, +, -, -, +, +, ... of T_k the last term is added instead, so
        # that each order is one operation; the signs are put right at the end.
        before, now = torch.ones_like(speed), twice / 2
        torch.bmm(weights, before, out=each[0])
        for k in range(1, count):
            if k > 1:
                torch.addcmul(before, twice, now, value=(-1) ** (k - 1), out=before)
                before, now = now, before
            torch.bmm(weights, now, out=each[k])
        found[..., left : left + tile] = each.permute(1, 2, 0, 3)
    return found * (1 - 2 * (torch.arange(count, device=found.device) // 2 % 2))[:, None]
