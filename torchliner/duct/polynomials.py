"""Polynomials through given points of 0 to 1: values elsewhere, derivative, integral.

A function is its N values at the points; Legendre coefficients lead from them to what is asked for.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def gauss_points(count: int) -> tuple[Array, Array]:
    """Gauss points and weights, (N,) each."""
    places, weights = legendre.leggauss(count)
    return (1 + places) / 2, weights / 2


def chebyshev_points(count: int) -> Array:
    """Gauss-Lobatto points of Chebyshev, increasing from 0 to 1, (N,)."""
    return np.sin(np.pi * np.arange(count) / (count - 1) / 2) ** 2  # (1 - cos)/2 without cancellation


def interpolation_matrix(points: Array, places: ArrayLike) -> Array:
    """Values at ``places``, (P, N)."""
    return legendre.legvander(2 * np.asarray(places, np.float64) - 1, len(points) - 1) @ _coefficients(points)


def derivative_matrix(points: Array) -> Array:
    """Derivatives at the points, (N, N)."""
    slopes = 2 * legendre.legder(_coefficients(points), axis=0)
    return legendre.legvander(2 * points - 1, len(points) - 2) @ slopes


def integral_matrix(points: Array) -> Array:
    """Integrals from 0 to each point, (N, N)."""
    integrals = legendre.legint(_coefficients(points), lbnd=-1, axis=0) / 2
    return legendre.legvander(2 * points - 1, len(points)) @ integrals


def _coefficients(points: Array) -> Array:
    """Legendre coefficients of the polynomials that are 1 at one point and 0 at the others, (N, N)."""
    return np.asarray(np.linalg.inv(legendre.legvander(2 * points - 1, len(points) - 1)), np.float64)
