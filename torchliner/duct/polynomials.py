"""Polynomials through given points of 0 to 1: values elsewhere, derivative, integral; those of one element.

A function is its N values at the points; Legendre coefficients lead from them to what is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

Array = NDArray[np.float64]
EXTRA_POINTS = 3  # of quadrature, over degree + 1: M(y) is no polynomial


def gauss_points(count: int) -> tuple[Array, Array]:
    """Gauss points and weights, (N,) each."""
    places, weights = legendre.leggauss(count)
    return (1 + places) / 2, weights / 2


def chebyshev_points(count: int) -> Array:
    """Gauss-Lobatto points of Chebyshev, increasing from 0 to 1, (N,)."""
    return np.sin(np.pi * np.arange(count) / (count - 1) / 2) ** 2  # (1 - cos)/2 without cancellation


def interpolation_matrix(points: Array, places: ArrayLike) -> Array:
    """Values at ``places``, (P, N)."""
    return _values(_coefficients(points), places)


def derivative_matrix(points: Array) -> Array:
    """Derivatives at the points, (N, N)."""
    return _values(2 * legendre.legder(_coefficients(points), axis=0), points)


def integral_matrix(points: Array) -> Array:
    """Integrals from 0 to each point, (N, N)."""
    return _values(legendre.legint(_coefficients(points), lbnd=-1, axis=0) / 2, points)


def _values(coefficients: NDArray[Any], places: ArrayLike) -> Array:
    return legendre.legvander(2 * np.asarray(places, np.float64) - 1, len(coefficients) - 1) @ coefficients


def _coefficients(points: Array) -> Array:
    """Legendre coefficients of the polynomials that are 1 at one point and 0 at the others, (N, N)."""
    return np.asarray(np.linalg.inv(legendre.legvander(2 * points - 1, len(points) - 1)), np.float64)


@dataclass(frozen=True, eq=False)
class Basis:
    """n = degree + 1 Lagrange polynomials phi through the Gauss points of 0..1, float64.

    Args:
        nodes, weights: Gauss points and weights, (n,); the mass matrix is diag(weights).
        convection: integral of phi_i' phi_j, (n, n).  first, last: phi at 0 and at 1, (n,).
    """

    nodes: Tensor
    weights: Tensor
    convection: Tensor
    first: Tensor
    last: Tensor

    @classmethod
    def of_degree(cls, degree: int, device: torch.device | None = None) -> Basis:
        """Exact integrals: products of two polynomials are below the Gauss rule's degree."""
        nodes, weights = gauss_points(degree + 1)
        convection = (weights[:, None] * derivative_matrix(nodes)).T
        parts = (nodes, weights, convection, *interpolation_matrix(nodes, [0.0, 1.0]))
        return cls(*(torch.as_tensor(part, device=device) for part in parts))

    @property
    def count(self) -> int:
        """n."""
        return len(self.nodes)

    def values(self, places: ArrayLike) -> Tensor:
        """phi at places of 0..1, (P, n)."""
        return torch.as_tensor(interpolation_matrix(self.nodes.cpu().numpy(), places)).to(self.nodes)

    def quadrature(self) -> tuple[Array, Tensor, Tensor]:
        """Finer Gauss points, phi there (Q, n) and weights (Q,), for what is no polynomial."""
        places, weights = gauss_points(self.count + EXTRA_POINTS)
        return places, self.values(places), torch.as_tensor(weights).to(self.nodes)
