"""Collocation at Chebyshev points of 0 to 1: nodes, derivative, integral, interpolation."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor


def chebyshev_points(count: int) -> Tensor:
    """Gauss-Lobatto points, increasing from 0 to 1, float64, (N,)."""
    angle = math.pi * torch.arange(count, dtype=torch.float64) / (count - 1)
    return torch.sin(angle / 2) ** 2  # (1 - cos)/2 without cancellation


def derivative_matrix(count: int) -> Tensor:
    """D with (D f)_i = f'(x_i) for polynomials of degree below N, (N, N).

    Source: Trefethen, Spectral methods in MATLAB (2000), ch. 6, scaled to 0..1; differences of
        nodes from sines and diagonal from the row sums, both against rounding.
    """
    i = torch.arange(count, dtype=torch.float64)
    angle = math.pi * i / (count - 1)
    # x_i - x_j = (cos t_j - cos t_i)/2 = sin((t_i + t_j)/2) sin((t_i - t_j)/2)
    apart = torch.sin((angle[:, None] + angle) / 2) * torch.sin((angle[:, None] - angle) / 2)
    ends = torch.ones(count, dtype=torch.float64)
    ends[0] = ends[-1] = 2
    signs = (-1.0) ** (i[:, None] + i)
    matrix = ends[:, None] / ends * signs / (apart + torch.eye(count, dtype=torch.float64))
    matrix -= torch.diag(torch.diag(matrix))
    return matrix - torch.diag(matrix.sum(1))


def integral_matrix(count: int) -> Tensor:
    """W with (W f)_i = integral of f from 0 to x_i for polynomials of degree below N, (N, N)."""
    places, weights = (torch.as_tensor(v) for v in np.polynomial.legendre.leggauss(count))
    rows = [x / 2 * weights @ interpolation_matrix(count, x * (1 + places) / 2) for x in chebyshev_points(count)]
    return torch.stack(rows)


def interpolation_matrix(count: int, places: Tensor) -> Tensor:
    """Values at ``places`` (P,) within 0..1 from those at the N nodes, (P, N), barycentric."""
    nodes = chebyshev_points(count).to(places.device)
    weights = (-1.0) ** torch.arange(count, dtype=torch.float64, device=places.device)
    weights[0] /= 2
    weights[-1] /= 2
    apart = places[:, None] - nodes
    at_node = apart == 0
    shares = weights / torch.where(at_node, 1, apart)
    matrix = shares / shares.sum(1, keepdim=True)
    return torch.where(at_node.any(1, keepdim=True), at_node.to(matrix.dtype), matrix)
